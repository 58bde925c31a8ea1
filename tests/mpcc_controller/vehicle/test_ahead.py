"""The state when the command takes hold."""

import pytest

from mpcc_controller import ahead, stages
from mpcc_controller.target import SetPoints


def test_without_a_lead_the_state_stays_as_it_is(params, vehicle, world):
    x = world.rolling(r=0.1)
    assert ahead.make(stages.car(params, vehicle), 0.0)(x, SetPoints(0.1, 0.0)) == x


def test_the_lead_is_the_motion_of_the_model_with_its_set_points_held(params, vehicle, world):
    car = stages.car(params, vehicle)
    x = world.rolling(stamp_ns=7, r=0.2, vy=-0.1)
    moved = ahead.make(car, 0.01)(x, SetPoints(0.05, -4000.0))
    assert moved.stamp_ns == 7 + 10_000_000
    assert pytest.approx(0.2, abs=1e-3) == moved.X
    assert moved.psi == pytest.approx(0.002, abs=1e-4)
    braking = (-4000.0 - car.drag * 400 - car.rolling) / car.m
    assert moved.vx - x.vx == pytest.approx(0.01 * braking, rel=0.2)
    assert moved.r > x.r
