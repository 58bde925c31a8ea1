"""The initial state: what a car that slides and turns begins with."""

import numpy as np
import pytest

from msgs_yaml.types import WHEELS
from node_runtime import named_vector
from vehicle_plant.initial_state import Start, rolling_state
from vehicle_plant.simulator import Simulator
from vehicle_plant.state import State


def named(params, start):
    return dict(zip(named_vector.names(State), rolling_state(params, start)))


def test_a_car_that_rolls_straight_ahead_has_no_slip(params):
    x = named(params, Start(1.0, 2.0, 0.3, 20.0))
    assert [x[f'planar.{name}'] for name in ('X', 'Y', 'psi', 'vx', 'vy', 'r')] == [
        *(1.0, 2.0, 0.3, 20.0),
        *(0.0, 0.0),
    ]
    assert {x[f'wheels.{w}.omega'] for w in WHEELS} == {20.0 / params.car.wheel.radius_m}
    assert {x[f'wheels.{w}.tan_alpha'] for w in WHEELS} == {0.0}


def test_wheels_of_a_sliding_car_roll_and_slip_as_their_contact_patches_move(params):
    """The velocity of a point of a rigid body: v + r x position."""
    vx, vy, r = 20.0, -6.0, 0.8
    x, body = named(params, Start(0.0, 0.0, 0.0, vx, vy, r)), params.car.body
    axles = {'f': body.cog_to_front_m, 'r': -body.cog_to_rear_m}
    for w in WHEELS:
        half = vx - x[f'wheels.{w}.omega'] * params.car.wheel.radius_m  # y r
        assert np.sign(half) == {'l': 1, 'r': -1}[w[1]]
        assert 0.6 < abs(half) / r < 0.9  # half of the track, m
        slip = (vy + axles[w[0]] * r) / (vx - half)
        assert x[f'wheels.{w}.tan_alpha'] == pytest.approx(slip)


def test_the_lateral_force_of_a_sliding_start_does_not_have_to_build_up(params):
    car = Simulator(params, 1.0, Start(0.0, 0.0, 0.0, 25.0, 5.0, 0.0))
    ay = car.advance(None, 100).imu_columns().ay
    assert -1.15 * 9.81 < ay[0] < -0.9 * 9.81
    assert ay[0] == pytest.approx(ay.min(), rel=0.25)
