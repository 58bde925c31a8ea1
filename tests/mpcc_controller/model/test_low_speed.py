"""The car that drives at every speed: kinematic when slow, the same model when fast."""

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
def slow_car(world):
    return stage_parameters.car(*world.load(model__low_speed=True))


@pytest.fixture(scope='module')
def rates(slow_car):
    """Return (x, u) -> dx/dt (9,) of the car."""
    f = single_track.rates(single_track.structure(slow_car))
    return lambda x, u: f(x, u, slow_car).full().ravel()


def state(vx, vy, r, delta, Fx=0.0):
    return State(0.0, 0.0, 0.3, vx, vy, r, 0.0, delta, Fx)


@quick
@given(
    st.floats(BLEND_FROM_MPS + BLEND_MPS, 50), *DRIVING, st.floats(-0.5, 0.5), st.floats(0.4, 0.9)
)
def test_above_the_blend_it_is_the_dynamic_model(rates, car, vx, vy, r, delta, Fx, d_delta, split):
    x, u = state(vx, vy, r, delta, Fx), Input(d_delta, 1000.0, split, 0.0)
    paper = single_track.rates(single_track.PAPER)(x, u, car).full().ravel()
    assert rates(x, u) == pytest.approx(paper, rel=1e-12, abs=1e-12)


@quick
@given(st.floats(0.0, BLEND_FROM_MPS - 0.5), st.floats(-0.4, 0.4), st.floats(-0.5, 0.5))
def test_a_slow_car_rolls_along_the_circle_of_its_steering_angle(rates, car, v, delta, d_delta):
    """On it the rear axle does not move sideways; the rates keep it there while the angle moves."""
    wheelbase = car.l_f + car.l_r
    delta *= min(1.0, 2.0 / max(v, 1.0) ** 2)  # far below the friction
    r = v * np.tan(delta) / wheelbase
    x = State(*rates(state(v, car.l_r * r, r, delta), (d_delta, 0, 0.5, 0)))
    h = 1e-6
    later_r = (v + h * x.vx) * np.tan(delta + h * d_delta) / wheelbase
    assert x.r == pytest.approx((later_r - r) / h, abs=1e-5)
    assert x.vy == pytest.approx(car.l_r * x.r, abs=1e-9)
    resistance = (car.drag * v**2 + car.rolling) * np.tanh(v / 0.3)  # none at rest
    assert x.vx == pytest.approx(-resistance / car.m, abs=1e-9)


@quick
@given(
    st.floats(3.0, BLEND_FROM_MPS - 0.5),
    st.floats(0.2, 0.5),
    st.floats(0.8, 1.0),
    st.floats(0.3, 1.0),
)
def test_a_slow_car_turns_no_faster_than_braking_leaves_friction_for(slow_car, v, delta, use, mu):
    """`use` is the share of the friction that brakes: the rest is on a circle."""
    limit = mu * single_track.GRAVITY
    r = limit * np.sqrt(1 - use**2 + 2e-4) / v
    x = state(v, 0.0, r, delta, -use * limit * slow_car.m)
    body = single_track.kinematic_rates(
        x, Input(0.0, 0.0, 0.5, 0.0), slow_car._replace(mu_f=mu, mu_r=mu)
    )
    assert float(body.r) <= 0.0


@pytest.mark.parametrize(
    ('v', 'delta'),
    # at 10 m/s 0.2 rad ask for more lateral acceleration than the friction gives
    [(v, 0.02) for v in (1.0, 4.0, 6.0, 7.5, 10.0)] + [(v, 0.2) for v in (1.0, 4.0, 6.0, 7.5)],
)
def test_the_steps_of_the_solver_settle_where_the_exact_solution_does(rates, slow_car, v, delta):
    """RK2 at 50 ms against an adaptive integrator, from a car that does not yaw yet."""
    start, u = np.array(state(v, 0.0, 0.0, delta)), (0.0, 0.0, 0.5, 0.0)
    exact = solve_ivp(lambda _, y: rates(y, u), (0, 1.5), start, rtol=1e-8, atol=1e-9).y[:, -1]
    step, x = single_track.step(0.05, single_track.structure(slow_car)), start
    for _ in range(30):
        x = step(x, u, slow_car).full().ravel()
    assert State(*x).r == pytest.approx(State(*exact).r, rel=0.02, abs=1e-4)
    assert State(*x).vy == pytest.approx(State(*exact).vy, rel=0.03, abs=5e-3)


def test_a_standing_car_stays_and_a_rolling_one_comes_to_rest_without_going_back(rates, slow_car):
    u = (0.0, 0.0, 0.5, 0.0)
    assert rates(state(0.0, 0.0, 0.0, 0.3), u) == pytest.approx(np.zeros(9))
    step, x = single_track.step(0.05, single_track.structure(slow_car)), state(0.5, 0.0, 0.0, 0.0)
    speeds = []
    for _ in range(400):
        x = step(x, u, slow_car).full().ravel()
        speeds.append(x[3])
    assert min(speeds) >= 0.0
    assert max(np.diff(speeds)) <= 0.0
    assert speeds[-1] < 0.25
