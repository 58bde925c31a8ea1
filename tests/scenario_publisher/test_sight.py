"""What is seen of a scenario, the speed that allows, and predictions that are exact."""

import math

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from msgs_yaml.types import Obstacle
from scenario_publisher import scenario, sight
from scenario_publisher.plausibility import CAR_RADIUS
from scenario_publisher.schema import ScenarioError

START_NS = scenario.START_NS
ROAD = """
schema: 1
name: crest
description: A road of 300 m.
road:
  centre_line:
    start: {x_m: -20.0, y_m: 0.0, yaw_rad: 0.0}
    segments: [straight: {length_m: 150.0}, arc: {length_m: 170.0, curvature_1pm: 0.01}]
  edges: {left: {offset_m: 6.0}, right: {offset_m: -2.5}}
path:
  start: {x_m: 0.0, y_m: 0.0, yaw_rad: 0.0}
  segments: [straight: {length_m: 130.0}, arc: {length_m: 160.0, curvature_1pm: 0.01}]
speed: {constant_mps: 30.0}
friction: 1.0
start: {progress_m: 0.0}
stop: {progress_m: 250.0, time_s: 30.0}
predictions: exact
obstacles:
  - {station_m: 120.0, offset_m: 0.0, radius_m: 1.0}
  - {station_m: 320.0, offset_m: 3.5, radius_m: 1.0, along_mps: -12.0, motion: along_road}
  - {x_m: 90.0, y_m: -2.0, radius_m: 0.4, vy_mps: 1.0, appears_at_s: 2.0, disappears_at_s: 6.0}
  - waypoints:
      - {station_m: 60.0, offset_m: 3.5, speed_mps: 4.0}
      - {station_m: 90.0, offset_m: 0.0, speed_mps: 0.0, wait_s: 2.0}
      - {station_m: 140.0, offset_m: 0.0, speed_mps: 9.0}
    radius_m: 0.5
sight: {stations_m: [0.0, 80.0, 81.0], ranges_m: [105.0, 25.0, 400.0]STOP}
"""


def load(more=''):
    return scenario.parse(ROAD.replace('STOP', more), 'crest.yaml')


def driven_to_standstill(speed, reaction, deceleration, dt=1e-4):
    """Return how far a car goes that brakes after a while, step by step."""
    distance, t = 0.0, 0.0
    while speed > 0:
        distance += speed * dt
        speed -= deceleration * dt if t >= reaction else 0.0
        t += dt
    return distance


@settings(max_examples=20)
@given(st.floats(1.0, 150.0), st.floats(0.0, 2.0), st.floats(2.0, 9.0))
def test_from_the_speed_of_a_distance_the_car_stops_within_it(distance, reaction, deceleration):
    speed = float(sight.stopping_speed(np.array(distance), reaction, deceleration))
    assert driven_to_standstill(speed, reaction, deceleration) == pytest.approx(distance, rel=5e-3)


@pytest.mark.parametrize(
    ('more', 'share', 'reaction', 'deceleration'),
    [
        ('', 1.0, 0.5, 5.0),
        (', stop_within: half', 0.5, 0.5, 5.0),
        (', reaction_s: 1.0, deceleration_mps2: 3.0', 1.0, 1.0, 3.0),
    ],
)
def test_the_desired_speed_is_the_closed_form_of_the_range(more, share, reaction, deceleration):
    ref = load(more).reference
    ds = np.hypot(np.diff(ref.X), np.diff(ref.Y))
    s, v = np.cumsum(ds) - ds / 2, ds / np.diff(ref.t)
    before = s < 79.0
    lost = deceleration * reaction
    d = share * (105.0 - s[before])
    wanted = np.sqrt(lost**2 + 2 * deceleration * d) - lost
    assert v[before] == pytest.approx(np.minimum(wanted, 30.0), rel=2e-3)
    assert v[s > 85.0] == pytest.approx(30.0, rel=1e-4)  # behind the crest everything is seen


def test_a_range_that_ends_at_once_is_braked_for_before():
    cliff = ROAD.replace('[0.0, 80.0, 81.0]', '[0.0, 80.0, 80.1]')
    cliff = cliff.replace('[105.0, 25.0, 400.0]STOP', '[300.0, 300.0, 25.0]')
    ref = scenario.parse(cliff, 'cliff.yaml').reference
    ds = np.hypot(np.diff(ref.X), np.diff(ref.Y))
    v = ds / np.diff(ref.t)
    a = np.diff(v**2) / (ds[1:] + ds[:-1])
    assert (np.min(a), v[0], v[-1]) == pytest.approx((-5.0, 30.0, 13.5078), abs=0.05)


