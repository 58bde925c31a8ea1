"""Setpoints from a plan."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mpcc_controller.driving import setpoints
from mpcc_controller.driving.setpoints import Setpoints
from mpcc_controller.model import single_track
from mpcc_controller.model.single_track import Input, State
from stage_solver.stage_problem import Plan

quick = settings(max_examples=100)
DT = 0.05


def use(Fx, lambda_b, car):
    F, Fz = single_track.split(Fx, lambda_b, car), single_track.loads(Fx, car)
    return abs(float(F.f)) / (car.mu_f * Fz.f), abs(float(F.r)) / (car.mu_r * Fz.r)


@quick
@given(st.floats(-15000, 0), st.floats(0.4, 0.9))
def test_the_limited_split_keeps_both_axles_within_the_friction(params, car, Fx, lambda_b):
    limited = setpoints.split_within_friction(lambda_b, Fx, car, params.limits)
    assert max(use(Fx, limited, car)) <= params.limits.friction_use * (1 + 1e-9)
    if max(use(Fx, lambda_b, car)) <= params.limits.friction_use:
        assert limited == pytest.approx(lambda_b)


def test_a_force_beyond_the_friction_is_split_like_the_friction(params, car):
    front, rear = use(
        -25000.0, setpoints.split_within_friction(0.6, -25000.0, car, params.limits), car
    )
    assert front == pytest.approx(rear)


def test_the_target_of_a_plan_is_the_end_of_its_first_step(params, car):
    X, U = np.zeros((3, 9)), np.zeros((2, 4))
    X[1] = State(0, 0, 0, 20, 0, 0, 0, 0.02, -1000.0)
    U[0] = Input(0.4, -2e4, 0.55, 0)
    target = setpoints.target_of_plan(Plan(X, U), car, params.limits)
    command = setpoints.command_to(target, Setpoints(0.0, 0.0), car, DT, 7)
    assert command.stamp_ns == 7
    assert (command.delta, command.d_delta) == pytest.approx((0.02, 0.4))
    assert (command.Fxf, command.Fxr) == pytest.approx((-550.0, -450.0))
