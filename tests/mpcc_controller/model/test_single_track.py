"""Single track against an independent transcription and general properties of a car."""

import dataclasses
import math

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import expm

from mpcc_controller.model import single_track
from mpcc_controller.model.single_track import Input, State
from mpcc_controller.problem import stage_parameters
from node_runtime.parameters import ParameterError
from stage_solver.stage_problem import rk2

quick = settings(max_examples=60)
states = st.tuples(
    st.floats(-100, 100),
    st.floats(-100, 100),
    st.floats(-3, 3),
    st.floats(10, 30),
    st.floats(-2, 2),
    st.floats(-0.8, 0.8),
    st.floats(0, 100),
    st.floats(-0.3, 0.3),
    st.floats(-14000, 5000),
)


@pytest.fixture(scope='module')
def rates(car):
    x, u = ca.SX.sym('x', 9), ca.SX.sym('u', 4)
    derivatives = single_track.derivative(State(*ca.vertsplit(x)), Input(*ca.vertsplit(u)), car)
    return ca.Function('rates', [x, u], [ca.vertcat(*derivatives)])


def transcribed(x, u, c):
    """Return dx/dt written independently from the paper's eq. 1 and 2, and Fiala's cases."""
    L, g = c.l_f + c.l_r, 9.81
    Fz = ((c.m * g * c.l_r - c.h * x.Fx) / L, (c.m * g * c.l_f + c.h * x.Fx) / L)
    part = 0.5 + 0.5 * math.tanh(x.Fx / c.force_blend)
    front = part * c.lambda_d + (1 - part) * u.lambda_b
    slips = (
        math.atan2(x.vy + c.l_f * x.r, x.vx) - x.delta,
        math.atan2(x.vy - c.l_r * x.r, x.vx),
    )
    forces = []
    for demand, load, mu, C, alpha in zip(
        (front * x.Fx, (1 - front) * x.Fx), Fz, (c.mu_f, c.mu_r), (c.C_f, c.C_r), slips
    ):
        M = 0.99 * mu * load
        e = 0.02 * M
        Fx = 0.5 * (math.hypot(demand + M, e) - math.hypot(demand - M, e))
        F_max = math.sqrt((mu * load) ** 2 - Fx**2)
        z, xi = math.tan(alpha), c.tyre_switch
        if abs(z) < 3 * xi * F_max / C:
            Fy = -C * z + C**2 * abs(z) * z / (3 * F_max) - C**3 * z**3 / (27 * F_max**2)
        else:
            Fy = -C * (1 - xi) ** 2 * z - F_max * (3 * xi**2 - 2 * xi**3) * math.copysign(1, z)
        forces.append((Fx, Fy))
    (Fxf, Fyf), (Fxr, Fyr) = forces
    sin, cos = math.sin(x.delta), math.cos(x.delta)
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


@quick
@given(states, st.floats(0.4, 0.9))
def test_derivative_equals_an_independent_transcription(car, rates, x, lambda_b):
    u = Input(0.3, -2e4, lambda_b, 0.0)
    expected = transcribed(State(*x), u, car)
    # the speed in the slip angles is raised by 12 mm/s at 10 m/s
    assert rates(x, u).full().ravel() == pytest.approx(expected, rel=3e-3, abs=3e-2)


@quick
@given(states)
def test_a_mirrored_state_has_mirrored_derivatives(rates, x):
    mirror = np.array([1, -1, -1, 1, -1, -1, 1, -1, 1])
    here = rates(x, (0.3, -1e4, 0.6, 0.0)).full().ravel()
    there = rates(mirror * x, (-0.3, -1e4, 0.6, 0.0)).full().ravel()
    assert there == pytest.approx(mirror * here, abs=1e-9)


def test_rolling_straight_only_drag_slows_the_car(car, rates):
    x = State(0, 0, 0, 20.0, 0, 0, 0, 0, 0)
    x_dot = State(*rates(x, (0, 0, 0.6, 0)).full().ravel())
    assert x_dot.vx == pytest.approx(-(car.drag * 20.0**2 + car.rolling) / car.m)
    assert (x_dot.vy, x_dot.r, x_dot.Y) == (0, 0, 0)


@quick
@given(st.floats(-16000, 6000), st.floats(0.4, 0.9))
def test_axle_forces_add_up_to_the_total_and_never_oppose(car, Fx, lambda_b):
    for split in (single_track.split, single_track.smooth_split):
        F = split(Fx, lambda_b, car)
        assert float(F.f + F.r) == pytest.approx(Fx, abs=1e-9)
        assert float(F.f) * float(F.r) >= 0


def test_braking_is_split_and_driving_goes_to_the_driven_axle(car):
    brake, drive = single_track.split(-8000.0, 0.6, car), single_track.split(4000.0, 0.6, car)
    assert (float(brake.f), float(brake.r)) == pytest.approx((-4800.0, -3200.0))
    assert (float(drive.f), float(drive.r)) == (0.0, 4000.0)


