"""The drives of a study are its full grid; runs are paired; keys hold what decides a drive."""

import pytest

from bags.errors import BagError
from experiments import simulation
from experiments.batch import drive_plan, study_file
from experiments.batch.drive_plan import (
    NOMINAL,
    NOT_DRAWN,
    Combination,
    Draw,
    Drive,
    Family,
    Perturbation,
)
from msgs_yaml import share
from scenario_publisher.families import draw as families


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


def keys_of(combination, runs, draw=NOT_DRAWN):
    base = drive_plan.base_key(combination, draw.words)
    return [drive_plan.drive_key(base, Drive(combination, draw, run)) for run in runs]


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
    keys = keys_of(ONE, runs)
    assert len(set(keys)) == 3
    assert not set(keys) & set(keys_of(other, runs))


ROAD = Combination('straight', 'mpcc', ())
POP_UP = Combination(Family('pop_up', 1, 'nominal'), 'mpcc', ())
LOW = Draw(0, (('plant.friction', 0.9),))


@pytest.mark.parametrize(
    ('one', 'other'),
    [
        ((ROAD, LOW), (ROAD, Draw(0, (('plant.friction', 0.91),)))),
        ((ROAD, LOW), (ROAD, NOT_DRAWN)),
        ((ROAD, LOW), (POP_UP, LOW)),
        ((POP_UP, Draw(0, ())), (POP_UP, Draw(1, ()))),
        ((POP_UP, LOW), (POP_UP._replace(scenario=Family('pop_up', 2, 'nominal')), LOW)),
        ((POP_UP, LOW), (POP_UP._replace(scenario=Family('pop_up', 1, 'hard')), LOW)),
        ((POP_UP, LOW), (POP_UP._replace(scenario=Family('closed_road', 1, 'nominal')), LOW)),
        (
            (ROAD, Draw(0, (('plant.tyre_set', 'tyre_205_60r15.yaml'),))),
            (ROAD, Draw(0, (('plant.tyre_set', 'tyre_245_40r18.yaml'),))),
        ),
    ],
    ids=lambda pair: f'{pair[0].scenario}-{pair[1].values}',
)
def test_the_key_of_a_drive_depends_on_its_draw(one, other):
    (key,), (other_key,) = (keys_of(road, [NOMINAL], draw) for road, draw in (one, other))
    assert key != other_key


def test_a_drawn_value_that_is_a_file_decides_by_its_content(tmp_path):
    """As a value of `set` does: the same path may hold another car tomorrow."""
    car = tmp_path / 'car.yaml'
    shipped = share.path('mpcc_controller', 'config', 'car.yaml').read_text()
    (line,) = (line for line in shipped.splitlines() if 'mass_kg' in line)
    draw = Draw(0, (('controller.car_file', str(car)),))
    keys = []
    for heavier in ('', '1'):
        car.write_text(shipped.replace(line, line.replace('mass_kg: 1', f'mass_kg: {heavier}1')))
        drive_plan.prepare.cache_clear()
        keys += keys_of(ROAD, [NOMINAL], draw)
    assert shipped != car.read_text()
    assert len(set(keys)) == 2


def test_every_controller_and_setting_has_the_same_draws(write_study):
    study = study_file.load(
        write_study(
            controllers=['mpcc', 'mpcc_no_ca'],
            families=['pop_up', 'closed_road'],
            draw={'controller.tolerances.lag_m': {'log_uniform': [0.1, 1.0]}},
            draws=4,
        )
    )
    draws = drive_plan.sample_draws(study)
    combinations = drive_plan.combine(study)
    assert [len(drive_plan.draws_of(one, draws)) for one in combinations] == [4] * 12
    assert study.drives == 12 * 4 * 2
    pop_up = combinations[4]
    assert pop_up.scenario == Family('pop_up', 1, 'nominal')
    for draw in draws:
        setup = drive_plan.prepare(pop_up, draw)
        assert setup.scn.text == families.draw('pop_up', 1, draw.number).text
        assert setup.params.tolerances.lag_m == dict(draw.values)['controller.tolerances.lag_m']
        assert setup.friction == 0.8  # of `set`


def test_a_batch_of_more_draws_or_later_ones_has_the_same_draws(write_study):
    def sampled(**given):
        draw = {'plant.car.body.mass_kg': {'uniform': [1500, 1700]}}
        return drive_plan.sample_draws(study_file.load(write_study(draw=draw, **given)))

    more = sampled(draws=16)
    assert more[:5] == sampled(draws=5)
    assert more[9:12] == sampled(draws=3, first_draw=9)
    assert not {draw.values for draw in more} & {draw.values for draw in sampled(draws=16, seed=2)}


def test_a_scenario_without_drawn_values_is_driven_once_beside_families(write_study):
    study = study_file.load(write_study(families=['pop_up'], draws=7, runs=1))
    draws = drive_plan.sample_draws(study)
    road, *_, pop_up = drive_plan.combine(study)
    assert drive_plan.draws_of(road, draws) == (NOT_DRAWN,)
    assert len(drive_plan.draws_of(pop_up, draws)) == 7
    assert study.drives == 2 + 2 * 7


def test_drawn_speed_and_friction_are_those_of_the_scenario():
    draw = Draw(3, (('scenario.speed_mps', 19.0), ('scenario.friction', 0.7)))
    setup = drive_plan.prepare(Combination('double_lane_change', 'mpcc', ()), draw)
    assert setup.scn.start.speed == pytest.approx(19.0)
    assert setup.friction == setup.params.model.friction == 0.7


def test_a_draw_of_a_hard_family_has_its_errors_of_measurement():
    hard = Combination(Family('pop_up', 4, 'hard'), 'mpcc_road', ())
    one = families.draw('pop_up', 4, 2, 'hard')
    setup = drive_plan.prepare(hard, Draw(2, ()))
    wanted = one.settings['controller']['measurement_errors.left_bias_m']
    assert setup.params.measurement_errors.left_bias_m == wanted != 0.0


@pytest.mark.parametrize(
    ('name', 'distribution', 'what'),
    [
        ('plant.friction', {'uniform': [0.5, 9.0]}, r'9.0: .*allowed 0.05 to 1.5'),
        ('controller.safety.obstacle_m', {'log_uniform': [0.001, 1.0]}, 'allowed 0.01 to 10 m'),
        ('controller.no_such', {'uniform': [0, 1]}, 'no such parameter'),
        ('plant.command_delay_ms', {'choice': [0, 20, 0.5]}, '0.5: .*whole number'),
        ('plant.command_delay_ms', {'uniform': [0, 20]}, '7.6.*: .*whole number'),
    ],
)
def test_ends_that_a_node_refuses_are_located(write_study, name, distribution, what):
    study = study_file.load(write_study(set={}, draw={name: distribution}, draws=2))
    combinations = drive_plan.combine(study)
    with pytest.raises(BagError, match=rf'study.yaml:\d+: draw.{name}: .*{what}'):
        drive_plan.check_drawn(study, combinations)
