"""The lateral acceleration that the plant holds: by driving the circle, and between frictions."""

import dataclasses

import pytest
from closed_loops import fixed_weights

from bags.evaluation.drive import LATERAL_LIMIT
from bags.evaluation.metrics import compute_metrics
from experiments import drive_row, plant_limit, simulation
from experiments.drive_row import Row
from scenario_publisher.friction_patches import Patches
from vehicle_plant import parameters as plant_parameters


@pytest.fixture(scope='module')
def setup():
    weights = {'controller': fixed_weights('mpcc')}  # that load the tyres
    return simulation.prepare('double_lane_change', 'mpcc', weights)


@pytest.mark.parametrize('friction', [0.96, 0.06])
def test_between_the_frictions_of_the_grid_the_limit_is_that_of_the_circle(setup, friction):
    driven = plant_limit.lateral_limit(setup.plant, friction)
    assert plant_limit.held_lateral_limit(setup.plant, friction) == pytest.approx(driven, rel=5e-3)


def test_a_limit_is_driven_once_for_a_manoeuvre_and_kept(setup, tmp_path, monkeypatch):
    monkeypatch.setenv('MPCC_CACHE_DIR', str(tmp_path))
    drives, genuine = [], plant_limit.lateral_limit
    monkeypatch.setattr(
        plant_limit, 'lateral_limit', lambda *given: drives.append(given) or genuine(*given)
    )
    limits = set()

    def find():
        plant_limit._limit_at.cache_clear()  # as in another process
        limits.add(plant_limit.held_lateral_limit(setup.plant, 0.2))
        return len(drives)

    assert [find(), find()] == [1, 1]
    manoeuvre = tmp_path / 'identify.yaml'
    manoeuvre.write_text(f'{plant_parameters.config_file(plant_limit.MANOEUVRE).read_text()}\n')
    monkeypatch.setattr(plant_parameters, 'config_file', lambda name: manoeuvre)
    assert find() == 2
    assert len(limits) == 1


def test_a_car_that_cannot_drive_the_circle_has_no_limit(setup):
    force = setup.plant.car.force
    still = {
        name: dataclasses.replace(getattr(force, name), drive_n=0.0) for name in ('front', 'rear')
    }
    car = dataclasses.replace(setup.plant.car, force=dataclasses.replace(force, **still))
    plant = dataclasses.replace(setup.plant, car=car)
    assert plant_limit.held_lateral_limit(plant, 1.0) is None


def test_peaks_of_a_lane_change_reach_what_a_steady_turn_holds(setup):
    model = dataclasses.replace(setup.params.model, friction=0.7)
    params = dataclasses.replace(setup.params, model=model)
    drive = simulation.drive(setup._replace(friction=0.7, params=params))
    assert 0.9 < compute_metrics(drive)['lateral_limit_use_plant'] < 1.05


def test_a_row_that_leaves_it_out_and_a_road_with_patches_have_no_limit(setup):
    for known in (True, False):
        row = Row('double_lane_change', 'mpcc', knows_limit=known)
        assert (LATERAL_LIMIT in simulation.run_info(drive_row.prepare(row))) == known
    patches = Patches((0.0, -2.0, 50.0, -2.0, 50.0, 2.0, 0.0, 2.0), (0.3,))
    split = setup._replace(scn=setup.scn._replace(patches=patches))
    assert LATERAL_LIMIT not in simulation.run_info(split)
