"""Set-points between commands, their delay, and servos against the closed form."""

import numpy as np
import pytest
from drives import ahead, altered, drive, load
from hypothesis import given, settings
from hypothesis import strategies as st

from msgs_yaml.types import Command
from vehicle_plant import identify, parameters
from vehicle_plant.actuators import DelayLine
from vehicle_plant.simulator import Simulator
from vehicle_plant.state import SetPoints, join_trajectories

DELAYS_MS = {'steer': 15, 'front': 20, 'rear': 7}


@pytest.fixture(scope='module')
def late(params):
    return altered(
        params,
        car__steering__delay_ms=DELAYS_MS['steer'],
        car__force__front__delay_ms=DELAYS_MS['front'],
        car__force__rear__delay_ms=DELAYS_MS['rear'],
    )


def servos(plant):
    force = plant.car.force
    return {'steer': plant.car.steering, 'front': force.front, 'rear': force.rear}


def area(t, w, zeta):
    """Integral over time of the unit step response of w^2 / (s^2 + 2 zeta w s + w^2), zeta < 1."""
    damped = w * np.sqrt(1 - zeta**2)
    swing = np.exp(-zeta * w * t) * (
        2 * zeta * np.cos(damped * t) + (2 * zeta**2 - 1) * w / damped * np.sin(damped * t)
    )
    return np.where(t > 0, t - (2 * zeta - swing) / w, 0.0)


@pytest.mark.parametrize(('arrives_ms', 'ramp_ms'), [(0, 50), (20, 30), (49, 1), (60, 1)])
def test_response_to_a_command_is_the_delayed_closed_form(late, arrives_ms, ramp_ms):
    """A command is due a tick after its stamp, one that comes later at the next step.

    Until then it is a ramp; the answer to a ramp is a difference of areas.
    """
    target = SetPoints(0.01, -200.0, 150.0)
    car = Simulator(late, 1.0, ahead(15.0))
    command = Command(car.stamp_ns, target[0], 0.0, *target[1:])
    track = join_trajectories([car.advance(None, arrives_ms), car.advance(command, 400)])
    t = np.arange(1, len(track.rows) + 1) * 1e-3
    for (name, p), amount in zip(servos(late).items(), target):
        shape, begin_ms = (p.natural_frequency_radps, p.damping), arrives_ms + DELAYS_MS[name]
        since, ramp_s = t - begin_ms * 1e-3, ramp_ms * 1e-3
        expected = (area(since, *shape) - area(since - ramp_s, *shape)) / ramp_s
        measured = track.column(f'servos.{name}.position') / amount
        assert np.abs(measured - expected).max() < 1e-6
        assert np.all(measured[:begin_ms] == 0.0)
        assert measured[begin_ms + 1] > 0.0


@pytest.mark.parametrize('car', ['bmw_330i.yaml', 'bmw_545i.yaml', 'vw_gti.yaml'])
def test_on_a_ramp_a_servo_is_behind_by_twice_its_damping_over_its_frequency(car):
    """And by its delay, which is part of the lag."""
    plant = altered(load(car), car__steering__delay_ms=30)
    lags = identify.servo_lags(plant, 1.0)
    for measured, p in zip(lags, (plant.car.steering, plant.car.force.front)):
        expected = 2 * p.damping / p.natural_frequency_radps + p.delay_ms / 1e3
        assert measured == pytest.approx(expected, abs=2e-4)


def test_rate_and_range_are_limited_and_reached(params):
    """Full steering takes as long as the rate allows."""
    tolerance = {'steer_tolerance_rad': 9.0, 'force_tolerance_n': 1e6}
    wide = altered(params, **{f'car__gate__{name}': value for name, value in tolerance.items()})
    track = drive(lambda t, car: (2.0, -90e3, 90e3), 1.5, 15.0, wide)
    steering, front, rear = servos(params).values()
    angle, brake, force = (track.column(f'servos.{name}.position') for name in servos(params))
    slack = 1 + 1e-9
    assert np.abs(track.column('servos.steer.rate')).max() <= steering.rate_radps * slack
    assert np.abs(np.diff(brake)).max() <= front.rate_nps * 1e-3 * slack
    for values, limit in ((angle, steering.limit_rad), (-brake, front.brake_n)):
        assert values.max() <= limit
        assert values[-1] == pytest.approx(limit, rel=1e-3)
    assert force.max() <= rear.drive_n
    nine_tenths = (np.argmax(angle >= 0.9 * steering.limit_rad) + 1) * 1e-3
    fastest = 0.9 * steering.limit_rad / steering.rate_radps
    assert fastest < nine_tenths < fastest + 0.15


@settings(max_examples=40)
@given(
    st.tuples(*[st.integers(0, 12)] * 3),
    st.lists(st.integers(0, 9), min_size=1, max_size=8),
)
def test_delay_is_a_shift_of_samples_however_they_are_cut(delays, pieces):
    samples = np.random.default_rng(2).normal(size=(sum(pieces) + 1, 3))
    line = DelayLine(SetPoints(*delays), SetPoints(*samples[0]))
    begin, last, out = 0, samples[0], [samples[:1]]
    for n in pieces:
        shifted = line.shift(samples[begin : begin + n + 1])
        assert np.array_equal(shifted[0], last)
        out.append(shifted[1:])
        begin, last = begin + n, shifted[-1]
    measured = np.concatenate(out)
    for i, n in enumerate(delays):
        expected = np.concatenate([np.full(n, samples[0, i]), samples[:, i]])[: len(samples)]
        assert np.array_equal(measured[:, i], expected)


def test_the_parameter_of_the_node_delays_all_servos_beside_their_own(params):
    assert {p.delay_ms for p in servos(params).values()} == {0}
    path = parameters.config_file(parameters.DEFAULT_CAR)
    node = parameters.parameters.load(parameters.NodeParams, path)
    node = altered(node, command_delay_ms=40, car__steering__delay_ms=5)
    delays = [p.delay_ms for p in servos(parameters.plant_params(node)).values()]
    assert delays == [45, 40, 40]
