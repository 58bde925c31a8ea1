"""The ranges of the contract include every state that a car can reach."""

import math

import numpy as np
import pytest

from msgs_yaml import conformance, encode
from msgs_yaml.types import Actuators, Imu, Obstacle, Obstacles, Prediction, VehicleState, Wheels

S = 1_000_000_000
SPEED = 100.0  # m/s, the fastest start of a scenario
FAR = 10_000.0 + 600.0 * SPEED  # m: from the end of the longest road, for the longest run
FOUR = (0.0,) * 4


def violations(topic, message):
    return [str(violation) for violation in conformance.check(topic, message)]


@pytest.mark.parametrize('degrees', range(0, 360, 15))
def test_a_car_that_slides_in_any_direction_at_full_speed_is_legal(degrees):
    slides = math.radians(degrees)
    state = VehicleState(
        S, 0.0, 0.0, 1.0, SPEED * math.cos(slides), SPEED * math.sin(slides), 4 * math.pi
    )
    assert not violations('/vehicle/odometry', encode.odometry(state))
    assert not violations('/vehicle/imu', encode.imu(Imu(S, -30.0, 30.0, -4 * math.pi)))


@pytest.mark.parametrize('sign', [-1, 1])
def test_a_car_and_an_obstacle_that_left_the_longest_road_are_legal(sign):
    state = VehicleState(S, sign * FAR, -sign * FAR, 1.0, SPEED, 0.0, 0.0)
    assert not violations('/vehicle/odometry', encode.odometry(state))
    crowd = Obstacles(S, (Obstacle(1, sign * FAR, -sign * FAR, 1.0, sign * SPEED, -sign * SPEED),))
    assert not violations('/scenario/obstacles', encode.obstacles(crowd))
    ahead = sign * np.array([FAR, FAR + 2.5 * SPEED])
    plan = Prediction(S, ahead, -ahead, np.zeros(2), np.array([0.0, 2.5]))
    assert not violations('/controller/prediction', encode.prediction(plan))


@pytest.mark.parametrize('sign', [-1, 1])
def test_wheels_that_turn_backwards_at_full_speed_are_legal(sign):
    spin = (sign * SPEED / 0.25,) * 4
    wheels = Wheels(S, spin, FOUR, FOUR, (sign * 20.0,) * 4, FOUR, (sign * math.pi / 2,) * 4, FOUR)
    assert not violations('/vehicle/wheels', encode.wheels(wheels))
    actuators = Actuators(S, sign * 0.6, 0.0, sign * 2e4, sign * 2e4, (sign * 6e3,) * 4)
    assert not violations('/vehicle/actuators', encode.actuators(actuators))


@pytest.mark.parametrize('bad', [math.nan, math.inf, -math.inf, 121.0, -121.0])
@pytest.mark.parametrize('field', ['vx', 'vy'])
def test_what_no_car_can_do_is_still_rejected(field, bad):
    state = VehicleState(S, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)._replace(**{field: bad})
    assert violations('/vehicle/odometry', encode.odometry(state))
