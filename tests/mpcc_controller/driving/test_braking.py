"""The last fallback level: friction-limited braking that still steers."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mpcc_controller.driving import braking
from mpcc_controller.driving.braking import Point
from mpcc_controller.driving.setpoints import Setpoints, SetpointTarget
from mpcc_controller.model import single_track
from mpcc_controller.model.single_track import GRAVITY, Input, State
from mpcc_controller.path import reference_path
from stage_solver.stage_problem import Plan

quick = settings(max_examples=100)
REST = Setpoints(0.0, 0.0)


@pytest.fixture(scope='module')
def slow_params(world):
    """Return parameters with a step so long that no rate limit counts."""
    return world.load(model__step_s=0.2, limits__force_rate_nps=1e7, limits__steer_rate_radps=10.0)[
        0
    ]


def circle_ahead(radius, distance, x):
    """Return the point of a circle that touches the car's direction, `distance` along it."""
    angle = distance / radius
    return Point(x.X + radius * np.sin(angle), x.Y + radius * (1 - np.cos(angle)))


def use(target, lateral, car):
    """Return the share of the friction circle per axle."""
    F, Fz = single_track.split(target.Fx, target.lambda_b, car), single_track.loads(target.Fx, car)
    Fy = car.m * lateral / (car.l_f + car.l_r)
    front = np.hypot(float(F.f), Fy * car.l_r) / (car.mu_f * Fz.f)
    rear = np.hypot(float(F.r), Fy * car.l_f) / (car.mu_r * Fz.r)
    return front, rear


@quick
@given(st.floats(3, 40), st.floats(-0.5, 0.5), st.floats(-30, 30), st.floats(-0.3, 0.3))
def test_cornering_and_braking_together_stay_inside_the_circle_of_both_axles(
    car, slow_params, world, v, r, aside, vy
):
    x = world.rolling(v=v, r=r, vy=vy)
    lookahead = Point(30.0, aside)
    target = braking.braking_target(x, REST, lookahead, car, slow_params)
    most = slow_params.braking.lateral_use * braking.max_acceleration(car, slow_params.limits)
    lateral = abs(braking.lateral_acceleration(x, lookahead, most))
    assert lateral <= most
    assert max(use(target, lateral, car)) <= slow_params.limits.friction_use * (1 + 1e-6)
    assert target.Fx <= 0
    assert np.isfinite(target).all()


@pytest.mark.parametrize('lateral', [0.0, 3.0, 6.0, 7.5])
def test_braking_is_as_hard_as_the_friction_beside_the_cornering_allows(car, params, lateral):
    hardest = braking.max_braking_force(lateral, car, params.limits)
    share = single_track.ideal_split(-hardest, car)
    share = np.clip(share, params.limits.brake_front_share_min, params.limits.brake_front_share_max)
    used = use(SetpointTarget(0.0, -hardest, share), lateral, car)
    assert max(used) == pytest.approx(params.limits.friction_use, rel=1e-4)


def test_straight_ahead_the_force_is_limited_by_friction_or_by_the_brakes(car, world):
    params, _ = world.load(limits__brake_n=5000.0)
    assert braking.max_braking_force(0.0, car, params.limits) == pytest.approx(5000.0, rel=1e-6)


def test_more_cornering_leaves_less_braking(car, params):
    forces = [braking.max_braking_force(a, car, params.limits) for a in np.arange(0, 9, 0.5)]
    assert np.all(np.diff(forces) < 0)


def test_at_the_limit_of_cornering_no_braking_force_is_left(car, params):
    beyond = 1.01 * braking.max_acceleration(car, params.limits)
    assert braking.max_braking_force(beyond, car, params.limits) == 0.0


@quick
@given(st.floats(3, 30), st.floats(20, 500), st.sampled_from([-1, 1]))
def test_the_lateral_acceleration_follows_from_the_circle_to_the_lookahead_point(
    world, v, radius, side
):
    x = world.rolling(v=v)
    lookahead = circle_ahead(side * radius, 15.0 * side, x)
    lateral = braking.lateral_acceleration(x, lookahead, np.inf)
    assert lateral == pytest.approx(side * v**2 / radius, rel=1e-9)