def test_what_is_beyond_the_range_is_not_published_until_something_of_it_is_within():
    scn = load()
    assert [o.id for o in scn.obstacles.items] == [1, 4]  # within 105 m of the start
    # the crest shows the road up to 105 m: the walker there, 98.6 m ahead of the start, and no more
    ids = {
        x: [o.id for o in scenario.obstacles_at(scn, 3.0, 7, (x, 0.0)).items] for x in (60, 80, 81)
    }
    assert ids == {60: [1, 3, 4], 80: [1, 3, 4], 81: [1, 2, 3, 4]}
    assert [o.id for o in scenario.obstacles_at(scn, 3.0, 7).items] == [1, 2, 3, 4]
    near = {
        x: 1 in (o.id for o in scenario.obstacles_at(scn, 0.0, 7, (x, 0.0)).items) for x in (0, 200)
    }
    assert near == {0: True, 200: True}  # what is behind is seen, too


@settings(max_examples=40)
@given(st.floats(0.0, 20.0))
def test_the_exact_prediction_is_where_the_obstacles_then_are(t):
    scn = load()
    obstacles = scenario.obstacles_at(scn, t, START_NS)
    predictions = scenario.predictions_at(scn, t, obstacles)
    assert (predictions.stamp_ns, {*predictions.by_id}) == (
        START_NS,
        {o.id for o in obstacles.items},
    )
    for number, branches in predictions.by_id.items():
        (branch,) = branches
        assert branch.probability == 1.0
        assert not branch.covariance.any()
        assert branch.t[0] == 0.0
        gone = [t + ahead for ahead in (*branch.t, branch.t[-1] + 0.125)]
        there = [{o.id: o for o in scenario.obstacles_at(scn, then, 1).items} for then in gone]
        for now, X, Y in zip(there, branch.X, branch.Y):
            assert pytest.approx((now[number].X, now[number].Y), abs=1e-4) == (X, Y)
        assert branch.t[-1] == 5.0 or number not in there[-1]  # until it disappears


@pytest.mark.parametrize(
    ('old', 'new', 'error'),
    [
        ('[105.0, 25.0, 400.0]', '[105.0, 25.0]', 'sight.ranges_m: has 2 values for 3 stations'),
        ('[0.0, 80.0, 81.0]', '[0.0, 80.0, 80.0]', r'sight.stations_m\[2\]: is not larger than'),
        ('[105.0, 25.0, 400.0]', '[105.0, 0.5, 400.0]', 'allowed 1 to 20000 m'),
        ('STOP}', ', stop_within: all}', 'allowed whole or half'),
        ('STOP}', ', emerging_mps: 2.0}', 'is 2, but without hidden_by_obstacles nobody is hidden'),
        ('predictions: exact', 'predictions: true', 'allowed none or exact'),
    ],
)
def test_a_mistake_is_named(old, new, error):
    with pytest.raises(ScenarioError, match=error):
        scenario.parse(ROAD.replace(old, new).replace('STOP', ''), 'crest.yaml')


HIDES = ROAD[: ROAD.index('sight:')] + 'sight: {hidden_by_obstacles: true}'
VIEW = scenario.parse(HIDES, 'hides.yaml').sight


def discs(least, most):
    """Discs around a car at the origin: direction, distance of the nearest point, radius."""
    one = st.tuples(st.floats(-math.pi, math.pi), st.floats(0.1, 40.0), st.floats(0.2, 4.0))
    return st.lists(one, min_size=least, max_size=most)


def as_obstacles(polar):
    return [
        Obstacle(i, (gap + r) * math.cos(phi), (gap + r) * math.sin(phi), r, 0.0, 0.0)
        for i, (phi, gap, r) in enumerate(polar)
    ]


def first_hit(obstacles, phi):
    """Return which obstacle a ray from the origin meets first, None for none."""
    met = []
    for o in obstacles:
        along = o.X * math.cos(phi) + o.Y * math.sin(phi)
        across = o.Y * math.cos(phi) - o.X * math.sin(phi)
        if along > 0.0 and abs(across) < o.r_obs:
            met.append((along - math.sqrt(o.r_obs**2 - across**2), o.id))
    return min(met)[1] if met else None