def test_the_smooth_split_is_the_exact_one_outside_its_blend(car):
    for Fx in (-10 * car.force_blend, 10 * car.force_blend):
        smooth, exact = (f(Fx, 0.6, car) for f in (single_track.smooth_split, single_track.split))
        assert float(smooth.f) == pytest.approx(float(exact.f), abs=1e-3)


@pytest.mark.parametrize('deceleration', [0, 2, 4, 6, 8])
def test_ideal_brake_split_follows_the_load(car, deceleration):
    # the loads that hold the weight, and the moment of the braking force about the CoG
    balance = [[1.0, 1.0], [car.l_f, -car.l_r]]
    front, rear = np.linalg.solve(balance, [car.m * 9.81, car.h * car.m * deceleration])
    front_share = single_track.ideal_split(-car.m * deceleration, car)
    assert front_share == pytest.approx(front / (front + rear), rel=1e-9)


def test_both_axles_lock_together_at_the_ideal_split(car):
    Fx = -12000.0
    F, Fz = (
        single_track.split(Fx, single_track.ideal_split(Fx, car), car),
        single_track.loads(Fx, car),
    )
    assert float(F.f) / Fz.f == pytest.approx(float(F.r) / Fz.r)


def test_error_of_a_midpoint_step_falls_with_the_cube_of_the_step(rates):
    x = np.array([0, 0, 0.1, 20.0, 0.2, 0.3, 0, 0.04, -3000.0])
    u = np.array([0.2, -5000.0, 0.6, 0.0])

    def error(dt):
        coarse = rk2(lambda x, u, p: rates(x, u).full().ravel(), dt)(x, u, None)
        fine = x
        for _ in range(100):
            fine = rk2(lambda x, u, p: rates(x, u).full().ravel(), dt / 100)(fine, u, None)
        return np.max(np.abs(coarse - fine))

    assert error(0.02) / error(0.01) == pytest.approx(8, rel=0.25)


def growth_per_midpoint_step(rates, vx, dt):
    """Return the largest eigenvalue of the lateral motion over one step of 50 ms."""
    lateral = [State._fields.index(name) for name in ('vy', 'r')]
    x = np.array(State(0, 0, 0, vx, 0, 0, 0, 0, 0), float)
    a = np.empty((2, 2))
    for column, index in enumerate(lateral):
        moved = x.copy()
        moved[index] = 1e-6
        slope = (rates(moved, (0, 0, 0.6, 0)) - rates(x, (0, 0, 0.6, 0))).full().ravel() / 1e-6
        a[:, column] = dt * slope[lateral]
    return np.max(np.abs(np.linalg.eigvals(np.eye(2) + a + a @ a / 2)))


@pytest.mark.parametrize('vx', [7.0, 10.0, 20.0, 30.0])
def test_a_midpoint_step_is_stable_from_the_least_speed_on(rates, params, vx):
    assert vx >= params.limits.least_speed_mps
    assert growth_per_midpoint_step(rates, vx, params.model.step_s) < 1


def growth_of_the_textbook(car, vx, slip_speed, dt):
    """Return the same eigenvalue of the linear single track, slips taken at `slip_speed`."""
    C, arm = np.array([car.C_f, car.C_r]), np.array([car.l_f, -car.l_r])
    damping = np.array([[C.sum(), C @ arm], [C @ arm, C @ arm**2]]) / slip_speed
    a = -dt * (damping / [[car.m], [car.Izz]] + [[0.0, vx], [0.0, 0.0]])
    return np.max(np.abs(np.linalg.eigvals(np.eye(2) + a + a @ a / 2)))


@pytest.mark.parametrize('vx', [10.0, 20.0, 30.0])
def test_the_lateral_motion_is_that_of_the_textbooks_linear_single_track(car, rates, vx):
    expected = growth_of_the_textbook(car, vx, vx, 0.05)
    assert growth_per_midpoint_step(rates, vx, 0.05) == pytest.approx(expected, rel=1e-3)


@pytest.mark.parametrize('vx', [0.0, 1.0, 2.0, 3.0, 4.0, 5.0])
def test_below_the_least_speed_an_error_grows_no_faster_than_with_the_slips_of_five_m_per_s(
    car, rates, vx
):
    """A midpoint step is not stable there; the bound of the speed limits the growth."""
    growth = growth_per_midpoint_step(rates, vx, 0.05)
    assert growth < growth_of_the_textbook(car, vx, 5.0, 0.05) < 1.5


