"""The judge's geometry against closed forms."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bags.evaluation import geometry

CAR = geometry.Outline(front=2.4, rear=2.4, width=1.8)
CORNER = np.array([[0.0, 0.0], [10.0, 0.0], [10.0, 10.0]])


def circle(radius, turns, n):
    angle = np.linspace(0.0, 2.0 * np.pi * turns, n)
    return radius * np.column_stack([np.sin(angle), 1.0 - np.cos(angle)])


@pytest.mark.parametrize(
    ('point', 'distance'),
    [
        pytest.param([5.0, 1.0], 1.0, id='left'),
        pytest.param([5.0, -2.0], -2.0, id='right'),
        pytest.param([9.0, 8.0], 1.0, id='inside the corner'),
        pytest.param([12.0, 5.0], -2.0, id='outside of it'),
        pytest.param([13.0, -4.0], -5.0, id='beyond the corner: to the vertex'),
        pytest.param([-3.0, 4.0], 5.0, id='before the start'),
    ],
)
def test_distance_is_positive_on_the_left_and_negative_on_the_right(point, distance):
    assert geometry.distance_to_polyline([point], CORNER) == pytest.approx([distance])


def test_beyond_a_hairpin_the_segment_that_sees_a_point_more_squarely_decides_about_the_side():
    hairpin = [[0.0, 0.0], [10.0, 0.0], [0.0, 1.0]]
    distances = geometry.distance_to_polyline([[11.0, -0.5], [11.0, 0.2]], hairpin)
    assert np.sign(distances).tolist() == [-1.0, -1.0]


def test_driving_two_laps_is_twice_the_circumference_and_never_jumps():
    reference = circle(20.0, 2.0, 1001)
    drive = circle(19.0, 2.0, 4001) + np.array([0.0, 1.0])
    foot = geometry.project_drive(drive, reference, ahead=5.0)
    assert foot.distance[-1] == pytest.approx(4.0 * np.pi * 20.0, rel=1e-4)
    assert np.diff(foot.distance).min() >= 0.0
    assert foot.offset == pytest.approx(np.ones(len(drive)), abs=1e-3)


@pytest.mark.parametrize(('nearer_by', 'lap'), [(0.1, 0), (0.9, 0), (1.1, 1)])
def test_a_drive_begins_in_the_first_of_laps_that_are_about_equally_near(nearer_by, lap):
    laps = np.concatenate([circle(20.0, 1.0, 501), circle(20.0 - nearer_by, 1.0, 501)])
    laps[501:, 1] += nearer_by  # about the same centre
    drive = circle(17.0, 0.2, 50)[20:] + np.array([0.0, 3.0])
    foot = geometry.project_drive(drive, laps, ahead=5.0)
    assert int(foot.distance[0] > 2.0 * np.pi * 20.0) == lap


def test_a_crossing_branch_does_not_catch_the_foot():
    angle = np.linspace(0.0, 2.0 * np.pi, 801)
    eight = 50.0 * np.column_stack([np.sin(angle), np.sin(2.0 * angle) / 2.0])
    foot = geometry.project_drive(eight, eight, ahead=5.0)
    assert foot.distance == pytest.approx(geometry.arc_length(eight), abs=1e-6)


@settings(max_examples=60)
@given(
    st.integers(0, 2**32 - 1),
    st.sampled_from([0.02, 0.3]),  # rad between two segments: gentle, or a tangle
    st.sampled_from([0.0, 0.5, 3.0]),  # m of noise on the drive
    st.sampled_from([2.0, 15.0]),
)
def test_many_points_at_once_have_the_feet_they_have_one_by_one(seed, bend, noise, ahead):
    rng = np.random.default_rng(seed)
    turn = np.cumsum(rng.normal(0.0, bend, rng.integers(3, 120)))
    reference = np.cumsum(np.column_stack([np.cos(turn), np.sin(turn)]) * 2.0, axis=0)
    along = geometry.arc_length(reference)
    at = np.linspace(0.0, along[-1], rng.integers(1, 400))
    drive = np.column_stack([np.interp(at, along, axis) for axis in reference.T])
    drive += rng.normal(0.0, noise, drive.shape)
    together = geometry.project_drive(drive, reference, ahead)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(geometry, 'BLOCK', 1)
        alone = geometry.project_drive(drive, reference, ahead)
    assert together.distance.tolist() == alone.distance.tolist()
    assert together.offset.tolist() == alone.offset.tolist()


@settings(max_examples=100)
@given(
    st.integers(0, 2**32 - 1),
    st.sampled_from([0.02, 0.3, 2.0]),  # rad between two segments: gentle, a tangle, a heap
    st.sampled_from([0.0, 1.0, 30.0]),  # m from the line to the points
    st.booleans(),
)
def test_segments_left_out_are_never_the_nearest(seed, bend, away, on_grid):
    rng = np.random.default_rng(seed)
    turn = np.cumsum(rng.normal(0.0, bend, rng.integers(1, 80)))
    line = np.cumsum(np.column_stack([np.cos(turn), np.sin(turn)]) * 2.0, axis=0)
    line = np.vstack([line[0] - 1.0, line])
    points = line[np.sort(rng.integers(len(line), size=200))]
    points = points + rng.normal(0.0, 1.0, points.shape) * away
    if on_grid:  # equal distances to several segments
        points = np.round(points)
    result = geometry.distance_to_polyline(points, line)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(geometry, '_near', lambda block, segments: np.arange(len(segments.x)))
        assert result.tolist() == geometry.distance_to_polyline(points, line).tolist()


@settings(max_examples=60)
@given(st.integers(0, 2**32 - 1), st.sampled_from([0.0, 1e-6, 1.0, np.pi]))
def test_vertices_on_a_straight_line_change_no_distance(seed, bend):
    rng = np.random.default_rng(seed)
    turn = np.cumsum(bend * rng.integers(-1, 2, rng.integers(1, 20)))
    line = np.cumsum(np.column_stack([np.cos(turn), np.sin(turn)]) * 3.0, axis=0)
    line = np.vstack([[0.0, 0.0], line])
    at = np.arange(0.0, len(line) - 1 + 1e-9, 0.125)
    dense = np.column_stack([np.interp(at, range(len(line)), axis) for axis in line.T])
    points = rng.normal(0.0, 5.0, (300, 2)) + line[rng.integers(len(line), size=300)]
    wanted = geometry.distance_to_polyline(points, line)
    assert geometry.distance_to_polyline(points, dense) == pytest.approx(wanted, abs=1e-9)


@pytest.mark.filterwarnings('ignore:invalid value:RuntimeWarning')
@pytest.mark.parametrize('lost', [np.nan, np.inf])
def test_a_point_that_is_not_finite_costs_no_other_its_distance(lost):
    x = np.linspace(1.0, 9.0, 200)
    points = np.column_stack([x, np.sin(x)])
    whole = geometry.distance_to_polyline(points, CORNER)
    points[100, 1] = lost
    torn = geometry.distance_to_polyline(points, CORNER)
    assert not np.isfinite(torn[100])
    assert np.delete(torn, 100).tolist() == np.delete(whole, 100).tolist()


def test_no_points_have_no_distances():
    assert geometry.distance_to_polyline(np.empty((0, 2)), CORNER).shape == (0,)


@pytest.mark.parametrize(
    ('x', 'y', 'gap'),
    [
        pytest.param(6.0, 0.0, 2.6, id='ahead'),
        pytest.param(0.0, 3.0, 1.1, id='beside'),
        pytest.param(2.4 + 3.0, -0.9 - 4.0, 4.0, id='off the corner'),
        pytest.param(0.0, 0.0, -1.9, id='on top: out by the nearer side'),
    ],
)
def test_gap_between_a_rectangle_and_a_circle(x, y, gap):
    assert geometry.gap_to_circle(0.0, 0.0, 0.0, CAR, x, y, 1.0) == pytest.approx(gap)


@settings(max_examples=60)
@given(st.floats(-20, 20), st.floats(-20, 20), st.floats(-3.2, 3.2), st.floats(-6, 6))
def test_the_gap_does_not_depend_on_where_the_scene_stands(x, y, yaw, ahead):
    here = geometry.gap_to_circle(0.0, 0.0, 0.0, CAR, ahead, 2.5, 1.0)
    cx = x + ahead * np.cos(yaw) - 2.5 * np.sin(yaw)
    cy = y + ahead * np.sin(yaw) + 2.5 * np.cos(yaw)
    there = geometry.gap_to_circle(x, y, yaw, CAR, cx, cy, 1.0)
    assert there == pytest.approx(here, abs=1e-9)


def test_points_of_an_outline_begin_and_end_at_its_corners():
    points = geometry.outline_points(geometry.Outline(2.0, 3.0, 1.8), 0.6)
    assert np.abs(points[:, 1]).tolist() == [0.9] * len(points)
    assert (points[:, 0].min(), points[:, 0].max()) == (-3.0, 2.0)
    assert np.diff(np.unique(points[:, 0])).max() <= 0.6
    (turned,) = geometry.transform_to_map(points[:1], *np.array([[5.0], [7.0], [np.pi / 2]]))
    assert turned[0] == pytest.approx([5.0 - 0.9, 7.0 - 3.0])


def test_the_gap_vanishes_on_the_outline_that_is_drawn():
    skewed = geometry.Outline(front=2.0, rear=2.8, width=1.8)
    for corner in geometry.transform_to_map(skewed.corners, 3.0, -1.0, 0.7):
        gap = geometry.gap_to_circle(3.0, -1.0, 0.7, skewed, *corner, 0.0)
        assert gap == pytest.approx(0.0, abs=1e-12)