def test_the_direction_of_motion_counts_not_the_heading(world):
    sliding = world.rolling(v=20.0, vy=2.0)
    towards = Point(20.0, 2.0)  # exactly where it goes
    assert braking.lateral_acceleration(sliding, towards, 9.0) == pytest.approx(0.0, abs=1e-12)
    turned = sliding._replace(psi=0.5, X=3.0, Y=-1.0)
    along = Point(
        3.0 + 20.0 * np.cos(0.5) - 2.0 * np.sin(0.5), -1.0 + 20.0 * np.sin(0.5) + 2.0 * np.cos(0.5)
    )
    assert braking.lateral_acceleration(turned, along, 9.0) == pytest.approx(0.0, abs=1e-12)


def test_a_lookahead_point_at_the_car_demands_no_lateral_acceleration(world):
    x = world.rolling()
    assert braking.lateral_acceleration(x, Point(x.X, x.Y), 9.0) == 0.0


@pytest.mark.parametrize('lateral', [-7.0, -2.0, 0.5, 5.0, 7.5])
def test_the_steering_angle_gives_the_front_axle_the_demanded_force(car, lateral):
    """The tyre model at this steering angle returns the demanded force."""
    Fx, lambda_b = -2000.0, 0.6
    x = State(0.0, 0.0, 0.0, 18.0, 0.4, 0.3, 0.0, 0.0, Fx)
    delta = braking.steering_angle(x, lateral, Fx, lambda_b, car)
    u = Input(0.0, 0.0, lambda_b, 0.0)
    F = single_track.tyre_forces(x._replace(delta=delta), u, car)
    assert float(F.F_yf) == pytest.approx(braking.lateral_forces(lateral, car).f, abs=10.0)


def test_a_car_that_yaws_too_much_is_steered_against_it(car, world):
    # to the left, while the car slides to the right
    still, spinning = world.rolling(), world.rolling(r=0.8, vy=-1.5)
    deltas = [braking.steering_angle(x, 0.0, -3000.0, 0.6, car) for x in (still, spinning)]
    assert deltas[0] == 0.0
    assert deltas[1] < 0
    assert deltas[1] == pytest.approx((-1.5 + 0.8 * car.l_f) / 20.0, rel=0.01)


def test_at_walking_pace_the_steering_is_the_angle_of_the_arc(car, world):
    x = world.rolling(v=0.5)
    delta = braking.steering_angle(x, 5.0**2 / 20.0, 0.0, 0.6, car)
    assert delta == pytest.approx(np.arctan((car.l_f + car.l_r) / 20.0), rel=0.15)


def test_a_demand_beyond_the_capacity_of_the_axle_gives_full_slip(car, world):
    # where the Fiala curve reaches the friction of the axle, which carries its static load
    load = car.m * GRAVITY * car.l_r / (car.l_f + car.l_r)
    full = np.arctan(3 * car.mu_f * load / car.C_f)
    for demand in (9.9, 99.0, -99.0):
        delta = braking.steering_angle(world.rolling(), demand, 0.0, 0.6, car)
        assert delta == pytest.approx(np.copysign(full, demand), rel=1e-9)


def test_an_axle_whose_friction_the_brakes_take_is_steered_along_its_motion(car, world):
    x = world.rolling(r=0.2, vy=0.5)
    delta = braking.steering_angle(x, 5.0, -99e3, 1.0, car)
    assert delta == pytest.approx(np.arctan2(0.5 + car.l_f * 0.2, x.vx), abs=1e-9)


def test_braking_builds_up_at_the_rate_limits(params, car, world):
    now = Setpoints(0.3, 2000.0)
    first = braking.braking_target(world.rolling(), now, None, car, params)
    assert first.Fx == pytest.approx(2000.0 - params.limits.force_rate_nps * 0.05)
    assert first.delta == pytest.approx(0.3 - params.limits.steer_rate_radps * 0.05)


def test_too_much_braking_for_the_bend_is_released_at_the_rate_limit(params, car, world):
    now = Setpoints(0.1, -16000.0)
    target = braking.braking_target(world.rolling(r=0.4), now, Point(14.0, 2.5), car, params)
    assert target.Fx == pytest.approx(-16000.0 + params.limits.force_rate_nps * 0.05)


