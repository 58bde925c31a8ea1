"""Weights and limits that are changed between two steps, and the speeds at which a car stops."""

import dataclasses

import numpy as np
import pytest

from mpcc_controller import in_force, run_time_parameters
from mpcc_controller.driving.controller import Controller
from node_runtime import parameters
from node_runtime.parameters import ParameterError

CHANGES = {
    'tolerances.contouring_m': 0.25,
    'tolerances.lag_m': 0.8,
    'priorities.obstacle': 2000.0,
    'safety.obstacle_m': 0.8,
    'safety.edge_m': 0.3,
    'limits.steer_rad': 0.3,
    'limits.steer_rate_radps': 0.3,
    'limits.brake_n': 9000.0,
    'limits.force_rate_nps': 30000.0,
    'limits.friction_use': 0.8,
    'limits.brake_front_share_min': 0.5,
}


def bits(run):
    return [np.array(command).tobytes() for command in run.commands]


@pytest.fixture
def controller(params, vehicle, world):
    return world.set_inputs(Controller(params, vehicle), world.straight())


@pytest.mark.parametrize('name', ['mpcc', 'frenet'])
def test_a_changed_controller_drives_as_one_that_had_the_values_from_the_start(name, world):
    params, vehicle = world.load(name)
    before = dataclasses.asdict(params)
    changes = CHANGES if name == 'mpcc' else {k: v for k, v in CHANGES.items() if 'lag' not in k}
    other = run_time_parameters.change(params, changes)
    assert dataclasses.asdict(params) == before
    changed, new = Controller(params, vehicle), Controller(other, vehicle)
    situation = world.lane_change()
    first = world.drive(world.set_inputs(changed, situation), 15)
    changed.check_change(other)
    changed.change(other, changes)
    runs = [world.drive(world.set_inputs(each, situation), 15) for each in (changed, new)]
    assert bits(runs[0]) == bits(runs[1]) != bits(first)
    assert changed.params == new.params


def test_every_report_after_a_change_names_the_changed_values(controller, params, world):
    _, _, why = world.tick(controller, world.rolling())
    assert run_time_parameters.reported(why.values) == {}
    changes = {'tolerances.lag_m': 0.7}
    controller.change(run_time_parameters.change(params, changes), changes)
    _, _, why = world.tick(controller, world.rolling(stamp_ns=50_000_000, X=1.0))
    assert run_time_parameters.reported(why.values) == changes
    assert why.values['weight.lag'] == pytest.approx(0.7**-2)


def test_the_names_are_the_numbers_of_weights_and_limits_that_have_a_value(params):
    names, values = run_time_parameters.names(params), parameters.flatten(params)
    assert {'tolerances.lag_m', 'priorities.edge', 'safety.edge_m', 'limits.brake_n'} <= names
    assert not any(values[name] is None or isinstance(values[name], bool) for name in names)
    assert not {'safety.fit_edges', 'tolerances.lateral_jerk_mps3', 'model.friction'} & names


@pytest.mark.parametrize(
    ('changes', 'error'),
    [
        ({'tolerances.lag_m': 0.0}, '^set: tolerances.lag_m: is 0.0; allowed 0.001'),
        ({'tolerances.lag_m': float('nan')}, '^set: tolerances.lag_m: must be finite'),
        ({'tolerances.lag_m': None}, '^set: tolerances.lag_m: must be a number, is None'),
        (
            {'limits.brake_front_share_min': 0.95},
            '^set: .* is 0.95, above limits.brake_front_share_max, 0.9',
        ),
        ({'model.friction': 0.5}, 'model.friction: cannot be changed while .* allowed tolerances'),
        ({'tolerances.lateral_jerk_mps3': 5.0}, 'with a value at the start'),
        # without effect, or below the present command
        ({'limits.brake_n': 9e4}, 'limits.brake_n: is 90000; allowed up to .* which the car can'),
        ({'tolerances.heading_rad': 0.1}, 'tolerances.heading_rad: has no effect, the term'),
        ({'limits.steer_rad': 0.25}, 'limits.steer_rad: is 0.25, and the present command is 0.3'),
        ({'limits.brake_n': 0.0}, 'limits.brake_n: is 0; allowed from 8500, 0.5 of its value'),
        ({'limits.force_rate_nps': 10.0}, 'limits.force_rate_nps: is 10; allowed from 20000'),
        ({'limits.friction_use': 0.4}, 'limits.friction_use: is 0.4; allowed from 0.475'),
    ],
)
def test_a_change_that_is_not_allowed_is_refused_with_its_name_and_range(
    controller, params, changes, error
):
    controller.set_last_command(controller.memory.last._replace(delta=0.3))
    with pytest.raises(ParameterError, match=error):
        controller.check_change(run_time_parameters.change(params, changes))


def test_a_limit_that_the_model_fixes_is_refused(vehicle, world):
    params, _ = world.load(model__low_speed=True)
    asked = run_time_parameters.change(params, {'limits.least_speed_mps': 5.0})
    with pytest.raises(ParameterError, match=r'limits.least_speed_mps: has no effect.*fix it at 0'):
        run_time_parameters.check_effect(asked, ('limits.least_speed_mps',), vehicle, ())


def test_no_change_weakens_the_braking_without_a_plan(params, controller, world):
    gentle = {'limits.brake_n': 8500.0, 'limits.force_rate_nps': 20000.0}
    stops = []
    for changes in ({}, gentle):
        change = run_time_parameters.change(params, changes)
        world.set_inputs(controller, world.straight())
        controller.check_change(change)
        controller.change(change, {})
        for k in range(20):
            x = world.rolling(X=20 + k, stamp_ns=k * 50_000_000)
            stops.append(world.tick(controller, x, fault='reference_stale')[0])
        assert not controller.memory.rejections
    assert stops[:20] == stops[20:]
    assert stops[-1].Fxf + stops[-1].Fxr < -14000.0
    # plans begin there, and come back within the limit
    values = world.tick(controller, world.rolling(X=40, stamp_ns=20 * 50_000_000))[2].values
    assert values['rung'] == 'solved'


def test_a_share_of_the_brakes_is_refused_where_the_split_is_free(world):
    changes = {'formulation__brake_split': 'free', 'formulation__brake_front_share': 0.6}
    with pytest.raises(ParameterError, match=r'brake_front_share: is 0\.6, .*allowed with fixed'):
        in_force.in_force(*world.load(**changes))


@pytest.mark.parametrize(
    ('speed', 'minimum', 'relation'),
    [
        (6.98, 7.0, in_force.BELOW),
        (6.995, 7.0, in_force.NEAR),  # a desired speed is rounded
        (7.505, 7.0, in_force.NEAR),
        (7.52, 7.0, ''),
        (0.0, 0.0, ''),
    ],
)
def test_a_speed_is_compared_with_the_least_one_by_a_margin(speed, minimum, relation):
    assert in_force.compare_speed(speed, minimum, 0.5) == relation
