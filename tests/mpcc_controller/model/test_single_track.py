"""Single track against an independent transcription and general properties of a car."""

import math

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import optimize

from mpcc_controller.model import fiala, single_track
from mpcc_controller.model.single_track import Input, State

quick = settings(max_examples=60)
DT = 0.05
states = st.builds(
    State,
    X=st.floats(-100, 100),
    Y=st.floats(-100, 100),
    psi=st.floats(-3, 3),
    vx=st.floats(3, 30),
    vy=st.floats(-2, 2),
    r=st.floats(-0.8, 0.8),
    theta=st.floats(0, 100),
    delta=st.floats(-0.3, 0.3),
    Fx=st.floats(-20000, 20000),
)
inputs = st.builds(
    Input, st.floats(-0.5, 0.5), st.floats(-3e4, 3e4), st.floats(0.4, 0.9), st.just(0.0)
)


def transcribed(x, u, c):
    """Return dx/dt written independently from the paper's eq. 1 and 2, and Fiala's cases."""
    delta, force = x.delta - c.steer_lag * u.d_delta, x.Fx - c.force_lag * u.d_Fx
    L, g = c.l_f + c.l_r, 9.81
    Fz = ((c.m * g * c.l_r - c.h * force) / L, (c.m * g * c.l_f + c.h * force) / L)
    part = 0.5 + 0.5 * math.tanh(force / c.force_blend)
    front = part * c.lambda_d + (1 - part) * u.lambda_b
    v = c.v_slip + (x.vx - c.v_slip + math.hypot(x.vx - c.v_slip, 0.5)) / 2
    slips = math.atan((x.vy + c.l_f * x.r) / v) - delta, math.atan((x.vy - c.l_r * x.r) / v)
    forces = []
    for demand, load, mu, C, alpha in zip(
        (front * force, (1 - front) * force), Fz, (c.mu_f, c.mu_r), (c.C_f, c.C_r), slips
    ):
        M = 0.99 * mu * load
        e = 0.02 * M
        Fx = 0.5 * (math.hypot(demand + M, e) - math.hypot(demand - M, e))
        F_max = math.sqrt((mu * load) ** 2 - Fx**2)
        z, xi = math.tan(alpha), c.tyre_switch

        def lateral(z, C=C, F_max=F_max, xi=xi):
            if abs(z) < 3 * xi * F_max / C:
                return -C * z + C**2 * abs(z) * z / (3 * F_max) - C**3 * z**3 / (27 * F_max**2)
            return -C * (1 - xi) ** 2 * z - F_max * (3 * xi**2 - 2 * xi**3) * math.copysign(1, z)

        if not forces and c.compliance:  # of the front axle
            z = optimize.brentq(lambda left, z=z: left - c.compliance * lateral(left) - z, -4, 4)
        forces.append((Fx, lateral(z)))
    (Fxf, Fyf), (Fxr, Fyr) = forces
    delta -= c.compliance * Fyf
    sin, cos = math.sin(delta), math.cos(delta)
    drag = c.drag * x.vx**2 + c.rolling
    return (
        x.vx * math.cos(x.psi) - x.vy * math.sin(x.psi),
        x.vx * math.sin(x.psi) + x.vy * math.cos(x.psi),
        x.r,
        (-Fyf * sin + Fxf * cos + Fxr - drag) / c.m + x.r * x.vy,
        (Fyf * cos + Fxf * sin + Fyr) / c.m - x.r * x.vx,
        (c.l_f * Fyf * cos + c.l_f * Fxf * sin - c.l_r * Fyr) / c.Izz,
        math.hypot(x.vx, x.vy),
        u.d_delta,
        u.d_Fx,
    )


@pytest.mark.parametrize('more', [{}, {'steer_lag': 0.05, 'force_lag': 0.07}, {'compliance': 1e-5}])
@settings(max_examples=80)
@given(states, inputs)
def test_a_step_is_the_midpoint_rule_on_an_independent_transcription(car, more, x, u):
    car = car._replace(**more)
    first = np.array(transcribed(x, u, car))
    second = transcribed(State(*(x + DT / 2 * first)), u, car)
    after = single_track.step(DT, single_track.structure(car))(x, u, car).full().ravel()
    assert (after - x) / DT == pytest.approx(second, rel=1e-6, abs=1e-5)


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
    car = car._replace(kinematic_below=5.0)
    x = State(0, 0, 0, v * math.cos(angle), side * v * math.sin(angle), 0.0, 0.0, delta, 0.0)
    F = single_track.tyre_forces(x, Input(0.0, 0.0, 0.6, 0.0), car)
    friction = car.mu_f * single_track.loads(0.0, car).f
    # the friction, and what the tangent that continues the Fiala curve adds (`tyre_switch`)
    assert 0.98 * friction < -side * float(F.F_yf) < 1.2 * friction


