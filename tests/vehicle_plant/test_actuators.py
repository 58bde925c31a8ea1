"""Set-points between commands, their delay, and servos against the closed form."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from msgs_yaml.types import Command
from node_runtime import named_vector
from node_runtime.parameters import load
from vehicle_plant import integrator, parameters
from vehicle_plant.actuators import DelayLine, SetPointRamp
from vehicle_plant.car import add_delay
from vehicle_plant.initial_state import Start, rolling_state
from vehicle_plant.simulator import START_NS, Simulator
from vehicle_plant.state import SetPoints, State, join_trajectories

COLUMN = {name: i for i, name in enumerate(named_vector.names(State))}


def response(params, steps, target):
    x = rolling_state(params, Start(0.0, 0.0, 0.0, 15.0))
    set_points = np.tile(target, (steps + 1, 1))
    rows = integrator.advance(x, set_points, integrator.parameter_vector(params, 1.0))[1]
    return {name: rows[:, i] for name, i in COLUMN.items()}


def closed_form(t, w, zeta):
    """Unit step response of w^2 / (s^2 + 2 zeta w s + w^2), zeta < 1."""
    damped = w * np.sqrt(1 - zeta**2)
    swing = np.cos(damped * t) + zeta * w / damped * np.sin(damped * t)
    return 1 - np.exp(-zeta * w * t) * swing


def test_unsaturated_step_equals_the_closed_form(params):
    target = np.array([0.01, -200.0, 150.0])
    measured = response(params, 400, target)
    t = np.arange(1, 401) * 1e-3
    servos = {
        'steer': params.car.steering,
        'front': params.car.force.front,
        'rear': params.car.force.rear,
    }
    for (name, p), amount in zip(servos.items(), target):
        expected = closed_form(t, p.natural_frequency_radps, p.damping)
        error = measured[f'servos.{name}.position'] / amount - expected
        assert np.abs(error).max() < 1e-6


def test_rate_and_range_are_limited(params):
    measured = response(params, 1500, np.array([2.0, -90e3, 90e3]))
    steering, front, rear = params.car.steering, params.car.force.front, params.car.force.rear
    slack = 1 + 1e-9
    assert np.abs(measured['servos.steer.rate']).max() <= steering.rate_radps * slack
    assert np.abs(np.diff(measured['servos.front.position'])).max() <= front.rate_nps * 1e-3 * slack
    assert measured['servos.steer.position'].max() <= steering.limit_rad
    assert measured['servos.front.position'].min() >= -front.brake_n
    assert measured['servos.rear.position'].max() <= rear.drive_n
    assert measured['servos.steer.position'][-1] == pytest.approx(steering.limit_rad, rel=1e-3)


def test_full_steering_takes_as_long_as_the_rate_allows(params):
    measured = response(params, 1500, np.array([2.0, 0.0, 0.0]))['servos.steer.position']
    steering = params.car.steering
    nine_tenths = (np.argmax(measured >= 0.9 * steering.limit_rad) + 1) * 1e-3
    assert nine_tenths > 0.9 * steering.limit_rad / steering.rate_radps
    assert nine_tenths < 0.9 * steering.limit_rad / steering.rate_radps + 0.1


REST = SetPoints(0.0, 0.0, 0.0)


def test_set_points_move_in_a_straight_line_and_arrive_after_fifty_steps():
    ramp = SetPointRamp(REST)
    ramp.set_target(SetPoints(0.1, -5000.0, 500.0), 50)
    path = ramp.advance(50)
    assert path.shape == (51, 3)
    assert np.allclose(path, np.outer(np.linspace(0, 1, 51), [0.1, -5000.0, 500.0]), rtol=1e-15)
    assert path[-1].tolist() == [0.1, -5000.0, 500.0]


def test_set_points_are_held_once_reached():
    ramp = SetPointRamp(REST)
    ramp.set_target(SetPoints(0.1, 0.0, 0.0), 50)
    path = ramp.advance(120)
    assert (path[50:, 0] == 0.1).all()
    assert (ramp.advance(5)[:, 0] == 0.1).all()


def test_a_new_target_starts_at_the_present_set_points():
    ramp = SetPointRamp(REST)
    ramp.set_target(SetPoints(0.1, 0.0, 0.0), 50)
    ramp.advance(25)
    assert ramp.now.delta == 0.05
    ramp.set_target(SetPoints(0.0, 0.0, 0.0), 50)
    assert np.allclose(ramp.advance(50)[:, 0], np.linspace(0.05, 0.0, 51), atol=1e-17)


def test_a_late_target_is_due_by_its_stamp(params):
    """A command that arrives 20 ms after the state it answers has 30 ms left."""
    early = Simulator(params, 1.0, Start(0.0, 0.0, 0.0, 20.0))
    late = Simulator(params, 1.0, Start(0.0, 0.0, 0.0, 20.0))
    command = Command(START_NS, 0.02, 0.4, 0.0, 0.0)
    early.advance(command, 300)
    late.advance(None, 20)
    late.advance(command, 280)
    assert abs(early.actuators.delta - 0.02) < 1e-4
    assert abs(late.actuators.delta - 0.02) < 1e-4
    late_again = Simulator(params, 1.0, Start(0.0, 0.0, 0.0, 20.0))
    late_again.advance(None, 60)
    late_again.command(command)
    assert late_again.advance(None, 40).column('servos.steer.position')[-1] > 0.005


STEER_MS, FRONT_MS, REAR_MS = 15, 20, 7


@pytest.fixture
def late(params):
    car, force = params.car, params.car.force
    return replace(
        params,
        car=replace(
            car,
            steering=replace(car.steering, delay_ms=STEER_MS),
            force=replace(
                force,
                front=replace(force.front, delay_ms=FRONT_MS),
                rear=replace(force.rear, delay_ms=REAR_MS),
            ),
        ),
    )


def area(t, w, zeta):
    """Integral over time of the unit step response of w^2 / (s^2 + 2 zeta w s + w^2), zeta < 1."""
    damped = w * np.sqrt(1 - zeta**2)
    swing = np.exp(-zeta * w * t) * (
        2 * zeta * np.cos(damped * t) + (2 * zeta**2 - 1) * w / damped * np.sin(damped * t)
    )
    return np.where(t > 0, t - (2 * zeta - swing) / w, 0.0)


def test_response_to_a_command_is_the_delayed_closed_form(late):
    """A command due in 50 ms is a ramp of 50 ms; the answer to a ramp is a difference of areas."""
    target = SetPoints(0.01, -200.0, 150.0)
    car = Simulator(late, 1.0, Start(0.0, 0.0, 0.0, 15.0))
    track = join_trajectories([car.advance(Command(car.stamp_ns, target[0], 0.0, *target[1:]), 50)])
    track = join_trajectories([track, car.advance(None, 350)])
    t = np.arange(1, 401) * 1e-3
    servos = {
        'steer': (late.car.steering, STEER_MS),
        'front': (late.car.force.front, FRONT_MS),
        'rear': (late.car.force.rear, REAR_MS),
    }
    for (name, (p, delay_ms)), amount in zip(servos.items(), target):
        shape = (p.natural_frequency_radps, p.damping)
        since = t - delay_ms * 1e-3
        expected = (area(since, *shape) - area(since - 0.05, *shape)) / 0.05
        measured = track.column(f'servos.{name}.position') / amount
        assert np.abs(measured - expected).max() < 1e-6
        assert np.all(measured[:delay_ms] == 0.0)
        assert measured[delay_ms + 1] > 0.0


def test_delay_shifts_the_answer_and_nothing_else(params, late):
    """The steering of two cars at the same commands, bit by bit."""

    def steer(plant):
        car = Simulator(plant, 1.0, Start(0.0, 0.0, 0.0, 15.0))
        rng = np.random.default_rng(1)
        parts = [
            car.advance(Command(car.stamp_ns, rng.uniform(-0.03, 0.03), 0.0, 0.0, 0.0), 50)
            for _ in range(20)
        ]
        return join_trajectories(parts).column('servos.steer.position')

    assert np.array_equal(steer(late)[STEER_MS:], steer(params)[:-STEER_MS])


@settings(max_examples=40)
@given(
    st.tuples(*[st.integers(0, 12)] * 3),
    st.lists(st.integers(0, 9), min_size=1, max_size=8),
)
def test_delay_is_a_shift_of_samples_however_they_are_cut(delays, pieces):
    rng = np.random.default_rng(2)
    total = sum(pieces)
    samples = rng.normal(size=(total + 1, 3))
    held = SetPoints(*samples[0])
    line = DelayLine(SetPoints(*delays), held)
    begin, last, out = 0, samples[0], [samples[:1]]
    for n in pieces:
        late = line.shift(samples[begin : begin + n + 1])
        assert np.array_equal(late[0], last)
        out.append(late[1:])
        begin, last = begin + n, late[-1]
    measured = np.concatenate(out)
    for i, n in enumerate(delays):
        expected = np.concatenate([np.full(n, samples[0, i]), samples[:, i]])[: total + 1]
        assert np.array_equal(measured[:, i], expected)


def test_default_car_has_no_delay(params):
    car = params.car
    assert (car.steering.delay_ms, car.force.front.delay_ms, car.force.rear.delay_ms) == (0, 0, 0)


def test_a_delay_of_commands_shifts_every_actuator_by_exactly_as_much(params):
    late_ms, steps = 37, 400
    tracks = []
    for delay_ms in (0, late_ms):
        plant = replace(params, car=add_delay(params.car, delay_ms))
        car = Simulator(plant, 1.0, Start(0.0, 0.0, 0.0, 20.0))
        car.command(Command(car.stamp_ns, 0.05, 0.0, -3000.0, -2000.0))
        tracks.append(car.advance(None, steps).actuator_columns())
    prompt, late = tracks
    for now, later in zip(prompt[1:5], late[1:5]):
        assert np.array_equal(later[late_ms:], now[:-late_ms])
        assert np.all(later[:late_ms] == 0.0)
        assert np.any(now)


def test_the_parameter_of_the_node_delays_all_servos_beside_their_own():
    node = node_parameters(command_delay_ms=40)
    node = replace(node, car=replace(node.car, steering=replace(node.car.steering, delay_ms=5)))
    car = parameters.plant_params(node).car
    assert (car.steering.delay_ms, car.force.front.delay_ms, car.force.rear.delay_ms) == (
        45,
        40,
        40,
    )


def node_parameters(**changes):
    path = parameters.config_file(parameters.DEFAULT_CAR)
    return replace(load(parameters.NodeParams, path), **changes)
