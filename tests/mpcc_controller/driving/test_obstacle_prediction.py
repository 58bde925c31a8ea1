"""Obstacles as they are tracked and predicted: filter, existence, hypotheses, given predictions."""

from dataclasses import replace

import numpy as np
import pytest

from mpcc_controller.driving import obstacle_prediction, obstacle_tracks
from mpcc_controller.driving.obstacle_prediction import Tracks
from mpcc_controller.driving.records import unknown_state
from mpcc_controller.parameters import Tracker
from mpcc_controller.path import reference_path, road_edges
from mpcc_controller.problem.obstacle_motion import PredictedObstacle, moved, places
from mpcc_controller.problem.stage_parameters import Scene
from msgs_yaml.types import Branch, Obstacle, Obstacles, Reference, RoadEdges

MS = 1_000_000
TICK_S, TICK_NS = 0.05, 50 * MS
CAR = Obstacle(id=3, X=10.0, Y=-2.0, r_obs=1.05, vX=12.0, vY=-5.0)
CONE = Obstacle(id=4, X=30.0, Y=1.0, r_obs=0.3, vX=0.0, vY=0.0)
SPEED = 13.0  # of CAR
EXACT, NOISY = Tracker(0.05, 0.03, 3.0, 0.2, 0.1), Tracker(0.2, 0.5, 3.0, 0.05, 0.1)
T = np.linspace(0.0, 2.5, 26)


class Observer:
    """What is known of obstacles from message to message; without a path on no road."""

    def __init__(self, params, tracker=EXACT, path=None, road=None, predictions=()):
        surroundings = replace(params.surroundings, follow_road_rad=0.35)
        self.params = replace(params, surroundings=surroundings, tracker=tracker)
        self.place, self.tracks = (path, road), Tracks()
        self.predictions = {branch[0]: branch[1] for branch in predictions}

    def see(self, *messages):
        """Return the obstacles that are known after messages, at the stamp of the last one."""
        car = unknown_state(0)._replace(X=0.0, Y=0.0, vx=20.0)
        for seen in messages:
            scene = Scene(*self.place, seen, self.predictions)
            now = car, seen.stamp_ns, self.params
            self.tracks = obstacle_prediction.observe(self.tracks, scene, *now)
        return obstacle_prediction.scene_at(self.tracks, scene, seen.stamp_ns).obstacles.items


def messages(*obstacles):
    """Return messages of one obstacle each, a tick apart."""
    return [Obstacles(1 + TICK_NS * k, (o,)) for k, o in enumerate(obstacles)]


def moving(ticks, deviations=(0.0, 0.0), braking=0.0, first=0, seed=0):
    """Return CAR at ticks from `first` on, braking from tick 0 on, with white noise."""
    noise = np.repeat(deviations, 2) * np.random.default_rng(seed).standard_normal((ticks, 4))
    for tick, (dX, dY, dvX, dvY) in zip(range(first, first + ticks), noise):
        t = tick * TICK_S
        share = 1 - braking * max(t, 0) / SPEED
        s = t if t < 0 else t - braking * t**2 / 2 / SPEED
        place = CAR.X + 12 * s + dX, CAR.Y - 5 * s + dY
        yield CAR._replace(X=place[0], Y=place[1], vX=12 * share + dvX, vY=-5 * share + dvY)


def radius(o, t):
    """Return the radius of an obstacle in the problem `t` [s] from now."""
    return places((o,), np.array([t]))[2, 0, 0]


def test_without_a_tracker_obstacles_are_used_as_they_are_received(params):
    truck = CONE._replace(others=((2.0, 0.5),), vX=3.0)
    seen = Observer(params, params.tracker).see(Obstacles(1, (CAR, truck)))
    disc = truck._replace(others=())
    assert params.tracker.position_m is None
    assert seen == tuple(PredictedObstacle(*o) for o in (CAR, disc, disc._replace(X=32.0, Y=1.5)))
    X, Y = seen[0].position(np.array([0.0, 0.5, 2.0]))
    assert (X.tolist(), Y.tolist()) == ([10.0, 16.0, 34.0], [-2.0, -4.5, -12.0])
    assert moved(seen[:1], 0.5) == (seen[0]._replace(X=16.0, Y=-4.5),)


# the filter


