"""The kinds of car that drive at every speed: kinematic when slow, the same model when fast."""

import dataclasses

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from mpcc_controller.model import single_track
from mpcc_controller.model.single_track import BLEND_FROM_MPS, BLEND_MPS, Input, State
from mpcc_controller.problem import stage_parameters

quick = settings(max_examples=60)
DRIVING = (st.floats(-2, 2), st.floats(-1, 1), st.floats(-0.4, 0.4), st.floats(-12000, 5000))


@pytest.fixture(scope='module')
def cars(world):
    """Return the same car of the paper's kind and of the low-speed kind."""
    return [stage_parameters.car(*world.load(model__low_speed=on)) for on in (False, True)]


@pytest.fixture(scope='module')
def rates(cars):
    """Return (x, u) -> dx/dt of both cars."""
    x, u = ca.SX.sym('x', 9), ca.SX.sym('u', 4)
    states, inputs = State(*ca.vertsplit(x)), Input(*ca.vertsplit(u))
    return [
        ca.Function('f', [x, u], [ca.vertcat(*single_track.derivative(states, inputs, car))])
        for car in cars
    ]


@pytest.fixture(scope='module')
def slopes(rates):
    """Return (x, u) -> the Jacobian of dx/dt by x."""
    x, u = ca.SX.sym('x', 9), ca.SX.sym('u', 4)
    return ca.Function('A', [x, u], [ca.jacobian(rates[1](x, u), x)])


def state(vx, vy, r, delta, Fx=0.0):
    return State(0.0, 0.0, 0.3, vx, vy, r, 0.0, delta, Fx)


@quick
@given(
    st.floats(BLEND_FROM_MPS + BLEND_MPS, 50), *DRIVING, st.floats(-0.5, 0.5), st.floats(0.4, 0.9)
)
def test_above_the_blend_it_is_the_dynamic_model(rates, vx, vy, r, delta, Fx, d_delta, split):
    x, u = state(vx, vy, r, delta, Fx), Input(d_delta, 1000.0, split, 0.0)
    paper, low = (np.array(f(x, u)).ravel() for f in rates)
    assert low == pytest.approx(paper, rel=1e-12, abs=1e-12)


@quick
@given(st.floats(0.0, BLEND_FROM_MPS - 0.5), st.floats(-0.4, 0.4), st.floats(-0.5, 0.5))
def test_a_slow_car_rolls_along_the_circle_of_its_steering_angle(rates, cars, v, delta, d_delta):
    """On it the rear axle does not move sideways; the rates keep it there while the angle moves."""
    car = cars[1]
    wheelbase = car.l_f + car.l_r
    delta *= min(1.0, 2.0 / max(v, 1.0) ** 2)  # far below the friction
    r = v * np.tan(delta) / wheelbase
    x = State(*np.array(rates[1](state(v, car.l_r * r, r, delta), (d_delta, 0, 0.5, 0))).ravel())
    h = 1e-6
    later_r = (v + h * x.vx) * np.tan(delta + h * d_delta) / wheelbase
    assert x.r == pytest.approx((later_r - r) / h, abs=1e-5)
    assert x.vy == pytest.approx(car.l_r * x.r, abs=1e-9)


@quick
@given(
    st.floats(3.0, BLEND_FROM_MPS - 0.5),
    st.floats(0.2, 0.5),
    st.floats(0.8, 1.0),
    st.floats(0.3, 1.0),
)
def test_a_slow_car_turns_no_faster_than_braking_leaves_friction_for(cars, v, delta, use, mu):
    """`use` is the share of the friction that brakes: the rest is on a circle."""
    limit = mu * single_track.GRAVITY
    r = limit * np.sqrt(1 - use**2 + 2e-4) / v
    x = state(v, 0.0, r, delta, -use * limit * cars[1].m)
    u = Input(0.0, 0.0, 0.5, 0.0)
    body = single_track.kinematic_rates(x, u, cars[1]._replace(mu_f=mu, mu_r=mu))
    assert float(body.r) <= 0.0


@pytest.mark.parametrize(
    ('v', 'delta'),
    # at 10 m/s 0.2 rad ask for more lateral acceleration than the friction gives
    [(v, 0.02) for v in (1.0, 4.0, 6.0, 7.5, 10.0)] + [(v, 0.2) for v in (1.0, 4.0, 6.0, 7.5)],
)
def test_the_steps_of_the_solver_settle_where_the_exact_solution_does(rates, cars, v, delta):
    """RK2 at 50 ms against an adaptive integrator, from a car that does not yaw yet."""
    start = np.array(state(v, 0.0, 0.0, delta))
    u = np.array((0.0, 0.0, 0.5, 0.0))
    exact = solve_ivp(
        lambda _, y: np.array(rates[1](y, u)).ravel(), (0, 1.5), start, rtol=1e-8, atol=1e-9
    ).y[:, -1]
    step, x = single_track.step(0.05, single_track.structure(cars[1])), start
    for _ in range(30):
        x = step(x, u, cars[1]).full().ravel()
    ends = State(*x), State(*exact)
    assert ends[0].r == pytest.approx(ends[1].r, rel=0.02, abs=1e-4)
    assert ends[0].vy == pytest.approx(ends[1].vy, rel=0.03, abs=5e-3)


def test_a_standing_car_stays_and_a_rolling_one_comes_to_rest_without_going_back(rates, cars):
    rest = state(0.0, 0.0, 0.0, 0.3)
    assert np.array(rates[1](rest, (0, 0, 0.5, 0))).ravel() == pytest.approx(np.zeros(9))
    step, x = (
        single_track.step(0.05, single_track.structure(cars[1])),
        np.array(state(0.5, 0.0, 0.0, 0.0)),
    )
    speeds = []
    for _ in range(400):
        x = step(x, (0, 0, 0.5, 0), cars[1]).full().ravel()
        speeds.append(x[3])
    assert min(speeds) >= 0.0
    assert max(np.diff(speeds)) <= 0.0
    assert speeds[-1] < 0.25


@quick
@given(st.floats(0.0, 12.0), *DRIVING)
def test_first_derivatives_agree_with_finite_differences_through_the_blend(
    rates, slopes, vx, vy, r, delta, Fx
):
    at, inputs, h = np.array(state(vx, vy, r, delta, Fx)), (0.1, 0.0, 0.6, 0.0), 1e-6
    exact = slopes(at, inputs).full()
    scale = np.array([1, 1, 1, 1, 1, 1, 1, 1, 1e3])
    for i in range(9):
        e = h * scale[i] * np.eye(9)[i]
        rise = np.array(rates[1](at + e, inputs) - rates[1](at - e, inputs)).ravel()
        assert exact[:, i] * scale[i] == pytest.approx(rise / (2 * h), rel=1e-3, abs=2e-3)


def test_the_lags_of_the_actuators_and_low_speeds_go_together(world):
    params, vehicle = world.load(model__low_speed=True, model__servo_lag=True)
    actuators = dataclasses.replace(vehicle.actuators, steer_lag_s=0.05, force_lag_s=0.07)
    car = stage_parameters.car(params, dataclasses.replace(vehicle, actuators=actuators))
    assert (car.steer_lag, car.force_lag) == (0.05, 0.07)
    x = state(2.0, 0.0, 0.0, 0.2)
    u = Input(0.4, 0.0, 0.5, 0.0)
    ahead = single_track.body_rates(x._replace(delta=0.2 + 0.05 * 0.4), u, car)
    without = car._replace(steer_lag=0.0, force_lag=0.0)
    assert float(ahead.r) == pytest.approx(float(single_track.body_rates(x, u, without).r))
