"""Obstacles as they are predicted: braking that is observed, the line of the road, memory."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from mpcc_controller.driving import obstacle_prediction
from mpcc_controller.driving.obstacle_prediction import MAX_DECELERATION, Tracks
from mpcc_controller.driving.records import unknown_state
from mpcc_controller.path import reference_path, road_edges
from mpcc_controller.problem.obstacle_motion import LEAST_SPEED_MPS, Line, PredictedObstacle
from mpcc_controller.problem.stage_parameters import Scene
from msgs_yaml.types import Obstacle, Obstacles, Reference, RoadEdges

MS = 1_000_000
TICK_NS, MEMORY_MS = 50 * MS, 300
CAR = Obstacle(id=3, X=10.0, Y=-2.0, r_obs=1.05, vX=12.0, vY=-5.0)
CONE = Obstacle(id=4, X=30.0, Y=1.0, r_obs=0.3, vX=0.0, vY=0.0)
SPEED = 13.0  # of CAR
ANGLES = np.arange(0.0, 3.0, 0.02)
# a circle of 40 m to the left that begins at the origin along x
CIRCLE = Line(40 * ANGLES, 40 * np.sin(ANGLES), 40 * (1 - np.cos(ANGLES)))


class Observer:
    """What is known of obstacles from message to message; without a path on no road."""

    def __init__(self, params, path=None, road=None, **surroundings):
        off = dict.fromkeys(('memory_s', 'braking_window_s', 'follow_road_rad'))
        surroundings = replace(params.surroundings, **off | surroundings)
        self.params, self.place = replace(params, surroundings=surroundings), (path, road)
        self.tracks = Tracks()

    def see(self, *messages):
        """Return the obstacles that are known after messages, at the stamp of the last one."""
        for seen in messages:
            scene, now = Scene(*self.place, seen), (unknown_state(0), seen.stamp_ns, self.params)
            self.tracks = obstacle_prediction.observe(self.tracks, scene, *now)
        return obstacle_prediction.scene_at(self.tracks, scene, seen.stamp_ns).obstacles.items


def test_an_obstacle_of_constant_velocity_moves_on_a_straight_line():
    car = PredictedObstacle(*CAR)
    X, Y = car.position(np.array([0.0, 0.5, 2.0]))
    assert (X.tolist(), Y.tolist()) == ([10.0, 16.0, 34.0], [-2.0, -4.5, -12.0])
    assert car.velocity(2.0) == (12.0, -5.0)
    assert car.moved(0.5) == car._replace(X=16.0, Y=-4.5)


@settings(max_examples=30)
@given(st.floats(0.1, MAX_DECELERATION), st.floats(0.01, 4.0), st.floats(0.0, 3.0))
def test_a_braking_obstacle_moves_as_its_speed_integrates_and_then_stands(braking, t, later):
    """The reference integrates dv/dt = -braking until the speed is 0."""
    driven = solve_ivp(lambda _, s: [max(SPEED - braking * s[1], 0.0), 1.0], (0, t), (0, 0),
                       rtol=1e-9, atol=1e-9, max_step=0.02).y[0, -1]  # fmt: skip
    start = PredictedObstacle(*CAR, braking=braking)
    X, Y = start.position(t)
    assert np.hypot(X - CAR.X, Y - CAR.Y) == pytest.approx(driven, abs=1e-4)
    assert (X - CAR.X) * CAR.vY == pytest.approx((Y - CAR.Y) * CAR.vX, abs=1e-9)
    in_steps = np.array(start.moved(t).position(later))
    # a car below LEAST_SPEED_MPS stands: it would have moved by v^2 / 2 a
    slack = LEAST_SPEED_MPS**2 / (2 * braking) + 1e-9
    assert np.hypot(*(in_steps - start.position(t + later))) <= slack


@pytest.mark.parametrize(
    ('start', 'accuracy'),
    [
        (PredictedObstacle(*CAR, braking=4.0), 1e-6),
        (PredictedObstacle(1, 0.0, 0.0, 1.0, 10.0, 0.0, line=CIRCLE), 0.3),
        (PredictedObstacle(1, 0.0, 0.0, 1.0, 10.0, 0.0, braking=4.0, line=CIRCLE), 0.3),
    ],
    ids=['braking', 'on a circle', 'braking on a circle'],
)
def test_the_velocity_is_the_derivative_of_the_position(start, accuracy):
    t, h = np.array([0.3, 1.1, 2.2, 4.0]), 1e-4
    if start.line is not None:
        angle = (10.0 * t - start.braking * np.minimum(t, 2.5) ** 2 / 2) / 40.0
        X, Y = start.position(t[:3])
        assert pytest.approx(40 * np.sin(angle[:3]), abs=0.01) == X
        assert pytest.approx(40 * (1 - np.cos(angle[:3])), abs=0.01) == Y
    for instant in t:
        rate = (np.array(start.position(instant + h)) - start.position(instant - h)) / (2 * h)
        assert start.velocity(instant) == pytest.approx(rate, abs=accuracy)
        later = np.array(start.moved(instant).position(0.2))
        assert later == pytest.approx(np.array(start.position(instant + 0.2)), abs=1e-9)


def slowing(deceleration, ticks, first=0, deviation=0.0, seed=0):
    """Messages of CAR, 50 ms apart: it slows down; white noise of its velocity as of a tracker."""
    rng = np.random.default_rng(seed)
    for tick in range(first, first + ticks):
        share = 1 - deceleration * 0.05 * max(tick, 0) / SPEED
        vX, vY = share * np.array([12.0, -5.0]) + deviation * rng.standard_normal(2)
        yield Obstacles((tick - first) * TICK_NS + 1, (CAR._replace(vX=vX, vY=vY),))


def braking_after(params, messages, window_s=1.0):
    """Return the deceleration that is predicted after the last of the messages; 0 for none."""
    (item,) = Observer(params, braking_window_s=window_s).see(*messages)
    return item.braking


@pytest.mark.parametrize('deceleration', [0.5, 3.0, 8.0])
def test_a_constant_deceleration_is_observed_from_three_messages_on(params, deceleration):
    seen = [braking_after(params, slowing(deceleration, count)) for count in range(1, 7)]
    # two speeds always lie on a line
    assert seen == pytest.approx([0, 0] + 4 * [deceleration])


def speeds_at(*ticks_and_shares):
    return [
        Obstacles(tick * TICK_NS + 1, (CAR._replace(vX=12 * share, vY=-5 * share),))
        for tick, share in ticks_and_shares
    ]


BRAKING = [*slowing(5.0, 3)]


@pytest.mark.parametrize(
    ('messages', 'window_s', 'deceleration'),
    [
        pytest.param([*slowing(0.0, 4)], 1.0, 0.0, id='keeps its speed'),
        pytest.param([*slowing(-2.0, 4)], 1.0, 0.0, id='gets faster'),
        pytest.param(
            [*slowing(6.0, 10), *speeds_at(*((k, 1.0) for k in range(10, 20)))],
            1.0,
            0.0,
            id='braked before',
        ),
        pytest.param(
            [*slowing(6.0, 10), *speeds_at((50, 0.9), (51, 0.9))], 1.0, 0.0, id='was lost'
        ),
        pytest.param(
            speeds_at((0, 1.0), (1, 0.6), (2, 0.2)), 1.0, MAX_DECELERATION, id='impossibly hard'
        ),
        pytest.param(speeds_at((0, 1.0), (1, 0.5), (2, 0.0)), 1.0, 0.0, id='stands'),
        pytest.param([BRAKING[2], BRAKING[0], BRAKING[0]], 1.0, 0.0, id='the clock is set back'),
        pytest.param([*BRAKING, BRAKING[2]], 1.0, 5.0, id='a message is repeated'),
        pytest.param(BRAKING, None, 0.0, id='without the parameter'),
    ],
)
def test_what_the_last_messages_lead_to(params, messages, window_s, deceleration):
    assert braking_after(params, messages, window_s) == pytest.approx(deceleration)


@pytest.mark.parametrize('deviation', [0.1, 0.3])
def test_braking_is_seen_through_the_noise_of_a_tracker_within_a_second(params, deviation):
    noise = [braking_after(params, slowing(0.0, 20, 0, deviation, seed)) for seed in range(200)]
    assert np.count_nonzero(noise) <= 2
    for deceleration in (2.0, 5.0):
        messages = (slowing(deceleration, 40, -19, deviation, seed) for seed in range(20))
        seen = np.array([braking_after(params, each) for each in messages])
        assert np.mean(seen > 0.5 * deceleration) > 0.9


def place(radius, side, s, offset):
    """Return X, Y and heading beside a straight of 30 m and a bend to the left (1) or right."""
    angle = np.maximum(s - 30.0, 0.0) / radius
    X = np.minimum(s, 30.0) + radius * np.sin(angle)
    Y, psi = side * radius * (1 - np.cos(angle)), side * angle
    return X - offset * np.sin(psi), Y + offset * np.cos(psi), psi


def bend(radius, side):
    """Return path and road of that bend."""
    s = np.arange(0.0, 150.0, 1.0)
    path = reference_path.build(Reference(0, *place(radius, side, s, 0.0), s / 10.0))
    left, right = (np.column_stack(place(radius, side, s, e)[:2]) for e in (5.25, -1.75))
    return path, road_edges.build(RoadEdges(0, left, right))


def on_bend(obstacle, radius, side, params, follow_road_rad=0.35):
    observer = Observer(params, *bend(radius, side), follow_road_rad=follow_road_rad)
    (item,) = observer.see(Obstacles(1, (obstacle,)))
    return item


@pytest.mark.parametrize('radius', [40.0, 120.0])
@pytest.mark.parametrize('side', [1, -1])
@pytest.mark.parametrize(
    ('way', 'offset', 'station'),
    [(-1, 3.5, 80.0), (1, 0.0, 20.0)],
    ids=['comes out of the bend', 'drives into the bend'],
)
def test_a_car_in_its_lane_stays_in_it(params, radius, side, way, offset, station):
    X, Y, psi = place(radius, side, station, offset)
    v, kappa, T = 10.0, side / radius, np.linspace(0.0, 2.5, 26)
    car = Obstacle(1, X, Y, 1.0, way * v * np.cos(psi), way * v * np.sin(psi))
    X, Y = on_bend(car, radius, side, params).position(T)
    # along the path, in steps, since its rate changes where the bend begins
    s = [station]
    for _ in range(2500):
        s.append(s[-1] + way * v * 0.001 / (1 - kappa * offset * (s[-1] > 30.0)))
    wanted = place(radius, side, np.array(s[::100]), offset)
    assert np.max(np.hypot(X - wanted[0], Y - wanted[1])) < 0.15
    straight_on = np.hypot(car.X + car.vX * T - wanted[0], car.Y + car.vY * T - wanted[1])
    assert np.max(straight_on) > 2.0 * 0.15


@pytest.mark.parametrize(
    ('station', 'offset', 'turned', 'speed', 'follow_road_rad'),
    [
        pytest.param(60.0, 3.5, 1.57, 1.5, 0.35, id='pedestrian'),
        pytest.param(60.0, 9.0, 0.0, 10.0, 0.35, id='beside the road'),
        pytest.param(60.0, 0.0, 0.0, 0.0, 0.35, id='standing'),
        pytest.param(5.0, 0.0, 0.1, 5.0, 0.35, id='on the straight'),
        pytest.param(60.0, 0.0, 0.0, 10.0, None, id='without the parameter'),
    ],
)
def test_others_go_straight_on(params, station, offset, turned, speed, follow_road_rad):
    X, Y, psi = place(80.0, 1, station, offset)
    course = psi + turned
    o = Obstacle(1, X, Y, 0.5, speed * np.cos(course), speed * np.sin(course))
    assert on_bend(o, 80.0, 1, params, follow_road_rad) == PredictedObstacle(*o)


# what vanishes from the message


def message(at_ms, *items):
    return Obstacles(at_ms * MS, items)


@settings(max_examples=30)
@given(missed_ms=st.integers(1, MEMORY_MS), deceleration=st.sampled_from([0.0, 2.0, 8.0]))
def test_an_obstacle_that_vanishes_goes_on_as_it_was_predicted_to(params, missed_ms, deceleration):
    """The reference is the motion that was predicted when it was seen last."""
    observer = Observer(params, memory_s=MEMORY_MS / 1000, braking_window_s=1.0)
    (last,) = observer.see(*slowing(deceleration, 4))
    assert last.braking == pytest.approx(deceleration)
    seen, remembered = observer.see(message(150 + missed_ms, CONE))
    assert seen == PredictedObstacle(*CONE)
    t = missed_ms / 1000 - 1e-9  # the messages of `slowing` are 1 ns late
    # a braking car counts as standing below 0.5 m/s, at most 0.25 m before it does
    atol = 0.26 if deceleration else 1e-9
    np.testing.assert_allclose((remembered.X, remembered.Y), last.position(t), atol=atol)
    assert (remembered.id, remembered.r_obs) == (CAR.id, CAR.r_obs)


def test_it_is_forgotten_when_the_memory_is_over(params):
    """Its age counts from when it was last in a message, not from when it was last remembered."""
    observer = Observer(params, memory_s=MEMORY_MS / 1000)
    observer.see(message(0, CAR))
    for at_ms in range(50, MEMORY_MS + 1, 50):
        for _ in range(2):  # to ask again for the same message changes nothing
            (remembered,) = observer.see(message(at_ms))
            assert pytest.approx(10 + 12 * at_ms / 1000) == remembered.X
    assert observer.see(message(MEMORY_MS + 50)) == ()
    here = CAR._replace(X=14.0)
    observer.see(message(400, CAR))
    known = observer.see(message(450, here, CONE))
    assert known == (PredictedObstacle(*here), PredictedObstacle(*CONE))


@pytest.mark.parametrize(
    ('memory_s', 'at_ms'), [(MEMORY_MS / 1000, -50), (None, 50), (0.0, 50), (None, 0)]
)
def test_nothing_is_remembered_without_a_memory_or_when_the_clock_is_set_back(
    params, memory_s, at_ms
):
    observer = Observer(params, memory_s=memory_s, braking_window_s=1.0)
    observer.see(message(0, CAR))
    assert observer.see(message(at_ms)) == ()
