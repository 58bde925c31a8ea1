"""Pure delay before the servos: exact, per actuator, and none unless asked for."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from msgs_yaml.types import Command
from vehicle_plant.actuators import DelayLine, DelaySteps
from vehicle_plant.initial_state import Start
from vehicle_plant.simulator import Simulator
from vehicle_plant.state import SetPoints, join_trajectories

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


def test_answer_to_a_command_is_the_late_closed_form(late):
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
        found = track.column(f'servos.{name}.position') / amount
        assert np.abs(found - expected).max() < 1e-6
        assert np.all(found[:delay_ms] == 0.0)
        assert found[delay_ms + 1] > 0.0


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


@settings(max_examples=40, deadline=None, derandomize=True)
@given(
    st.tuples(*[st.integers(0, 12)] * 3),
    st.lists(st.integers(0, 9), min_size=1, max_size=8),
)
def test_delay_is_a_shift_of_samples_however_they_are_cut(delays, pieces):
    rng = np.random.default_rng(2)
    total = sum(pieces)
    samples = rng.normal(size=(total + 1, 3))
    held = SetPoints(*samples[0])
    line = DelayLine(DelaySteps(*delays), held)
    begin, last, out = 0, samples[0], [samples[:1]]
    for n in pieces:
        late = line.shift(samples[begin : begin + n + 1])
        assert np.array_equal(late[0], last)
        out.append(late[1:])
        begin, last = begin + n, late[-1]
    found = np.concatenate(out)
    for i, n in enumerate(delays):
        expected = np.concatenate([np.full(n, samples[0, i]), samples[:, i]])[: total + 1]
        assert np.array_equal(found[:, i], expected)


def test_default_car_has_no_delay(params):
    car = params.car
    assert (car.steering.delay_ms, car.force.front.delay_ms, car.force.rear.delay_ms) == (0, 0, 0)
