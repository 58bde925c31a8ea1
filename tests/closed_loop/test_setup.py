"""A drive in process is set up as `experiments run` would set it up."""

import numpy as np
import pytest

from bags.errors import BagError
from experiments import simulation


def test_a_simulation_without_settings_uses_the_files(simulated):
    _, recorded = simulated.drive('double_lane_change', 'mpcc')
    again = simulation.drive(simulation.prepare('double_lane_change', 'mpcc'))
    assert np.array_equal(again.motion.x, recorded.motion.x)
    assert np.array_equal(again.inputs.force, recorded.inputs.force)
    assert again.facts == recorded.facts


def test_a_drive_that_is_not_explained_is_the_same_drive(simulated):
    explained, _ = simulated.drive('double_lane_change', 'mpcc')
    brief = simulation.run(simulation.prepare('double_lane_change', 'mpcc'), explain=False)
    assert set(explained) - set(brief) == {'/controller/prediction'}
    for topic in ('/vehicle/odometry', '/vehicle/wheels', '/controller/command'):
        for own, other in zip(brief[topic], explained[topic]):
            assert np.array_equal(own, other), topic
    reports = (brief['/controller/why'].values, explained['/controller/why'].values)
    for own, other in zip(*reports, strict=True):
        assert own._replace(values={}) == other._replace(values={})
        timeless = {name: v for name, v in own.values.items() if not name.startswith('time.')}
        assert timeless == {name: other.values[name] for name in timeless}
        assert {'solver.iterations', 'gate', 'theta'} <= set(own.values) < set(other.values)


def test_settings_reach_controller_and_plant():
    settings = {'controller': {'tolerances.lag_m': 0.3}, 'plant': {'friction': 0.95}}
    made = simulation.prepare('double_lane_change', 'frenet', settings)
    assert made.params.tolerances.lag_m == 0.3
    assert made.params.model.friction == 1.0
    assert made.friction == 0.95


def test_another_speed_is_that_of_path_and_start():
    made = simulation.prepare('double_lane_change', 'mpcc', speed_mps=18.0)
    assert made.scn.start.speed == pytest.approx(18.0)


@pytest.mark.parametrize('role', ['controller', 'plant'])
def test_a_setting_that_does_not_exist_is_named(role):
    with pytest.raises(BagError, match=r'tolerances\.lag'):
        simulation.prepare('double_lane_change', 'mpcc', {role: {'tolerances.lag': 0.3}})


@pytest.mark.parametrize(
    'setting',
    [
        {'patches.friction': [0.3]},
        {'start.speed_mps': 10.0},
        {'stop.time_s': 1.0},
        {'command_age_s': 0.2},
    ],
    ids=lambda setting: next(iter(setting)),
)
def test_a_setting_of_the_plant_without_effect_is_refused(setting):
    (name,) = setting
    with pytest.raises(
        BagError, match=rf'plant\.{name} has no effect .*friction, .*tyre_set.*car\.'
    ):
        simulation.prepare('double_lane_change', 'mpcc', {'plant': setting})


def test_settings_of_the_car_and_its_tyre_take_effect():
    heavy = simulation.prepare(
        'double_lane_change',
        'mpcc',
        {'plant': {'car.body.mass_kg': 2000.0, 'tyre_set': 'tyre_245_40r18.yaml'}},
    )
    usual = simulation.prepare('double_lane_change', 'mpcc')
    assert heavy.plant.car.body.mass_kg == 2000.0
    assert heavy.plant.tyre != usual.plant.tyre