soft_tyres = {
    'tan_alpha': st.floats(-4.0, 4.0),
    'capacity': st.floats(50.0, 2e4),
    'C': st.floats(2e4, 1e6),
    'switch': st.floats(0.5, 1.0),
    'compliance': st.floats(1e-9, 1e-4),
}


@quick
@given(**soft_tyres)
def test_its_slope_is_that_of_springs_in_series(tan_alpha, capacity, C, switch, compliance):
    """dF/dz = F' / (1 + c F'), also at the slip 0, where |s| has a corner."""
    z = ca.SX.sym('z')
    left = fiala.remaining_slip(z, capacity, C, switch, compliance)
    both = ca.Function('f', [z], [left, fiala.lateral_force(left, capacity, C, switch)])
    slope = both.factory('df', ['i0'], ['jac:o1:i0'])
    for at in (0.0, tan_alpha):
        s = min(abs(C * float(both(at)[0]) / (3 * capacity)), switch)
        tyre = C * (1 - s) ** 2
        series = tyre / (1 + compliance * tyre)
        assert float(slope(at)) == pytest.approx(-series, rel=1e-6, abs=1e-6)
        h = 1e-6 * (capacity / C + abs(at))
        ends = [float(both(at + d)[1]) for d in (h, -h)]
        near = max(abs(float(slope(at + d)) - float(slope(at))) for d in (h, -h))
        found = (ends[0] - ends[1]) / (2 * h)
        assert found == pytest.approx(float(slope(at)), abs=near + 1e-6 * C)


@quick
@given(st.floats(-16000, 6000), st.floats(0.4, 0.9), st.floats(0.0, 1.0))
def test_braking_is_split_and_driving_goes_to_the_driven_axles(car, Fx, lambda_b, lambda_d):
    car = car._replace(lambda_d=lambda_d)
    front = (lambda_b if Fx < 0 else lambda_d) * Fx
    exact, smooth = (
        split(Fx, lambda_b, car) for split in (single_track.split, single_track.smooth_split)
    )
    assert (float(exact.f), float(exact.r)) == pytest.approx((front, Fx - front), abs=1e-9)
    assert float(smooth.f + smooth.r) == pytest.approx(Fx, abs=1e-9)
    assert float(smooth.f) * float(smooth.r) >= 0
    if abs(Fx) > 10 * car.force_blend:
        assert float(smooth.f) == pytest.approx(front, abs=1e-3)


@pytest.mark.parametrize('deceleration', [0, 2, 4, 6, 8])
def test_the_ideal_brake_split_follows_the_load(car, deceleration):
    # the loads that hold the weight, and the moment of the braking force about the CoG
    balance = [[1.0, 1.0], [car.l_f, -car.l_r]]
    front, rear = np.linalg.solve(balance, [car.m * 9.81, car.h * car.m * deceleration])
    front_share = single_track.ideal_split(-car.m * deceleration, car)
    assert front_share == pytest.approx(front / (front + rear), rel=1e-9)


def test_lateral_jerk_is_the_slope_of_the_lateral_acceleration(car):
    x, u = ca.SX.sym('x', 9), ca.SX.sym('u', 4)
    named = State(*ca.vertsplit(x)), Input(*ca.vertsplit(u))
    rates = single_track.derivative(*named, car)
    ay = ca.Function('ay', [x, u], [rates.vy + named[0].r * named[0].vx])
    jerk = ca.Function('jerk', [x, u], [single_track.lateral_jerk(*named, car)])
    slopes = ca.Function('slopes', [x, u], [ca.vertcat(*rates)])

    @quick
    @given(states, inputs)
    def check(x, u):
        h = 1e-6 * slopes(x, u).full().ravel()
        slope = float(ay(x + h, u) - ay(x - h, u)) / 2e-6
        assert float(jerk(x, u)) == pytest.approx(slope, rel=1e-3, abs=2e-2)

    check()
