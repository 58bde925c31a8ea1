"""Servos against the closed form of a second-order system."""

import numpy as np
import pytest

from node_runtime import named_vector
from vehicle_plant import integrator
from vehicle_plant.initial_state import Start, rolling_state
from vehicle_plant.state import State

COLUMN = {name: i for i, name in enumerate(named_vector.names(State))}


def response(params, steps, target):
    x = rolling_state(params, Start(0.0, 0.0, 0.0, 15.0))
    set_points = np.tile(target, (steps + 1, 1))
    rows = integrator.advance(x, set_points, integrator.parameter_vector(params, 1.0))
    return {name: rows[:, i] for name, i in COLUMN.items()}


def closed_form(t, w, zeta):
    """Unit step response of w^2 / (s^2 + 2 zeta w s + w^2), zeta < 1."""
    damped = w * np.sqrt(1 - zeta**2)
    swing = np.cos(damped * t) + zeta * w / damped * np.sin(damped * t)
    return 1 - np.exp(-zeta * w * t) * swing


def test_unsaturated_step_equals_the_closed_form(params):
    target = np.array([0.01, -200.0, 150.0])
    found = response(params, 400, target)
    t = np.arange(1, 401) * 1e-3
    servos = {
        'steer': params.car.steering,
        'front': params.car.force.front,
        'rear': params.car.force.rear,
    }
    for (name, p), amount in zip(servos.items(), target):
        expected = closed_form(t, p.natural_frequency_radps, p.damping)
        error = found[f'servos.{name}.position'] / amount - expected
        assert np.abs(error).max() < 1e-6


def test_rate_and_range_are_limited(params):
    found = response(params, 1500, np.array([2.0, -90e3, 90e3]))
    steering, front, rear = params.car.steering, params.car.force.front, params.car.force.rear
    slack = 1 + 1e-9
    assert np.abs(found['servos.steer.rate']).max() <= steering.rate_radps * slack
    assert np.abs(np.diff(found['servos.front.position'])).max() <= front.rate_nps * 1e-3 * slack
    assert found['servos.steer.position'].max() <= steering.limit_rad
    assert found['servos.front.position'].min() >= -front.brake_n
    assert found['servos.rear.position'].max() <= rear.drive_n
    assert found['servos.steer.position'][-1] == pytest.approx(steering.limit_rad, rel=1e-3)


def test_full_steering_takes_as_long_as_the_rate_allows(params):
    found = response(params, 1500, np.array([2.0, 0.0, 0.0]))['servos.steer.position']
    steering = params.car.steering
    nine_tenths = (np.argmax(found >= 0.9 * steering.limit_rad) + 1) * 1e-3
    assert nine_tenths > 0.9 * steering.limit_rad / steering.rate_radps
    assert nine_tenths < 0.9 * steering.limit_rad / steering.rate_radps + 0.1
