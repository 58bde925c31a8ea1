"""Obstacles along way-points: closed forms of their motion, and what is refused."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from scenario_publisher import actors, lines, schema, waypoint_track
from scenario_publisher.schema import KeyedError, Waypoint

STRAIGHT = lines.line_from_curves([lines.straight(400.0)], 0.0, 0.0, 0.0, 1.0)
# a left-hand bend of 50 m about (0, 50)
BEND = lines.line_from_curves([lines.arc(200.0, 0.02)], 0.0, 0.0, 0.0, 0.5)


def track(*points, centre=STRAIGHT):
    return waypoint_track.build_track([Waypoint(*p) for p in points], centre, 'obstacles[0]')


def at(motion, t):
    return np.array([float(value) for value in waypoint_track.motion_at(motion, t)])


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


def test_a_lane_change_has_its_middle_in_the_middle_and_ends_along_the_road():
    motion = track((0.0, 3.5, 10.0), (40.0, 0.0, 10.0))
    length = motion.s[-1]
    assert at(motion, length / 20.0)[:2] == pytest.approx([20.0, 1.75], abs=0.01)
    end = at(motion, length / 10.0 + 1.0)
    assert end == pytest.approx([50.0, 0.0, 10.0, 0.0], abs=0.02)


def test_way_points_follow_a_bend_at_their_offset():
    motion = track((0.0, 5.0, 9.0), (100.0, 5.0, 9.0), centre=BEND)
    # 45 m of radius: 90 m long
    assert motion.s[-1] == pytest.approx(90.0, abs=1e-3)
    for t in np.linspace(0.0, 9.9, 7):
        X, Y, vX, vY = at(motion, t)
        assert np.hypot(X, Y - 50.0) == pytest.approx(45.0, abs=1e-3)
        assert np.hypot(vX, vY) == pytest.approx(9.0)


def test_way_points_may_lead_against_the_road_and_across_it():
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
def test_the_published_velocity_is_the_derivative_of_the_position(points, share):
    motion = track(*points)
    t = share * (motion.begin[-1] + 1.0)
    h = 1e-6
    before, after = at(motion, t - h), at(motion, t + h)
    slope = (after[:2] - before[:2]) / (2 * h)
    # at a corner of the way both directions are right
    near = [before[2:], after[2:], (before[2:] + after[2:]) / 2]
    assert min(np.abs(slope - v).max() for v in near) < 0.02 * (1.0 + np.abs(slope).max())


@settings(max_examples=40)
@given(st.lists(st.floats(0.5, 20.0), min_size=2, max_size=6))
def test_every_way_point_is_passed_in_order_at_its_speed(speeds):
    motion = track(*((40.0 * i, 0.0, v) for i, v in enumerate(speeds)))
    for i, v in enumerate(speeds):
        x, _, vx, _ = at(motion, motion.begin[2 * i + 1])
        assert (x, vx) == pytest.approx((40.0 * i, v), abs=1e-6)


@pytest.mark.parametrize(
    ('points', 'message'),
    [
        ([(0.0, 0.0, 5.0)], 'has 1 way-points; allowed 2 to 100'),
        ([(0.0, 0.0, 5.0)] * 101, 'has 101 way-points'),
        ([(0.0, 0.0, 5.0), (0.05, 0.0, 5.0)], 'lies 0.05 m from the way-point before'),
        ([(0.0, 0.0, 0.0), (9.0, 0.0, 0.0)], 'would never arrive'),
        ([(0.0, 0.0, 5.0, 1.0), (9.0, 0.0, 5.0)], 'allowed a wait at speed_mps: 0 only'),
        ([(0.0, 0.0, 5.0), (400.5, 0.0, 5.0)], 'lies beyond the road with 400.5'),
    ],
)
def test_way_points_that_cannot_be_driven_are_refused(points, message):
    with pytest.raises(KeyedError) as caught:
        track(*points)
    key, what = caught.value.args
    assert key.startswith('obstacles[0].waypoints')
    assert message in what


def test_an_obstacle_appears_at_its_first_way_point_and_is_published_with_its_velocity():
    block = schema.WaypointObstacle((Waypoint(10.0, 0.0, 4.0), Waypoint(30.0, 0.0, 8.0)), 0.5, 2.0)
    actor = actors.place_actors((block,), STRAIGHT)[0]
    assert (actor.obstacle.X, actor.obstacle.vX) == (10.0, 4.0)
    assert [actors.is_present(actor, t) for t in (1.9, 2.0)] == [False, True]
    seen = actors.obstacle_at(actor, 2.0 + 20.0 / 6.0)
    assert (seen.id, seen.r_obs) == (1, 0.5)
    assert (seen.X, seen.vX) == pytest.approx((30.0, 8.0))
    X, _ = actors.positions(actor, 5.0, 0.25)
    assert np.diff(X).max() <= 0.25 + 1e-9
