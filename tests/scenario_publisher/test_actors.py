"""Obstacles over time: closed forms of their motion, and what nobody can drive."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from scenario_publisher import actors, lines, schema, waypoint_track
from scenario_publisher.schema import KeyedError, MapObstacle, RoadObstacle, Waypoint

STRAIGHT = lines.line_from_curves([lines.straight(400.0)], 0.0, 0.0, 0.0, 1.0)
# a left-hand bend of 50 m about (0, 50)
BEND = lines.line_from_curves([lines.arc(200.0, 0.02)], 0.0, 0.0, 0.0, 0.5)


def place(block, centre=BEND):
    return actors.place_actors((block,), centre)[0]


def track(*points, centre=STRAIGHT):
    return waypoint_track.build_track([Waypoint(*p) for p in points], centre, 'obstacles[0]')


def at(motion, t):
    return np.array([float(value) for value in waypoint_track.motion_at(motion, t)])


def test_an_obstacle_on_the_road_is_beside_the_centre_line_and_moves_along_and_across_it():
    quarter = 25.0 * np.pi  # there the bend points to +y, at (50, 50)
    o = place(RoadObstacle(quarter, 2.0, 0.5, along_mps=4.0, across_mps=1.0)).obstacle
    assert pytest.approx((48.0, 50.0), abs=1e-4) == (o.X, o.Y)
    assert (o.vX, o.vY) == pytest.approx((-1.0, 4.0), abs=1e-3)
    assert (o.id, o.r_obs) == (1, 0.5)


def test_an_obstacle_in_the_map_is_there_in_its_time_and_moves_from_its_appearance_on():
    actor = place(MapObstacle(1.0, 2.0, 1.0, 3.0, -4.0, appears_at_s=2.0, disappears_at_s=5.0))
    seen = [actors.is_present(actor, t) for t in (0.0, 1.999, 2.0, 4.999, 5.0)]
    assert seen == [False, False, True, True, False]
    first, later = actors.obstacle_at(actor, 2.0), actors.obstacle_at(actor, 2.5)
    assert (first.X, first.Y, first.vX, first.vY) == (1.0, 2.0, 3.0, -4.0)
    assert pytest.approx((2.5, 0.0)) == (later.X, later.Y)
    still = place(MapObstacle(7.0, -3.0, 0.5))
    assert actors.obstacle_at(still, 12.0) == still.obstacle


@pytest.mark.parametrize(('along', 'across'), [(6.0, 0.0), (6.0, -0.3), (-6.0, 0.1)])
def test_along_the_road_an_obstacle_keeps_its_offset_or_drifts(along, across):
    station = 60.0 if along > 0.0 else 150.0
    actor = place(RoadObstacle(station, 1.0, 0.5, along, across, schema.ALONG_ROAD))
    seen = [actors.obstacle_at(actor, t) for t in (0.0, 5.0, 10.0)]
    for t, o in zip((0.0, 5.0, 10.0), seen):
        assert 50.0 - np.hypot(o.X, o.Y - 50.0) == pytest.approx(1.0 + across * t, abs=0.04)
        assert np.hypot(o.vX, o.vY) == pytest.approx(np.hypot(along, across))
    turned = np.diff(np.unwrap([np.arctan2(o.Y - 50.0, o.X) for o in seen]))
    assert 49.0 * turned == pytest.approx(np.full(2, 5.0 * along), rel=0.05)


def test_behind_the_end_of_the_road_an_obstacle_goes_straight_on():
    actor = place(RoadObstacle(195.0, 0.0, 0.5, 5.0, motion=schema.ALONG_ROAD))
    a, b, c = (actors.obstacle_at(actor, t) for t in (2.0, 3.0, 4.0))
    assert pytest.approx((b.X - a.X, b.Y - a.Y)) == (c.X - b.X, c.Y - b.Y)
    assert (b.vX, b.vY) == pytest.approx((c.X - b.X, c.Y - b.Y))
    at_end = place(RoadObstacle(200.0, 0.0, 0.5, 5.0, motion=schema.ALONG_ROAD))
    assert at_end.track is None


def test_braking_to_a_stop_waiting_and_driving_on_have_closed_forms():
    # 4 m/s2 for 3 s over 18 m, 2 s of rest, 2 m/s2 for 4 s over 16 m, then 8 m/s
    motion = track((10.0, 0.0, 12.0), (28.0, 0.0, 0.0, 2.0), (44.0, 0.0, 8.0))
    expected = {
        0.0: (10.0, 12.0),
        1.5: (10.0 + 18.0 - 4.5, 6.0),
        3.0: (28.0, 0.0),
        4.9: (28.0, 0.0),
        7.0: (28.0 + 4.0, 4.0),
        9.0: (44.0, 8.0),
        10.0: (52.0, 8.0),
    }
    for t, (x, vx) in expected.items():
        assert at(motion, t) == pytest.approx([x, 0.0, vx, 0.0], abs=1e-6), t


def test_way_points_make_lane_changes_follow_bends_and_lead_back_and_across():
    motion = track((0.0, 3.5, 10.0), (40.0, 0.0, 10.0))
    length = motion.s[-1]
    assert at(motion, length / 20.0)[:2] == pytest.approx([20.0, 1.75], abs=0.01)
    # least jerk: a tenth of the offset at q = 0.247
    assert at(motion, 0.247 * length / 10.0)[1] == pytest.approx(0.9 * 3.5, abs=0.01)
    behind = at(motion, length / 10.0 + 1.0)
    assert behind == pytest.approx([50.0, 0.0, 10.0, 0.0], abs=0.02)
    motion = track((0.0, 5.0, 9.0), (100.0, 5.0, 9.0), centre=BEND)
    assert motion.s[-1] == pytest.approx(90.0, abs=1e-3)  # 45 m of radius
    for t in np.linspace(0.0, 9.9, 7):
        X, Y, vX, vY = at(motion, t)
        assert np.hypot(X, Y - 50.0) == pytest.approx(45.0, abs=1e-3)
        assert np.hypot(vX, vY) == pytest.approx(9.0)
    assert at(track((90.0, 3.5, 15.0), (30.0, 3.5, 15.0)), 2.0)[[0, 2]] == pytest.approx([60, -15])
    assert at(track((50.0, -3.0, 1.5), (50.0, 3.0, 1.5)), 2.0) == pytest.approx([50, 0, 0, 1.5])


@settings(max_examples=40)
@given(
    points=st.lists(
        st.tuples(st.floats(0.0, 300.0), st.floats(-5.0, 5.0), st.floats(0.5, 20.0)),
        min_size=2,
        max_size=5,
        unique_by=lambda p: round(p[0]),
    ),
    share=st.floats(0.01, 0.99),
)
def test_velocity_is_the_derivative_of_position_and_way_points_are_passed_at_their_speed(
    points, share
):
    motion = track(*points)
    t, h = share * (motion.begin[-1] + 1.0), 1e-6
    before, after = at(motion, t - h), at(motion, t + h)
    slope = (after[:2] - before[:2]) / (2 * h)
    # at a corner of the way both directions are right
    near = [before[2:], after[2:], (before[2:] + after[2:]) / 2]
    assert min(np.abs(slope - v).max() for v in near) < 0.02 * (1.0 + np.abs(slope).max())
    for i, (station, offset, speed) in enumerate(points):
        X, Y, vX, vY = at(motion, motion.begin[2 * i + 1])
        assert pytest.approx((station, offset), abs=1e-6) == (X, Y)
        assert np.hypot(vX, vY) == pytest.approx(speed)


@pytest.mark.parametrize(
    ('points', 'message'),
    [
        ([(0.0, 0.0, 5.0)], 'has 1 way-points; allowed 2 to 100'),
        ([(0.0, 0.0, 5.0)] * 101, 'has 101 way-points; allowed 2 to 100'),
        ([(0.0, 0.0, 5.0), (0.05, 0.0, 5.0)], '[1] lies 0.05 m from the way-point before'),
        ([(0.0, 0.0, 0.0), (9.0, 0.0, 0.0)], '[1].speed_mps is 0 m/s, as is the one before'),
        ([(0.0, 0.0, 5.0, 1.0), (9.0, 0.0, 5.0)], '[0].wait_s is 1 s at 5 m/s; allowed a wait at'),
        ([(0.0, 0.0, 5.0), (400.5, 0.0, 5.0)], '[1].station_m lies beyond the road with 400.5'),
    ],
)
def test_way_points_that_cannot_be_driven_are_refused(points, message):
    with pytest.raises(KeyedError) as caught:
        track(*points)
    key, what = caught.value.args
    told = f'{key} {what}'.removeprefix('obstacles[0].waypoints')
    assert told.strip().startswith(message)


def test_an_obstacle_appears_at_its_first_way_point_and_is_published_with_its_velocity():
    block = schema.WaypointObstacle((Waypoint(10.0, 0.0, 4.0), Waypoint(30.0, 0.0, 8.0)), 0.5, 2.0)
    actor = place(block, STRAIGHT)
    assert (actor.obstacle.X, actor.obstacle.vX) == (10.0, 4.0)
    assert [actors.is_present(actor, t) for t in (1.9, 2.0)] == [False, True]
    seen = actors.obstacle_at(actor, 2.0 + 20.0 / 6.0)
    assert (seen.id, seen.r_obs) == (1, 0.5)
    assert (seen.X, seen.vX) == pytest.approx((30.0, 8.0))
    X, Y = actors.positions(actor, 5.0, 0.25)
    assert np.diff(X).max() <= 0.25 + 1e-9
    assert (X[0], X[-1], Y.max()) == (10.0, seen_at(actor, 5.0), 0.0)
    X, _ = actors.positions(place(MapObstacle(0.0, 0.0, 1.0, 3.0, 4.0)), 5.0, 0.25)
    assert (len(X), X[-1]) == (101, 15.0)


CAR, LORRY = (-1.35, 1.35), tuple(2.0 * k for k in range(8))


def discs_at(block, t, centre=BEND):
    """Return the places (n, 2) of the discs of an obstacle."""
    o = actors.obstacle_at(place(block, centre), t)
    assert o.id == 1
    return np.array([(disc.X, disc.Y) for disc in o.discs()])


@pytest.mark.parametrize('speed', [8.0, -8.0])
@pytest.mark.parametrize('motion', ['along_road', 'waypoints'])
def test_in_a_bend_every_disc_of_a_lorry_follows_the_road(speed, motion):
    first, last = (60.0, 100.0)[:: 1 if speed > 0.0 else -1]
    block = RoadObstacle(first, 2.0, 1.0, speed, motion=schema.ALONG_ROAD, discs_m=LORRY)
    if motion == 'waypoints':
        points = Waypoint(first, 2.0, abs(speed)), Waypoint(last, 2.0, abs(speed))
        block = schema.WaypointObstacle(points, 1.0, discs_m=LORRY)
    for t in (0.0, 2.5):
        X, Y = discs_at(block, t).T
        assert np.hypot(X, Y - 50.0) == pytest.approx(np.full(8, 48.0), abs=2e-3)
        station = 50.0 * np.arctan2(X, 50.0 - Y)
        driven = speed * t * 50.0 / 48.0
        assert station == pytest.approx(first + driven + np.array(LORRY), abs=0.01)


def test_who_goes_straight_on_is_a_rigid_body_along_its_course():
    crossing = RoadObstacle(25.0 * np.pi, -3.0, 1.0, across_mps=2.0, discs_m=CAR)
    # to -x at the top of the bend: from (53, 50)
    assert discs_at(crossing, 2.0) == pytest.approx(np.array([(50.35, 50), (47.65, 50)]), abs=1e-3)
    oblique = MapObstacle(1.0, 2.0, 1.0, 3.0, 4.0, discs_m=(0.0, 5.0))
    assert discs_at(oblique, 1.0) == pytest.approx(np.array([(4.0, 6.0), (7.0, 10.0)]))
    still = MapObstacle(1.0, 2.0, 1.0, discs_m=CAR)
    assert discs_at(still, 3.0) == pytest.approx(np.array([(-0.35, 2.0), (2.35, 2.0)]))
    parked = discs_at(RoadObstacle(25.0 * np.pi, 0.0, 1.0, discs_m=CAR), 0.0)
    assert np.hypot(*(parked - (0.0, 50.0)).T) == pytest.approx(np.full(2, 50.0), abs=1e-4)


def seen_at(actor, t):
    return actors.obstacle_at(actor, t).X
