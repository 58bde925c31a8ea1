"""Set-points from a plan and from straight braking."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mpcc_controller import single_track, stages, target
from mpcc_controller.shooting import Plan
from mpcc_controller.single_track import GRAVITY, Input, State
from mpcc_controller.target import SetPoints

quick = settings(deadline=None, derandomize=True, max_examples=100)
DT = 0.05


@pytest.fixture(scope='module')
def car(params, vehicle):
    return stages.car(params, vehicle)


def use(Fx, lambda_b, car):
    F, Fz = single_track.split(Fx, lambda_b, car), single_track.loads(Fx, car)
    return abs(float(F.f)) / (car.mu_f * Fz.f), abs(float(F.r)) / (car.mu_r * Fz.r)


@quick
@given(st.floats(-15000, 0), st.floats(0.4, 0.9))
def test_the_split_that_leaves_keeps_both_axles_within_the_friction(params, car, Fx, lambda_b):
    found = target.within_friction(lambda_b, Fx, car, params.limits)
    assert max(use(Fx, found, car)) <= params.limits.friction_use * (1 + 1e-9)
    if max(use(Fx, lambda_b, car)) <= params.limits.friction_use:
        assert found == pytest.approx(lambda_b)


def test_more_than_the_friction_is_shared_like_the_friction(params, car):
    front, rear = use(-25000.0, target.within_friction(0.6, -25000.0, car, params.limits), car)
    assert front == pytest.approx(rear)


def test_a_plan_is_followed_to_the_end_of_its_first_step(params, car):
    X, U = np.zeros((3, 9)), np.zeros((2, 4))
    X[1] = State(0, 0, 0, 20, 0, 0, 0, 0.02, -1000.0)
    U[0] = Input(0.4, -2e4, 0.55, 0)
    goal = target.of_plan(Plan(X, U), car, params.limits)
    command = target.command(goal, SetPoints(0.0, 0.0), car, DT, 7)
    assert command.stamp_ns == 7
    assert (command.delta, command.d_delta) == pytest.approx((0.02, 0.4))
    assert (command.Fxf, command.Fxr) == pytest.approx((-550.0, -450.0))


@quick
@given(st.floats(0, 30), st.floats(-0.5, 0.5))
def test_braking_keeps_room_for_the_lateral_force(params, car, world, vx, r):
    now = SetPoints(0.1, -16000.0)
    hardest = target.braking(world.rolling(v=vx, r=r), now, car, params.limits, 100.0)
    asked = np.hypot(hardest.Fx / (car.m * GRAVITY), vx * r / GRAVITY)
    limit = params.limits.friction_use * min(car.mu_f, car.mu_r)
    assert asked <= max(limit, abs(vx * r) / GRAVITY) + 1e-9
    assert hardest.Fx <= 0
    assert hardest.delta == 0


def test_braking_builds_up_at_the_rate_limits(params, car, world):
    now = SetPoints(0.3, 2000.0)
    first = target.braking(world.rolling(), now, car, params.limits, DT)
    assert first.Fx == pytest.approx(2000.0 - params.limits.force_rate_nps * DT)
    assert first.delta == pytest.approx(0.3 - params.limits.steer_rate_radps * DT)


def test_braking_without_a_known_yaw_rate_brakes(params, car, world):
    goal = target.braking(world.rolling(r=np.nan), SetPoints(0, 0), car, params.limits, DT)
    assert goal.Fx < 0
    assert np.isfinite(goal).all()