@quick
@given(st.floats(-0.471, 0.471), st.floats(-17000, 6000), st.floats(-40, 40), st.floats(0, 40))
def test_setpoints_stay_within_range_and_rate(params, car, world, delta, Fx, aside, v):
    now, limits = Setpoints(delta, Fx), params.limits
    target = braking.braking_target(world.rolling(v=v), now, Point(10.0, aside), car, params)
    assert abs(target.delta) <= limits.steer_rad
    assert abs(target.delta - delta) <= limits.steer_rate_radps * 0.05 + 1e-12
    assert abs(target.Fx - Fx) <= limits.force_rate_nps * 0.05 + 1e-6
    assert limits.brake_front_share_min <= target.lambda_b <= limits.brake_front_share_max


def test_without_a_lookahead_point_or_a_state_the_wheels_go_straight(params, car, world):
    now = Setpoints(0.02, 0.0)
    for x, lookahead in ((world.rolling(), None), (world.rolling(r=np.nan), Point(9.0, 9.0))):
        target = braking.braking_target(x, now, lookahead, car, params)
        assert target.delta == 0.0
        assert target.Fx < 0


def test_present_cornering_reduces_the_braking_force_without_a_demand(slow_params, car, world):
    straight = braking.braking_target(world.rolling(), REST, None, car, slow_params)
    turning = braking.braking_target(world.rolling(r=0.3), REST, None, car, slow_params)
    assert turning.Fx > straight.Fx + 1000
    assert straight.Fx == pytest.approx(
        -slow_params.limits.friction_use * min(car.mu_f, car.mu_r) * car.m * GRAVITY, rel=0.05
    )


# the lookahead point


def test_the_lookahead_point_is_on_the_line_one_preview_distance_ahead_of_the_foot():
    line = np.array([[0.0, 0.0], [10.0, 0.0], [10.0, 0.0], [10.0, 10.0]])
    assert braking.point_ahead(line, 2.0, 1.0, 4.0) == pytest.approx((6.0, 0.0))
    assert braking.point_ahead(line, 2.0, 1.0, 12.0) == pytest.approx((10.0, 4.0))
    assert braking.point_ahead(line, 11.0, 9.0, 5.0) == pytest.approx((10.0, 14.0))
    assert braking.point_ahead(line, -3.0, 1.0, 4.0) == pytest.approx((4.0, 0.0))
    assert braking.point_ahead(np.ones((3, 2)), 5.0, 5.0, 4.0) == (1.0, 1.0)


def test_the_lookahead_point_is_taken_from_the_plan_else_from_the_path(params, world):
    x = world.rolling(v=20.0, X=10.0)
    X = np.zeros((51, len(State._fields)))
    X[:, State._fields.index('X')] = np.linspace(0, 50, 51)
    X[:, State._fields.index('Y')] = 2.0
    plan = Plan(X, np.zeros((50, 4)))
    path = reference_path.build(world.straight().reference)
    preview = params.braking.preview_s * 20.0
    along = {
        braking.PLAN: braking.lookahead_point(x, plan, path, 10.0, params.braking),
        braking.PATH: braking.lookahead_point(x, None, path, 10.0, params.braking),
        braking.NONE: braking.lookahead_point(x, None, None, None, params.braking),
    }
    assert {line: lookahead.line for line, lookahead in along.items()} == {
        line: line for line in along
    }
    assert along[braking.PLAN].point == pytest.approx((10.0 + preview, 2.0))
    assert along[braking.PATH].point == pytest.approx((10.0 + preview, 0.0))
    assert along[braking.NONE].point is None


def test_near_standstill_the_lookahead_point_keeps_its_least_distance(params, world):
    path = reference_path.build(world.straight().reference)
    lookahead = braking.lookahead_point(
        world.rolling(v=0.1, X=10.0), None, path, 10.0, params.braking
    )
    assert lookahead.point == pytest.approx((10.0 + params.braking.least_preview_m, 0.0))


def test_a_state_that_is_not_finite_has_no_lookahead_point(params, world):
    path = reference_path.build(world.straight().reference)
    assert braking.lookahead_point(world.rolling(X=np.nan), None, path, 0.0, params.braking) == (
        braking.NONE,
        None,
    )