@settings(max_examples=100)
@given(discs(2, 7))
def test_an_obstacle_is_hidden_where_every_ray_to_it_meets_another_one_first(polar):
    obstacles = as_obstacles(polar)
    for k, o in enumerate(obstacles):
        gaps = (math.hypot(o.X - b.X, o.Y - b.Y) - o.r_obs - b.r_obs for b in obstacles[:k])
        assume(all(gap > 1e-6 for gap in gaps))
    # what a ray meets changes where it touches a disc: one ray between each two of these
    half = [math.asin(o.r_obs / math.hypot(o.X, o.Y)) for o in obstacles]
    turns = [phi + side * h for (phi, *_), h in zip(polar, half) for side in (-1.0, 1.0)]
    turns = sorted(math.remainder(turn, math.tau) for turn in turns)
    assume(min(np.diff(turns)) > 1e-6)
    rays = [(a + b) / 2 for a, b in zip(turns, [*turns[1:], turns[0] + math.tau])]
    met = {first_hit(obstacles, phi) for phi in rays}
    shown = {o.id for o in obstacles if not sight.is_hidden((0.0, 0.0), o, obstacles)}
    assert shown == met - {None}
    assert {o.id for o in sight.seen(VIEW, (0.0, 0.0), obstacles)} == shown


@settings(max_examples=100)
@given(discs(1, 4), st.floats(-30.0, 30.0), st.floats(-30.0, 30.0))
def test_a_place_is_hidden_where_the_way_to_it_meets_a_disc_before(polar, x, y):
    assume(math.hypot(x, y) > 0.1)
    rows = np.array([(o.X, o.Y, o.r_obs) for o in as_obstacles(polar)])
    share = np.clip((rows[:, 0] * x + rows[:, 1] * y) / (x**2 + y**2), 0.0, 1.0)
    beside = np.hypot(rows[:, 0] - share * x, rows[:, 1] - share * y) - rows[:, 2]
    from_it = np.hypot(rows[:, 0] - x, rows[:, 1] - y) - rows[:, 2]
    assume(np.abs(beside).min() > 1e-6 and from_it.min() > 0.0)
    hidden = sight.hidden_places((0.0, 0.0), np.array([x]), np.array([y]), rows)
    assert [*hidden] == [min(beside) < 0.0]


VAN = """
schema: 1
name: van
description: A van is parked beside the path.
road:
  centre_line:
    start: {x_m: -20.0, y_m: 0.0, yaw_rad: 0.0}
    segments: [straight: {length_m: 130.0}]
  edges: {left: {offset_m: 6.0}, right: {offset_m: -2.5}}
path:
  start: {x_m: 0.0, y_m: 0.0, yaw_rad: 0.0}
  segments: [straight: {length_m: 100.0}]
speed: {constant_mps: 12.0}
friction: 1.0
start: {progress_m: 0.0}
stop: {progress_m: 75.0, time_s: 60.0}
obstacles:
  - {x_m: 50.0, y_m: VAN_Y, radius_m: 1.0, discs_m: [-1.5, -0.5, 0.5, 1.5]VAN}
  - {x_m: 53.5, y_m: -2.9, radius_m: 0.35, vy_mps: 1.0}
  - {x_m: 75.0, y_m: 1.0, radius_m: 1.0, discs_m: [-1.3, 1.3], appears_at_s: 1.0}
sight: {hidden_by_obstacles: true, emerging_mps: EMERGING}
"""


def behind_van(emerging=0.0, beside=1.0, van=''):
    y = -0.93 - beside - 1.0
    text = VAN.replace('VAN_Y', f'{y}').replace('VAN', van).replace('EMERGING', f'{emerging}')
    return scenario.parse(text, 'van.yaml')


def test_who_is_behind_a_van_is_published_once_something_of_him_is_seen():
    scn = behind_van()
    assert [o.id for o in scn.obstacles.items] == [1]

    def ids(t, x, y=0.0):
        return [o.id for o in scenario.obstacles_at(scn, t, 7, (x, y)).items]

    # he walks: the line to his nearer side leaves the van behind at y = -2.1 or so
    assert [2 in ids(t, 30.0) for t in (0.0, 0.3, 0.7, 1.5)] == [False, False, True, True]
    assert [2 in ids(0.0, x) for x in (45.0, 52.0, 60.0)] == [False, True, True]
    assert 2 in ids(0.0, 30.0, 25.0)  # from the other side of the road
    assert ids(1.2, 30.0) == [1, 2, 3]
    everything = scenario.obstacles_at(scn, 0.0, 7)
    assert [o.id for o in everything.items] == [1, 2]  # those who see all are not concerned


