"""What is seen of a scenario, the speed that allows, and predictions that are exact."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from scenario_publisher import scenario, sight
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
        ('predictions: exact', 'predictions: true', 'allowed none or exact'),
    ],
)
def test_a_mistake_is_named(old, new, error):
    with pytest.raises(ScenarioError, match=error):
        scenario.parse(ROAD.replace(old, new).replace('STOP', ''), 'crest.yaml')
