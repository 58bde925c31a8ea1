"""Fiala tyre inside its friction circle."""

import math

import casadi as ca
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mpcc_controller.model import fiala

C, FZ, MU = 140e3, 9000.0, 0.9
CAPACITY = MU * FZ
quick = settings(max_examples=200)


def plain_fiala(alpha, Fx=0.0):
    """Return the lateral force as the literature writes it, with its two cases."""
    F_max = math.sqrt((MU * FZ) ** 2 - Fx**2)
    z = math.tan(alpha)
    if abs(z) >= 3 * F_max / C:
        return -F_max * math.copysign(1, alpha)
    return -C * z + C**2 / (3 * F_max) * abs(z) * z - C**3 / (27 * F_max**2) * z**3


@quick
@given(st.floats(-0.6, 0.6), st.floats(-0.9, 0.9))
def test_without_tangent_the_force_is_the_plain_fiala_force(alpha, share):
    Fx = share * CAPACITY
    capacity = fiala.lateral_capacity(Fx, FZ, MU)
    force = fiala.lateral_force(math.tan(alpha), capacity, C, 1.0)
    assert force == pytest.approx(plain_fiala(alpha, Fx), abs=1e-6)


@quick
@given(st.floats(-1.0, 1.0), st.floats(-1e5, 1e5))
def test_tyre_force_never_leaves_the_friction_circle(tan_alpha, demand):
    Fx = fiala.longitudinal_force(demand, FZ, MU)
    Fy = fiala.lateral_force(tan_alpha, fiala.lateral_capacity(Fx, FZ, MU), C, 1.0)
    assert math.hypot(Fx, Fy) <= CAPACITY * (1 + 1e-12)


@quick
@given(st.floats(-0.36, 0.36), st.floats(-1e5, 1e5))
def test_the_tangent_exceeds_the_friction_circle_by_less_than_the_uncertainty_of_friction(
    tan_alpha, demand
):
    Fx = fiala.longitudinal_force(demand, FZ, MU)
    capacity = fiala.lateral_capacity(Fx, FZ, MU)
    Fy = fiala.lateral_force(tan_alpha, capacity, C, 0.95)
    beyond = 3 * (1 - 0.95) ** 2 * abs(C * tan_alpha / (3 * capacity))
    assert abs(Fy) <= capacity * (1 + beyond)
    assert math.hypot(Fx, Fy) <= 1.02 * CAPACITY


@pytest.mark.parametrize('side', [-1, 0, 1])
def test_slope_at_zero_slip_is_the_cornering_stiffness(side):
    z = ca.SX.sym('z')
    slope = ca.Function('slope', [z], [ca.gradient(fiala.lateral_force(z, CAPACITY, C, 0.95), z)])
    assert float(slope(side * 1e-9)) == pytest.approx(-C, rel=1e-6)


def test_gradient_does_not_vanish_while_sliding():
    z = ca.SX.sym('z')
    slope = ca.Function('slope', [z], [ca.gradient(fiala.lateral_force(z, CAPACITY, C, 0.95), z)])
    assert float(slope(1.0)) == pytest.approx(-C * (1 - 0.95) ** 2)


def test_the_tangent_continues_the_curve_without_a_kink():
    z = ca.SX.sym('z')
    force = fiala.lateral_force(z, CAPACITY, C, 0.95)
    both = ca.Function('both', [z], [force, ca.gradient(force, z)])
    switch = 0.95 * 3 * CAPACITY / C
    before, after = both(switch * (1 - 1e-9)), both(switch * (1 + 1e-9))
    assert float(before[0]) == pytest.approx(float(after[0]), rel=1e-6)
    assert float(before[1]) == pytest.approx(float(after[1]), rel=1e-5)


def test_a_wheel_within_its_friction_delivers_the_demanded_force():
    for share in (-0.95, -0.5, 0.0, 0.5, 0.95):
        demand = share * CAPACITY
        assert fiala.longitudinal_force(demand, FZ, MU) == pytest.approx(
            demand, abs=3e-3 * CAPACITY
        )


def test_a_locked_wheel_delivers_no_more_than_its_friction():
    assert -CAPACITY < fiala.longitudinal_force(-1e6, FZ, MU) < -0.98 * CAPACITY