@pytest.mark.parametrize('tracker', [EXACT, NOISY])
def test_the_filter_is_that_of_kalman_for_a_jerk_of_white_noise(tracker):
    """Its process noise is integrated here, over the time that is left to a jerk to act."""
    F = np.array([[1, TICK_S, TICK_S**2 / 2], [0, 1, TICK_S], [0, 0, 1]])
    s, w = np.polynomial.legendre.leggauss(5)
    s, w = TICK_S * (s + 1) / 2, TICK_S / 2 * w
    g = np.array([s**2 / 2, s, np.ones_like(s)])
    Q = tracker.jerk_mps3**2 * (g * w) @ g.T
    R, H = np.diag([tracker.position_m**2, tracker.velocity_mps**2]), np.eye(2, 3)
    mean, P = np.zeros((3, 2)), np.diag([*np.diag(R), obstacle_tracks.START_MPS2**2])
    known = {}
    for k, o in enumerate(moving(12, np.sqrt(np.diag(R)), braking=3.0, first=-4, seed=7)):
        known, z = obstacle_tracks.update(known, [o], TICK_S, tracker), [[o.X, o.Y], [o.vX, o.vY]]
        if k == 0:
            mean[:2] = z
        else:
            mean, P = F @ mean, F @ P @ F.T + Q
            gain = P @ H.T @ np.linalg.inv(H @ P @ H.T + R)
            mean, P = mean + gain @ (z - H @ mean), P - gain @ H @ P
    assert known[CAR.id].mean == pytest.approx(mean, rel=1e-6, abs=1e-6)
    assert known[CAR.id].covariance == pytest.approx(P, rel=1e-5)


# misses, ghosts, ids


@pytest.mark.parametrize('missed', [0.02, 0.05, 0.2, 0.5])
def test_the_oftener_obstacles_are_missed_the_longer_one_is_kept(params, missed):
    """As long as it is likelier that all messages missed it than that it is gone, 1 to 10,000."""
    observer = Observer(params, replace(EXACT, missed=missed))
    *_, last = seen = messages(*moving(10))
    (before, *_) = observer.see(*seen)
    kept = 0
    while True:
        known = observer.see(Obstacles(last.stamp_ns + TICK_NS * (kept + 1), (CONE,)))
        if CAR.id not in {o.id for o in known}:
            break
        kept += 1
        # it goes on as it was predicted to when it was seen
        place = before.position(TICK_S * kept)
        assert pytest.approx(place, abs=1e-6) == (known[0].X, known[0].Y)
    assert missed ** (kept + 1) <= 1e-4 < missed**kept


def test_a_ghost_is_avoided_while_it_is_seen_and_not_remembered(params):
    observer = Observer(params)
    assert {o.id for o in observer.see(Obstacles(1, (CAR, CONE)))} == {3, 4}
    assert {o.id for o in observer.see(Obstacles(1 + TICK_NS, (CAR,)))} == {3}


def test_a_message_that_is_repeated_changes_nothing_and_a_clock_set_back_forgets(params):
    observer, seen = Observer(params), messages(*moving(5))
    observer.see(*seen)
    tracks = observer.tracks
    observer.see(seen[-1])
    assert observer.tracks is tracks
    assert [o.id for o in observer.see(Obstacles(0, (CONE,)))] == [CONE.id]


def test_ids_that_two_obstacles_exchange_drag_neither_along(params):
    observer, other = Observer(params), CAR._replace(id=5, X=14.0, Y=2.0, vX=-12.0, vY=0.0)
    observer.see(*(Obstacles(k * TICK_NS + 1, (CAR, other)) for k in range(1)))
    swapped = CAR._replace(id=5), other._replace(id=3)
    known = {o.id: o for o in observer.see(Obstacles(TICK_NS, swapped))}
    for o in swapped:
        assert known[o.id][1:6] == pytest.approx(o[1:6])


def test_obstacles_are_predicted_together_as_each_is_alone(params):
    """One that turns, one that brakes, one that stands, and a truck."""
    times = TICK_S * np.arange(20)
    turning = [
        Obstacle(1, 20 * np.sin(a), -20 * np.cos(a), 1.0, 8 * np.cos(a), 8 * np.sin(a), ((-3, 1),))
        for a in 0.4 * times
    ]
    truck = [Obstacle(5, 90.0 - 4 * t, 2.0, 1.0, -4.0, 0.0, ((2.0, 0.5),)) for t in times]
    each = [*zip(turning, moving(20, braking=5.0, first=-10), [CONE] * 20, truck)]
    together = Observer(params).see(*(Obstacles(1 + TICK_NS * k, o) for k, o in enumerate(each)))
    alone = [d for seen in zip(*each) for d in Observer(params).see(*messages(*seen))]
    assert [(d.id, d.probability) for d in together] == [(d.id, d.probability) for d in alone]
    assert places(together, T) == pytest.approx(places(alone, T), abs=1e-9)
    for disc, table in zip(together, places(together, T).transpose(1, 0, 2)):
        assert np.array(disc.position(T)) == pytest.approx(table[:2])


# hypotheses


def likely(discs):
    """Return the first disc of every hypothesis, the likeliest first."""
    places = {o.probability: o for o in reversed(discs)}
    return [places[p] for p in sorted(places, reverse=True)]


