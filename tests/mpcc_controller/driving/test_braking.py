"""The last fallback level: friction-limited braking that still steers."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mpcc_controller.driving import braking, setpoints
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
    rates = {'limits__force_rate_nps': 1e7, 'limits__steer_rate_radps': 10.0}
    return world.load(model__step_s=0.2, **rates)[0]


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
    x, ahead = world.rolling(v=v, r=r, vy=vy), Point(30.0, aside)
    target = braking.braking_target(x, REST, ahead, car, slow_params)
    most = slow_params.braking.lateral_use * braking.max_acceleration(car, slow_params.limits)
    lateral = abs(braking.lateral_acceleration(x, ahead, most))
    assert lateral <= most
    assert max(use(target, lateral, car)) <= slow_params.limits.friction_use * (1 + 1e-6)
    assert target.Fx <= 0
    assert np.isfinite(target).all()


def test_the_brakes_of_a_car_that_cannot_steer_take_all_friction_unless_the_line_bends_further(
    car, slow_params, world
):
    x = world.rolling(v=20.0, r=0.15)

    def used(aside, steers):
        target = braking.braking_target(x, REST, Point(15.0, aside), car, slow_params, steers)
        return max(use(target, 0.0, car))

    assert used(0.0, False) == used(-3.0, False) == pytest.approx(1.0, rel=1e-4)
    further = used(3.0, False)  # what the bend that it drives now needs stays
    assert used(3.0, True) < further < slow_params.limits.friction_use


def test_braking_is_as_hard_as_the_friction_beside_the_cornering_or_the_brakes_allow(
    car, params, world
):
    limits, forces = params.limits, []
    for lateral in np.arange(0, 8, 0.5):
        forces.append(braking.max_braking_force(lateral, car, limits))
        share = float(single_track.ideal_split(-forces[-1], car))
        share = np.clip(share, limits.brake_front_share_min, limits.brake_front_share_max)
        used = max(use(SetpointTarget(0.0, -forces[-1], share), lateral, car))
        assert used == pytest.approx(limits.friction_use, rel=1e-4)
    assert np.all(np.diff(forces) < 0)
    beyond = 1.01 * braking.max_acceleration(car, limits)
    assert braking.max_braking_force(beyond, car, limits) == 0.0
    weak = world.load(limits__brake_n=5000.0)[0].limits
    assert braking.max_braking_force(0.0, car, weak) == pytest.approx(5000.0, rel=1e-6)


@quick
@given(
    v=st.floats(3, 30),
    radius=st.floats(20, 500),
    side=st.sampled_from([-1, 1]),
    slip=st.floats(-0.5, 0.5),
    heading=st.floats(-3, 3),
)
def test_the_lateral_acceleration_is_that_of_the_circle_from_the_direction_of_motion(
    world, v, radius, side, slip, heading
):
    """The circle touches the velocity, wherever the car is and points to."""
    x = world.rolling(v=v * np.cos(slip), vy=v * np.sin(slip), X=3.0, Y=-1.0, psi=heading)
    course, angle = heading + slip, 15.0 / radius
    ahead, aside = radius * np.sin(angle), side * radius * (1 - np.cos(angle))
    there = Point(
        3.0 + ahead * np.cos(course) - aside * np.sin(course),
        -1.0 + ahead * np.sin(course) + aside * np.cos(course),
    )
    assert braking.lateral_acceleration(x, there, np.inf) == pytest.approx(side * v**2 / radius)
    assert braking.lateral_acceleration(x, Point(x.X, x.Y), 9.0) == 0.0


@quick
@given(
    lateral=st.floats(-15, 15),
    v=st.floats(12, 40),
    r=st.floats(-0.8, 0.8),
    vy=st.floats(-1.5, 1.5),
    Fx=st.floats(-12e3, 0),
    compliance=st.sampled_from([0.0, 1e-5]),
)
def test_the_steering_angle_gives_the_front_axle_the_demanded_force_or_all_it_has(
    car, lateral, v, r, vy, Fx, compliance
):
    """The tyre model at this angle returns the force, however the car moves."""
    car = car._replace(compliance=compliance)
    x = State(0.0, 0.0, 0.0, v, vy, r, 0.0, 0.0, Fx)
    x = x._replace(delta=braking.steering_angle(x, lateral, Fx, 0.6, car))
    force = float(single_track.tyre_forces(x, Input(0.0, 0.0, 0.6, 0.0), car).F_yf)
    load = single_track.loads(Fx, car).f
    most = np.sqrt((car.mu_f * load) ** 2 - (0.6 * Fx) ** 2)
    wanted = np.clip(car.m * lateral * car.l_r / (car.l_f + car.l_r), -most, most)
    assert force == pytest.approx(wanted, rel=0.02, abs=60.0)


def test_at_walking_pace_and_without_side_force_it_is_the_angle_of_the_arc_or_the_motion(
    car, world
):
    slow = braking.steering_angle(world.rolling(v=0.5), 1.25, 0.0, 0.6, car)
    assert slow == pytest.approx(np.arctan((car.l_f + car.l_r) / 20.0), rel=0.15)
    locked = braking.steering_angle(world.rolling(r=0.2, vy=0.5), 5.0, -99e3, 1.0, car)
    assert locked == pytest.approx(np.arctan2(0.5 + car.l_f * 0.2, 20.0), abs=1e-9)


def test_braking_builds_up_and_is_released_for_a_bend_at_the_rate_limits(params, car, world):
    push, turn = params.limits.force_rate_nps * 0.05, params.limits.steer_rate_radps * 0.05
    first = braking.braking_target(world.rolling(), Setpoints(0.3, 2000.0), None, car, params)
    assert first[:2] == pytest.approx((0.3 - turn, 2000.0 - push))
    bend, hard = Point(14.0, 2.5), Setpoints(0.1, -16000.0)
    less = braking.braking_target(world.rolling(r=0.4), hard, bend, car, params)
    assert less.Fx == pytest.approx(-16000.0 + push)


def test_without_a_point_or_a_state_the_wheels_go_straight_and_cornering_reduces_the_force(
    slow_params, params, car, world
):
    for x, point in ((world.rolling(), None), (world.rolling(r=np.nan), Point(9.0, 9.0))):
        target = braking.braking_target(x, Setpoints(0.02, 0.0), point, car, params)
        assert target.delta == 0.0
        assert target.Fx < 0
    straight, turning = (
        braking.braking_target(world.rolling(r=r), REST, None, car, slow_params) for r in (0.0, 0.3)
    )
    usable = slow_params.limits.friction_use * min(car.mu_f, car.mu_r) * car.m * GRAVITY
    assert straight.Fx == pytest.approx(-usable, rel=0.05)
    assert turning.Fx > straight.Fx + 1000


@quick
@given(st.floats(-15000, 0), st.floats(0.4, 0.9))
def test_the_limited_split_keeps_both_axles_within_the_friction(params, car, Fx, lambda_b):
    def used(Fx, share):
        return use(SetpointTarget(0.0, Fx, share), 0.0, car)

    limited = setpoints.split_within_friction(lambda_b, Fx, car, params.limits)
    assert max(used(Fx, limited)) <= params.limits.friction_use * (1 + 1e-9)
    if max(used(Fx, lambda_b)) <= params.limits.friction_use:
        assert limited == pytest.approx(lambda_b)
    # a force beyond the friction is split like that
    front, rear = used(-25e3, setpoints.split_within_friction(lambda_b, -25e3, car, params.limits))
    assert front == pytest.approx(rear)


def test_the_target_of_a_plan_is_the_end_of_its_first_step(params, car):
    X, U = np.zeros((3, 9)), np.zeros((2, 4))
    X[1] = State(0, 0, 0, 20, 0, 0, 0, 0.02, -1000.0)
    U[0] = Input(0.4, -2e4, 0.55, 0)
    target = setpoints.target_of_plan(Plan(X, U), car, params.limits)
    command = setpoints.command_to(target, Setpoints(0.0, 0.0), car, 0.05, 7)
    assert command == pytest.approx((7, 0.02, 0.4, -550.0, -450.0))


# the lookahead point


@pytest.mark.parametrize(
    ('position', 'distance', 'expected'),
    [
        ((2.0, 1.0), 4.0, (6.0, 0.0)),
        ((2.0, 1.0), 12.0, (10.0, 4.0)),
        ((11.0, 9.0), 5.0, (10.0, 14.0)),  # straight on past the end
        ((-3.0, 1.0), 4.0, (4.0, 0.0)),
    ],
)
def test_the_lookahead_point_is_on_the_line_so_far_after_the_foot(position, distance, expected):
    line = np.array([[0.0, 0.0], [10.0, 0.0], [10.0, 0.0], [10.0, 10.0]])
    assert braking.point_ahead(line, *position, distance) == pytest.approx(expected)
    assert braking.point_ahead(np.ones((3, 2)), *position, distance) == (1.0, 1.0)


@pytest.mark.parametrize('speed', [20.0, 0.1])
def test_the_lookahead_point_is_taken_from_the_plan_else_from_the_path(params, world, speed):
    x, rules = world.rolling(v=speed, X=10.0), params.braking
    X = np.zeros((51, len(State._fields)))
    X[:, 0], X[:, 1] = np.linspace(0, 50, 51), 2.0
    plan = Plan(X, np.zeros((50, 4)))
    path = reference_path.build(world.straight().reference)
    preview = max(rules.preview_s * speed, rules.least_preview_m)
    for line, Y, arguments in (
        (braking.PLAN, 2.0, (plan, path, 10.0)),
        (braking.PATH, 0.0, (None, path, 10.0)),
    ):
        taken, point = braking.lookahead_point(x, *arguments, rules)
        assert taken == line
        assert point == pytest.approx((10.0 + preview, Y))
    assert braking.lookahead_point(x, None, None, None, rules) == (braking.NONE, None)
    unknown = x._replace(X=np.nan)
    assert braking.lookahead_point(unknown, None, path, 0.0, rules) == (braking.NONE, None)
