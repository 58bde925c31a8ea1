"""The drives of a study are its full grid; runs are paired; keys hold what decides a drive."""

import pytest

from experiments import simulation
from experiments.batch import drive_plan, study_file
from experiments.batch.drive_plan import NOMINAL, Combination, Perturbation


def test_the_grid_is_full_and_the_last_setting_changes_first(write_study):
    settings = {'plant.friction': [0.8, 1.0], 'scenario.speed_mps': [14, 15]}
    study = study_file.load(write_study(controllers=['mpcc', 'mpcc_no_ca'], set=settings))
    combinations = drive_plan.combine(study)
    assert len(combinations) * study.runs == study.drives == 16
    assert [dict(one.settings) for one in combinations[:4]] == [
        {'plant.friction': friction, 'scenario.speed_mps': speed}
        for friction in (0.8, 1.0)
        for speed in (14, 15)
    ]
    assert len({one.formulation for one in combinations}) == 2


def test_a_run_has_one_perturbation_for_every_scenario_controller_and_setting():
    perturbations = drive_plan.draw_perturbations(4, seed=3)
    assert perturbations[0] == NOMINAL
    assert len(set(perturbations)) == 4
    for scenario, controller, friction in (
        ('double_lane_change', 'mpcc', 0.8),
        ('straight', 'frenet', 1.0),
    ):
        one = Combination(scenario, controller, (('plant.friction', friction),))
        nominal = drive_plan.prepare(one)
        for perturbation in perturbations:
            setup = drive_plan.perturb(nominal, perturbation)
            assert setup.friction / friction == pytest.approx(perturbation.grip)
            change = setup.scn.start.speed - nominal.scn.start.speed
            assert 3.6 * change == pytest.approx(perturbation.speed_kph)
            assert setup.params == nominal.params


def test_more_runs_begin_with_those_of_fewer_and_another_seed_gives_others():
    more = drive_plan.draw_perturbations(7, seed=1)
    assert more[:3] == drive_plan.draw_perturbations(3, seed=1)
    assert not set(more[1:]) & set(drive_plan.draw_perturbations(7, seed=2))


def test_a_perturbed_speed_is_that_of_the_scenario_driven_at_it():
    nominal = drive_plan.prepare(Combination('double_lane_change', 'mpcc', ()))
    speed_mps = nominal.scn.start.speed + 0.5 / 3.6
    faster = drive_plan.perturb(nominal, Perturbation(0.5, 1.0)).scn
    driven = simulation.prepare('double_lane_change', 'mpcc', speed_mps=speed_mps).scn
    assert faster.start == pytest.approx(driven.start)
    assert faster.reference.t == pytest.approx(driven.reference.t)


ONE = Combination('straight', 'mpcc', (('plant.friction', 0.9),))


@pytest.mark.parametrize(
    'other',
    [
        ONE._replace(scenario='circle_20m'),
        ONE._replace(controller='mpcc_no_ca'),
        ONE._replace(settings=(('plant.friction', 0.91),)),
        ONE._replace(settings=(*ONE.settings, ('plant.car.body.mass_kg', 1600.0))),
        ONE._replace(settings=(*ONE.settings, ('controller.tolerances.lag_m', 0.4))),
        ONE._replace(settings=(*ONE.settings, ('scenario.speed_mps', 15.5))),
    ],
    ids=str,
)
def test_the_key_of_a_drive_depends_on_what_decides_it(other):
    runs = drive_plan.draw_perturbations(3, seed=1)
    keys = drive_plan.drive_keys(drive_plan.prepare(ONE), runs)
    assert len(set(keys)) == 3
    assert not set(keys) & set(drive_plan.drive_keys(drive_plan.prepare(other), runs))