@pytest.mark.parametrize('deceleration', [3.0, 8.0])
def test_braking_that_is_observed_goes_on_until_the_obstacle_stands(params, deceleration):
    seen = [*moving(13, braking=deceleration, first=-6)]
    (found, *_) = Observer(params).see(*messages(*seen))
    now = seen[-1]
    v = np.hypot(now.vX, now.vY)
    t = min(v / deceleration, 2.5)
    X, Y = found.position(2.5)
    driven = np.hypot(X - now.X, Y - now.Y)
    assert driven == pytest.approx(v * t - deceleration * t**2 / 2, abs=0.5)
    assert found.probability > 0.9


@pytest.mark.parametrize('deviations', [(0.05, 0.1), (0.2, 0.5)])
def test_braking_is_seen_through_the_noise_of_a_tracker_within_a_second(params, deviations):
    tracker = replace(EXACT, position_m=deviations[0], velocity_mps=deviations[1])

    def gaps(braking, ticks, first):
        for seed in range(20):
            seen = moving(ticks, deviations, braking, first, seed)
            found = likely(Observer(params, tracker).see(*messages(*seen)))
            yield [np.hypot(o.position(2.0)[0] - o.X, o.position(2.0)[1] - o.Y) for o in found]

    # the likeliest keeps the speed; at 5 m/s^2 there is one that stops in time
    assert np.mean([first > 0.85 * 2 * SPEED for first, *_ in gaps(0.0, 20, -20)]) > 0.9
    stops = 8.0**2 / (2 * 5.0)
    assert np.mean([min(found) < 1.7 * stops for found in gaps(5.0, 40, -19)]) > 0.9


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


def along(radius, side, way, offset, station, v=10.0):
    """Return the stations at times of a car that keeps its offset, in steps."""
    s = [station]
    for _ in range(2500):
        kappa = side / radius * (s[-1] > 30.0)
        s.append(s[-1] + way * v * 0.001 / (1 - kappa * offset))
    return np.array(s[::100])


def truck_at(radius, side, way, offset, station, lengths, v=10.0):
    """Return an obstacle of discs along the road."""
    X, Y, psi = place(radius, side, station - way * np.array([0.0, *lengths]), offset)
    others = tuple(zip(X[1:] - X[0], Y[1:] - Y[0]))
    return Obstacle(
        1, X[0], Y[0], 1.0, *way * v * np.array([np.cos(psi[0]), np.sin(psi[0])]), others
    )


@pytest.mark.parametrize('radius', [40.0, 120.0])
@pytest.mark.parametrize('side', [1, -1])
@pytest.mark.parametrize(
    ('way', 'offset', 'station'),
    [(-1, 3.5, 80.0), (1, 0.0, 20.0)],
    ids=['comes out of the bend', 'drives into the bend'],
)
@pytest.mark.parametrize('lengths', [(), (4.0, 12.0)], ids=['car', 'truck'])
def test_an_obstacle_in_its_lane_stays_in_it(params, radius, side, way, offset, station, lengths):
    """Each of its discs from where it is; no other hypothesis is likely."""
    begin = station - way * 0.1 * np.arange(10.0)[::-1]
    seen = [truck_at(radius, side, way, offset, s, lengths) for s in begin]
    discs = Observer(params, EXACT, *bend(radius, side)).see(
        *(Obstacles(1 + 10 * MS * k, (o,)) for k, o in enumerate(seen))
    )
    assert len(discs) == 1 + len(lengths)
    for disc, behind in zip(discs, (0.0, *lengths)):
        s = along(radius, side, way, offset, station - way * behind)
        X, Y = disc.position(T)
        wanted = place(radius, side, s, offset)
        assert np.max(np.hypot(X - wanted[0], Y - wanted[1])) < 0.2


@pytest.mark.parametrize(
    ('turned', 'speed', 'offset'),
    [
        pytest.param(1.57, 1.5, 3.5, id='pedestrian'),
        pytest.param(0.0, 10.0, 9.0, id='beside the road'),
        pytest.param(0.5, 10.0, 0.0, id='across'),
    ],
)
def test_others_go_straight_on(params, turned, speed, offset):
    X, Y, psi = place(80.0, 1, 60.0, offset)
    v = speed * np.array([np.cos(psi + turned), np.sin(psi + turned)])
    seen = [Obstacle(1, X + v[0] * t, Y + v[1] * t, 0.5, *v) for t in TICK_S * np.arange(8)]
    (found,) = Observer(params, EXACT, *bend(80.0, 1)).see(*messages(*seen))
    wanted = seen[-1].X + v[0] * T, seen[-1].Y + v[1] * T
    assert np.max(np.hypot(*np.array(found.position(T)) - wanted)) < 0.1