@quick
@given(states, st.floats(-0.5, 0.5), st.floats(-3e4, 3e4))
def test_lateral_jerk_is_the_slope_of_the_lateral_acceleration(car, x, d_delta, d_Fx):
    u = Input(d_delta, d_Fx, 0.6, 0.0)

    def lateral_acceleration(x):
        body = single_track.body_rates(x, u, car)
        return float(body.vy + x.r * x.vx)

    h = 1e-6
    x = State(*x)
    slopes = np.array([float(rate) for rate in single_track.derivative(x, u, car)])
    ahead, behind = (State(*(np.array(x) + side * h * slopes)) for side in (1, -1))
    slope = (lateral_acceleration(ahead) - lateral_acceleration(behind)) / (2 * h)
    jerk = float(single_track.lateral_jerk(x, u, car))
    assert jerk == pytest.approx(slope, rel=1e-4, abs=1e-2)


@pytest.mark.parametrize('axle', ['f', 'r'])
def test_an_axle_just_slides_at_the_sliding_slip(car, axle):
    plain = car._replace(tyre_switch=1.0)
    Fz = getattr(single_track.loads(0.0, plain), axle)
    friction = getattr(plain, f'mu_{axle}') * Fz

    def force(alpha):
        lever, sign = (plain.l_f, 1) if axle == 'f' else (plain.l_r, -1)
        # a yaw rate alone gives the slip; the body does not slip sideways
        r = sign * 20.0 * math.tan(alpha) / lever
        x = State(0, 0, 0, 20.0, 0, r, 0, 0, 0)
        return abs(
            float(getattr(single_track.tyre_forces(x, Input(0, 0, 0.5, 0), plain), f'F_y{axle}'))
        )

    alpha = float(getattr(single_track.sliding_slips(plain), axle))
    assert force(1.001 * alpha) == pytest.approx(friction, rel=1e-3)
    assert force(2.0 * alpha) == pytest.approx(friction, rel=1e-3)
    # at half of the slip 1 - (1 - 1/2)^3 of it, at small angles
    assert force(alpha / 2) == pytest.approx(0.875 * friction, rel=0.01)


@quick
@given(st.floats(8, 40))
def test_at_the_greatest_yaw_rate_a_steady_turn_takes_all_friction(car, vx):
    x = State(0, 0, 0, vx, 0, 0, 0, 0, 0)
    Fz = single_track.loads(0.0, car)
    force = car.mu_f * Fz.f + car.mu_r * Fz.r
    r = float(single_track.greatest_yaw_rate(x, car))
    # 1 % for the rounding of the speed at 8 m/s
    assert car.m * r * vx == pytest.approx(force, rel=0.01)


@quick
@given(
    st.floats(10, 60),
    st.floats(0.4, 1.5),
    st.floats(-0.5, 0.5),
    st.floats(-3e4, 3e4),
)
def test_what_acts_is_what_a_settled_servo_reaches_on_a_ramp(car, omega, zeta, d_delta, d_Fx):
    """Against a servo of second order, integrated until its transient is over."""
    lag = 2 * zeta / omega
    lagging = car._replace(steer_lag=lag, force_lag=2 * lag)
    A = np.array([[0.0, 1.0], [-(omega**2), -2 * zeta * omega]])
    T = 30 / (zeta * omega) + 30 * zeta / omega
    for name, rate, speed in (('delta', d_delta, 1.0), ('Fx', d_Fx, 0.5)):
        # deviation from the steady ramp; half of omega doubles the lag
        slow = A * np.array([[1, 1], [speed**2, speed]])
        left = expm(slow * T / speed) @ np.array([rate * lag / speed, -rate])
        reached = rate * T - rate * lag / speed + left[0]
        x = State(0, 0, 0, 20.0, 0, 0, 0, delta=0.0, Fx=0.0)._replace(**{name: rate * T})
        found = getattr(single_track.acting(x, Input(d_delta, d_Fx, 0.6, 0), lagging), name)
        assert found == pytest.approx(reached, rel=1e-6, abs=1e-6)


def test_while_set_points_stand_still_a_lagging_car_moves_like_one_without_lag(car):
    lagging = car._replace(steer_lag=0.05, force_lag=0.07)
    x, u = [0, 0, 0, 20, 0.3, 0.2, 0, 0.05, -3000], [0, 0, 0.6, 0]
    with_lag = single_track.step(0.05, single_track.structure(lagging))(x, u, list(lagging)).full()
    assert with_lag == pytest.approx(single_track.step(0.05)(x, u, list(car)).full(), abs=1e-12)


def test_the_lags_of_the_car_file_are_in_the_model_where_the_switch_is_on(world):
    params, vehicle = world.load()
    assert single_track.structure(stage_parameters.car(params, vehicle)) == single_track.PAPER
    params, vehicle = world.load(model__servo_lag=True)
    car = stage_parameters.car(params, vehicle)
    actuators = vehicle.actuators
    assert (car.steer_lag, car.force_lag) == (actuators.steer_lag_s, actuators.force_lag_s)
    older = dataclasses.replace(vehicle, actuators=dataclasses.replace(actuators, force_lag_s=None))
    with pytest.raises(ParameterError, match=r'does not have actuators\.force_lag_s'):
        stage_parameters.car(params, older)