def test_an_object_is_seen_as_a_whole_when_one_of_its_discs_is():
    wall = Obstacle(1, 20.0, 0.0, 1.0, 0.0, 0.0)
    short = Obstacle(2, 40.0, 0.0, 0.5, 0.0, 0.0, ((0.0, 1.0),))
    long = short._replace(id=3, others=((0.0, 1.0), (0.0, 2.0)))
    both = wall, short, long
    assert sight.is_hidden((0.0, 0.0), short, both)
    assert not sight.is_hidden((0.0, 0.0), long, both)
    assert not sight.is_hidden((0.0, 0.0), wall, both)


def speeds(scn):
    """Return stations (n,) and desired speeds (n,) in the middle of each piece of the path."""
    ref = scn.reference
    ds = np.diff(ref.X)
    return ref.X[:-1] + ds / 2, ds / np.diff(ref.t)


@pytest.mark.parametrize('emerging', [1.0, 2.0, 5.0])
@pytest.mark.parametrize('beside', [0.5, 1.2])
def test_who_comes_out_faster_or_from_nearer_makes_the_car_slower(emerging, beside):
    v = speeds(behind_van(emerging, beside))[1]
    faster = speeds(behind_van(1.3 * emerging, beside))[1]
    nearer = speeds(behind_van(emerging, beside - 0.2))[1]
    assert np.all(faster <= v + 1e-9)
    assert np.all(nearer <= v + 0.2)  # of round corners another part is hidden
    assert np.mean(speeds(behind_van(emerging / 4, 1.5))[1]) > np.mean(v) + 0.1


@settings(max_examples=6)
@given(st.floats(0.7, 4.0), st.floats(0.5, 1.5))
def test_a_car_at_the_desired_speed_stops_for_who_was_hidden_or_has_passed_them(emerging, beside):
    """They begin to walk when it is at x; it brakes 0.5 s later with 5 m/s^2, or drives on."""
    scn = behind_van(emerging, beside)
    van = [(disc.obstacle.X, disc.obstacle.Y, 1.0) for disc in scn.actors[0].discs]
    t = np.arange(0.0, 6.0, 1e-3)
    stations, desired = speeds(scn)
    for x in (20.2, 30.7, 36.1, 41.3, 44.9, 47.2, 48.6, 49.9, 51.2):
        front = x + sight.FRONT
        there, y = np.meshgrid(np.arange(front, front + 25.0, 0.1), np.arange(-9.0, -1.2, 0.05))
        hidden = sight.hidden_places((x, 0.0), there, y, np.array(van))
        for a, b, _ in van:  # who stands behind the van cannot walk through it
            aside = np.where((y <= b), np.abs(there - a), np.hypot(there - a, y - b))
            hidden &= aside > 1.0 + sight.PERSON
        speed = float(np.interp(x, stations, desired))
        v = np.maximum(speed - 5.0 * np.maximum(t - 0.5, 0.0), 0.0)
        way = front + np.cumsum(v) * 1e-3
        arrives = (-y - sight.PERSON - CAR_RADIUS) / emerging
        # what is between two places, across and along the path
        rear = x + sight.FRONT - sight.LENGTH + speed * (arrives + sight.STEP / emerging)
        stops = way[-1] < there + sight.MARGIN + 0.5
        assert np.all(~hidden | (rear >= there) | stops)


def test_only_what_stands_all_the_time_bounds_the_speed():
    bounded = speeds(behind_van(2.0))[1]
    assert bounded.min() < 3.0
    for unsteady in (', vx_mps: 0.1', ', appears_at_s: 1.0', ', disappears_at_s: 50.0'):
        assert np.allclose(speeds(behind_van(2.0, van=unsteady))[1], 12.0)
    assert np.allclose(speeds(behind_van(0.0))[1], 12.0)


def test_the_desired_speed_falls_no_faster_than_it_says_and_rises_slowly():
    s, v = speeds(behind_van(2.0))
    a = np.diff(v**2) / (2 * np.diff(s))
    assert -5.1 < np.min(a) < -3.0
    # behind it does not drive on faster than a controller follows
    assert np.max(a) == pytest.approx(sight.ACCELERATION, abs=0.1)
    assert s[np.argmin(v)] == pytest.approx(50.0, abs=3.0)