def test_one_that_turns_off_the_road_goes_on_turning_or_straight(params):
    radius, v = 20.0, 8.0
    angle = v / radius * TICK_S * np.arange(20)
    seen = [
        Obstacle(1, radius * np.sin(a), -radius * np.cos(a), 1.0, v * np.cos(a), v * np.sin(a))
        for a in angle
    ]
    found = likely(Observer(params).see(*messages(*seen)))
    later = angle[-1] + v / radius * T
    turns = np.array([radius * np.sin(later), -radius * np.cos(later)])
    now = seen[-1]
    straight = np.array([now.X + now.vX * T, now.Y + now.vY * T])
    for wanted in (turns, straight):
        assert min(np.max(np.hypot(*o.position(T) - wanted)) for o in found) < 0.8


def test_what_stands_is_not_moved_on_by_the_noise_of_its_velocity(params):
    noise = np.random.default_rng(5).standard_normal((20, 4)) * [0.2, 0.2, 0.5, 0.5]
    seen = [CONE._replace(X=30 + x, Y=1 + y, vX=vX, vY=vY) for x, y, vX, vY in noise]
    (found, *others) = Observer(params, NOISY).see(*messages(*seen))
    assert found.probability + sum(o.probability for o in others) < 1.0 + 1e-9
    X, Y = found.position(T)
    assert np.ptp(X) == np.ptp(Y) == 0.0
    assert (X[0], Y[0]) == pytest.approx((30.0, 1.0), abs=0.3)


def test_an_obstacle_is_beyond_its_disc_with_the_given_probability_at_most(params):
    """Of cars whose velocity is measured with noise, in any one direction, 1 and 2 s ahead."""
    beyond = []
    for seed in range(150):
        seen = [*moving(20, (0.2, 0.5), seed=seed)]
        found, *_ = Observer(params, NOISY).see(*messages(*seen))
        for t in (1.0, 2.0):
            at = 19 * TICK_S + t
            X, Y = found.position(t)
            aside = (5 * (CAR.X + 12 * at - X) + 12 * (CAR.Y - 5 * at - Y)) / 13
            beyond.append(aside > radius(found, t) - CAR.r_obs)
    assert np.mean(beyond) < NOISY.contact
    well, *_ = Observer(params).see(*messages(*moving(20)))
    assert 0.0 < radius(well, 2.5) - well.r_obs < 0.2


# predictions from outside


def branch(probability, Y, stamp_ns=1, variance=0.04):
    t = np.array([0.0, 1.0, 2.0])
    covariance = variance * np.array([np.diag([0.5, 1.0])] * 3)
    return Branch(stamp_ns, probability, t, CAR.X + 10 * t, np.array(Y), covariance)


def test_predictions_from_outside_take_the_place_of_the_hypotheses(params):
    truck = CAR._replace(others=((-4.0, 0.0),))
    left, right = branch(0.75, [-2.0, 8.0, 18.0]), branch(0.25, [-2.0, -2.0, -2.0])
    observer = Observer(params, predictions=[(truck.id, (right, left))])
    discs = observer.see(Obstacles(1, (truck,)))
    assert [o.probability for o in discs] == [0.75, 0.75, 0.25, 0.25]
    X, Y = discs[0].position(np.array([0.5, 2.0, 2.5]))
    # after its end it goes on as at last
    assert (pytest.approx([15.0, 30.0, 35.0]), pytest.approx([3.0, 18.0, 23.0])) == (X, Y)
    # 1 - 0.1 / 0.75 of a normal distribution
    assert radius(discs[0], 1.0) - CAR.r_obs == pytest.approx(0.2 * 1.1108, abs=1e-3)
    # the second disc turns with the direction of the path, which does not change
    assert discs[1].position(1.0) == pytest.approx((16.0, 8.0))
    # 1.2 s later they are too old
    late = observer.see(Obstacles(1 + 1200 * MS, (truck,)))
    assert late[0].position(1.0) == pytest.approx((22.0, -7.0), abs=0.01)


def test_what_predictions_from_outside_leave_open_is_left_to_the_hypotheses(params):
    observer = Observer(params, predictions=[(CAR.id, (branch(0.6, [-2.0, -2.0, -2.0]),))])
    given, own, *_ = observer.see(Obstacles(1, (CAR,)))
    assert given.position(1.0) == pytest.approx((20.0, -2.0))
    assert own.position(1.0) == pytest.approx((22.0, -7.0))
    assert own.probability < 0.4


def test_the_velocity_is_the_derivative_of_the_position(params):
    (found, *_) = Observer(params).see(*messages(*moving(13, braking=4.0, first=-6)))
    for t in (0.3, 1.1, 2.2):
        rate = (np.array(found.position(t + 0.01)) - found.position(t)) / 0.01
        assert found.velocity(t) == pytest.approx(rate, abs=0.3)
        later = np.array(moved((found,), t)[0].position(0.2))
        assert later == pytest.approx(np.array(found.position(t + 0.2)), abs=1e-9)
