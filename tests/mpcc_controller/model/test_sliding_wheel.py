"""Slip angles around 90 deg: a wheel that is dragged sideways."""

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mpcc_controller.model import single_track
from mpcc_controller.model.single_track import Input, State
from mpcc_controller.problem import stage_parameters


@pytest.fixture(scope='module')
def car(world):
    return stage_parameters.car(*world.load(model__low_speed=True))


@settings(max_examples=100)
@given(
    v=st.floats(8.0, 40.0),
    angle=st.floats(math.radians(65), math.radians(85)),
    delta=st.floats(-0.45, 0.45),
    side=st.sampled_from([-1, 1]),
)
def test_the_force_of_a_wheel_that_is_dragged_sideways_is_against_its_motion(
    car, v, angle, delta, side
):
    """Also beyond 90 deg, where the tangent of the slip angle changes its sign."""
    x = State(0, 0, 0, v * math.cos(angle), side * v * math.sin(angle), 0.0, 0.0, delta, 0.0)
    F = single_track.tyre_forces(x, Input(0.0, 0.0, 0.6, 0.0), car)
    Fz = single_track.loads(0.0, car)
    # the friction, and what the tangent that continues the Fiala curve adds (`tyre_switch`)
    assert 0.98 * car.mu_f * Fz.f < -side * float(F.F_yf) < 1.2 * car.mu_f * Fz.f
