"""Obstacles over the horizon: constant velocity, and braking that is observed."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from mpcc_controller.problem.obstacle_motion import (
    LEAST_SPEED_MPS,
    MAX_DECELERATION,
    ExpectedObstacle,
    Line,
    expected,
    moved,
    observed,
    position,
    velocity,
)
from msgs_yaml.types import Obstacle, Obstacles

TICK_NS = 50_000_000
CAR = Obstacle(id=3, X=10.0, Y=-2.0, r_obs=1.05, vX=12.0, vY=-5.0)
SPEED = 13.0  # of CAR


@pytest.fixture
def observer():
    return Observer(1.0)


class Observer:
    """The speeds of obstacles that were observed."""

    def __init__(self, window_s):
        self.window_s, self.speeds = window_s, {}

    def observe(self, message):
        self.speeds = observed(self.speeds, message, self.window_s)

    def predict(self, message):
        return expected(message, self.speeds)


def slowing(deceleration, ticks, first=0):
    """Messages of CAR, which slows down at a constant rate, 50 ms apart."""
    for tick in range(first, first + ticks):
        share = 1 - deceleration * 0.05 * tick / SPEED
        yield Obstacles(tick * TICK_NS + 1, (CAR._replace(vX=12 * share, vY=-5 * share),))


def test_an_obstacle_of_constant_velocity_moves_on_a_straight_line():
    X, Y = position(CAR, np.array([0.0, 0.5, 2.0]))
    np.testing.assert_array_equal(X, [10.0, 16.0, 34.0])
    np.testing.assert_array_equal(Y, [-2.0, -4.5, -12.0])


@settings(max_examples=30)
@given(st.floats(0.1, MAX_DECELERATION), st.floats(0.01, 4.0))
def test_a_braking_obstacle_moves_as_its_speed_integrates_and_then_stands(braking, t):
    """The reference integrates dv/dt = -braking until the speed is 0."""
    moved = solve_ivp(lambda _, s: [max(SPEED - braking * s[1], 0.0), 1.0], (0, t), (0, 0),
                      rtol=1e-9, atol=1e-9, max_step=0.02).y[0, -1]  # fmt: skip
    X, Y = position(ExpectedObstacle(*CAR, braking=braking), t)
    assert np.hypot(X - CAR.X, Y - CAR.Y) == pytest.approx(moved, abs=1e-4)
    assert (X - CAR.X) * CAR.vY == pytest.approx((Y - CAR.Y) * CAR.vX, abs=1e-9)


@settings(max_examples=50)
@given(st.floats(0.1, MAX_DECELERATION), st.floats(0.0, 3.0), st.floats(0.0, 3.0))
def test_to_move_an_obstacle_first_does_not_change_where_it_stops(braking, first, later):
    start = ExpectedObstacle(*CAR, braking=braking)
    at_once = np.array(position(start, first + later))
    in_steps = np.array(position(moved(start, first), later))
    # a car below LEAST_SPEED_MPS stands: it would have moved by v^2 / 2 a
    assert np.hypot(*(at_once - in_steps)) <= LEAST_SPEED_MPS**2 / (2 * braking) + 1e-9


def circle(radius):
    """Return the line of a circle to the left that begins at the origin along x."""
    angle = np.arange(0.0, 3.0, 0.02)
    return Line(radius * angle, radius * np.sin(angle), radius * (1 - np.cos(angle)))


@pytest.mark.parametrize('braking', [0.0, 4.0])
def test_an_obstacle_stays_on_its_line(braking):
    start = ExpectedObstacle(1, 0.0, 0.0, 1.0, 10.0, 0.0, braking, circle(40.0))
    t, h = np.array([0.3, 1.1, 2.2]), 1e-4
    X, Y = position(start, t)
    angle = (10.0 * t - braking * t**2 / 2) / 40.0
    np.testing.assert_allclose(X, 40 * np.sin(angle), atol=0.01)
    np.testing.assert_allclose(Y, 40 * (1 - np.cos(angle)), atol=0.01)
    for instant in t:
        first = moved(start, instant)
        np.testing.assert_allclose(position(first, 0.2), position(start, instant + 0.2), atol=1e-9)
        rate = (np.array(position(start, instant + h)) - position(start, instant - h)) / (2 * h)
        np.testing.assert_allclose((first.vX, first.vY), rate, atol=0.3)


def test_the_velocity_is_the_derivative_of_the_position():
    braking, h = ExpectedObstacle(*CAR, braking=4.0), 1e-6
    for t in (0.5, 2.0, 3.2, 4.0):
        difference = (np.array(position(braking, t + h)) - position(braking, t - h)) / (2 * h)
        np.testing.assert_allclose(velocity(braking, t), difference, atol=1e-6)
        assert velocity(CAR, t) == (12.0, -5.0)


@pytest.mark.parametrize('deceleration', [0.5, 3.0, 8.0])
def test_a_constant_deceleration_is_observed_from_three_messages_on(observer, deceleration):
    first, second, *others = slowing(deceleration, 6)
    for message in (first, second):  # two speeds always lie on a line
        observer.observe(message)
        assert observer.predict(message) == message
    for message in others:
        observer.observe(message)
        (predicted,) = observer.predict(message).items
        assert predicted.braking == pytest.approx(deceleration)
        assert predicted[:6] == message.items[0]


def test_an_obstacle_that_gets_faster_or_keeps_its_speed_keeps_its_velocity(observer):
    for deceleration in (-2.0, 0.0):
        observer.speeds = {}
        for message in slowing(deceleration, 4):
            observer.observe(message)
        assert observer.predict(message) == message


def test_only_the_last_window_counts(observer):
    for message in (*slowing(6.0, 10), *(m._replace(items=(CAR,)) for m in slowing(0.0, 10, 10))):
        observer.observe(message)
    assert observer.predict(message) == message


def test_an_impossible_deceleration_is_limited(observer):
    for stamp_ns, share in ((1, 1.0), (TICK_NS, 0.6), (2 * TICK_NS, 0.2)):
        item = CAR._replace(vX=CAR.vX * share, vY=CAR.vY * share)
        message = Obstacles(stamp_ns, (item,))
        observer.observe(message)
    assert observer.predict(message).items[0].braking == MAX_DECELERATION


def noisy(messages, deviation, seed):
    """Messages with white noise of the velocity, as of a tracker."""
    rng = np.random.default_rng(seed)
    for message in messages:
        (item,) = message.items
        dX, dY = deviation * rng.standard_normal(2)
        yield message._replace(items=(item._replace(vX=item.vX + dX, vY=item.vY + dY),))


@pytest.mark.parametrize('deviation', [0.1, 0.3])
def test_noise_of_a_tracker_is_not_taken_for_braking(observer, deviation):
    braking = []
    for message in noisy(slowing(0.0, 2000), deviation, seed=1):
        observer.observe(message)
        braking.append(observer.predict(message) != message)
    assert np.mean(braking) < 0.01


@pytest.mark.parametrize('deviation', [0.1, 0.3])
@pytest.mark.parametrize('deceleration', [2.0, 5.0])
def test_braking_is_seen_through_the_noise_within_a_second(deviation, deceleration):
    seen = []
    for seed in range(20):
        observer = Observer(1.0)
        for message in noisy(slowing(0.0, 20), deviation, seed):
            observer.observe(message)
        later = (m._replace(stamp_ns=m.stamp_ns + TICK_NS) for m in slowing(deceleration, 40, -19))
        messages = [*later][19:]
        for message in noisy(messages, deviation, seed + 100):
            observer.observe(message)
        (last,) = observer.predict(message).items
        seen.append(getattr(last, 'braking', 0.0))
    assert np.mean(np.array(seen) > 0.5 * deceleration) > 0.9


def test_a_clock_that_is_set_back_tells_nothing(observer):
    messages = list(slowing(5.0, 3))
    for message in (messages[2], messages[0], messages[0]):
        observer.observe(message)
    assert observer.predict(messages[0]) == messages[0]


def test_a_repeated_message_changes_nothing(observer):
    messages = list(slowing(5.0, 3))
    for message in (*messages, messages[2]):
        observer.observe(message)
    assert observer.predict(messages[2]).items[0].braking == pytest.approx(5.0)


def test_a_standing_obstacle_does_not_brake(observer):
    for stamp_ns, speed in ((1, 5.0), (TICK_NS, 0.0)):
        message = Obstacles(stamp_ns, (CAR._replace(vX=speed, vY=0.0),))
        observer.observe(message)
    assert observer.predict(message) == message


def test_without_the_parameter_nothing_is_observed():
    observer = Observer(None)
    for message in slowing(5.0, 3):
        observer.observe(message)
    assert observer.predict(message) is message
