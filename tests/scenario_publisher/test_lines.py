"""Lines and polylines against closed forms, and laws that hold for any of them."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.special import fresnel

from scenario_publisher import lines, polyline

everywhere = settings(max_examples=50)
lengths = st.floats(1.0, 80.0)
curvatures = st.floats(-0.1, 0.1)
changes = st.builds(
    lambda advance, share: lines.lane_change(advance, share * advance),
    st.floats(10.0, 80.0),
    st.floats(-0.7, 0.7),
)
clothoids = st.builds(lines.clothoid, lengths, curvatures, curvatures)
pieces = st.one_of(
    st.builds(lines.straight, lengths),
    st.builds(lines.arc, lengths, curvatures),
    clothoids,
    changes,
)
poses = st.tuples(st.floats(-500, 500), st.floats(-500, 500), st.floats(-3, 3))


def join(*curves, at=(0.0, 0.0, 0.0), spacing=1.0):
    return lines.line_from_curves(curves, *at, spacing)


def end(line):
    return line.X[-1], line.Y[-1], line.psi[-1]


def chords(line):
    return np.hypot(np.diff(line.X), np.diff(line.Y))


@everywhere
@given(piece=pieces, length=lengths, kappas=st.tuples(curvatures, curvatures), change=changes)
def test_curvature_is_the_slope_of_the_heading_and_has_its_ends(piece, length, kappas, change):
    s, step = np.linspace(0.1, 0.9, 9) * piece.length, 1e-4 * piece.length
    slope = (piece.turn(s + step) - piece.turn(s - step)) / (2 * step)
    assert slope == pytest.approx(piece.kappa(s), abs=1e-6)
    clothoid = lines.clothoid(length, *kappas)
    assert clothoid.kappa(np.array([0.0, length])) == pytest.approx(kappas, abs=1e-12)
    # a lane change starts and ends straight and without curvature
    ends = np.array([0.0, change.length])
    assert np.abs([change.kappa(ends), change.turn(ends)]).max() < 1e-12


def test_a_gentle_lane_change_is_the_quintic_of_least_jerk_and_one_without_offset_straight():
    curve = lines.lane_change(200.0, 1.0)
    q = np.linspace(0.0, 1.0, 21)
    quintic = 1.0 / 200.0**2 * (60 * q - 180 * q**2 + 120 * q**3)
    assert curve.kappa(q * curve.length) == pytest.approx(quintic, abs=2e-4 * quintic.max())
    curve = lines.lane_change(30.0, 0.0)
    assert curve.length == pytest.approx(30.0, rel=1e-14)
    assert curve.kappa(30 * q) == pytest.approx(np.zeros(21), abs=1e-14)


@pytest.mark.parametrize(('advance', 'offset'), [(30.0, 3.5), (25.0, -3.5), (61.3, 30.0)])
def test_a_lane_change_ends_exactly_beside_where_it_began(advance, offset):
    line = join(lines.lane_change(advance, offset), spacing=0.5)
    assert end(line) == pytest.approx((advance, offset, 0.0), abs=1e-9)


def test_a_lane_change_that_would_drive_across_is_refused_with_what_is_allowed():
    with pytest.raises(
        ValueError, match=r'moves 40 m aside within 30 m; allowed at most 2[\d.]+ m'
    ):
        lines.lane_change(30.0, 40.0)


def test_an_arc_lies_on_its_circle_also_beside_it_and_between_its_samples():
    line = join(lines.arc(30.0, 0.05), at=(1.0, 2.0, 0.3), spacing=0.5)
    X = 1.0 + 20.0 * (np.sin(0.3 + 0.05 * line.s) - np.sin(0.3))
    Y = 2.0 - 20.0 * (np.cos(0.3 + 0.05 * line.s) - np.cos(0.3))
    assert np.column_stack([line.X, line.Y]) == pytest.approx(np.column_stack([X, Y]), abs=1e-11)
    line = join(lines.arc(40.0, 0.05))
    angle = 0.05 * 17.37
    exact = (20 * np.sin(angle), 20 - 20 * np.cos(angle), angle)
    assert tuple(lines.pose_at(line, 17.37)) == pytest.approx(exact, abs=1e-5)
    X, Y = lines.offset_point(lines.Frame(line.X, line.Y, line.psi), 3.0)
    assert np.hypot(X, Y - 20.0) == pytest.approx(np.full_like(X, 17.0), abs=1e-9)


@pytest.mark.parametrize('spacing', [0.1, 5.0])
def test_a_clothoid_from_a_straight_is_the_fresnel_integral(spacing):
    line = join(lines.clothoid(40.0, 0.0, 0.1), spacing=spacing)
    scale = np.sqrt(np.pi * 40.0 / 0.1)
    sine, cosine = fresnel(line.s / scale)
    assert pytest.approx(scale * cosine, abs=1e-9) == line.X
    assert pytest.approx(scale * sine, abs=1e-9) == line.Y


def mirrored(piece):
    return lines.Curve(piece.length, lambda s: -piece.kappa(s), lambda s: -piece.turn(s))


@everywhere
@given(curves=st.lists(pieces, min_size=1, max_size=6), pose=poses, spacing=st.floats(0.2, 2.0))
def test_any_list_of_segments_gives_a_continuous_line_its_mirror_and_its_refinement(
    curves, pose, spacing
):
    line = join(*curves, at=pose, spacing=spacing)
    steps = np.diff(line.s)
    assert (line.X[0], line.Y[0], line.psi[0]) == pose
    assert line.s[-1] == pytest.approx(sum(curve.length for curve in curves))
    assert np.all(steps > 0.0)
    assert np.all(steps <= spacing * (1 + 1e-8))
    # a chord is shorter than its piece of line, by no more than the bend allows
    sharpest = max(np.abs(c.kappa(np.linspace(0, c.length, 200))).max() for c in curves)
    assert np.all(chords(line) <= steps * (1 + 1e-9))
    assert np.all(chords(line) >= steps * (1 - (sharpest * steps) ** 2 / 20) - 1e-9)
    assert np.all(np.abs(np.diff(line.psi)) <= 1.01 * sharpest * steps + 1e-9)
    # the heading points along the line at every joint
    direction = np.arctan2(np.diff(line.Y), np.diff(line.X))
    middle = (line.psi[:-1] + line.psi[1:]) / 2
    assert np.all(np.abs(np.remainder(direction - middle + np.pi, 2 * np.pi) - np.pi) < 0.05)
    fine = join(*curves, at=pose, spacing=0.3 * spacing)
    assert end(line) == pytest.approx(end(fine), abs=1e-8)
    left, right = join(*curves), join(*map(mirrored, curves))
    assert pytest.approx(left.X, abs=1e-9) == right.X
    for name in ('Y', 'psi', 'kappa'):
        assert getattr(right, name) == pytest.approx(-getattr(left, name), abs=1e-9)


def test_points_of_a_circle_give_back_its_curvature_and_length():
    angle = np.linspace(0.0, 3.0, 61)
    points = 20.0 * np.column_stack([np.sin(angle), 1.0 - np.cos(angle)])
    line = lines.line_through_points(points, 0.5)
    assert line.s[-1] == pytest.approx(60.0, abs=1e-4)
    assert line.kappa == pytest.approx(np.full_like(line.s, 0.05), abs=1e-3)
    assert line.psi == pytest.approx(line.s / 20.0, abs=1e-3)
    assert np.hypot(line.X, line.Y - 20.0) == pytest.approx(np.full_like(line.s, 20.0), abs=1e-4)


def test_a_line_through_points_is_sampled_evenly_and_straight_through_two():
    x = np.cumsum([0.0, 1.0, 3.0, 2.0, 6.0, 5.0, 2.0, 9.0])
    line = lines.line_through_points(np.column_stack([x, np.sin(x / 9.0)]), 0.5)
    assert chords(line) == pytest.approx(np.diff(line.s), rel=1e-3)
    assert np.ptp(np.diff(line.s)) < 1e-9
    line = lines.line_through_points(np.array([[0.0, 0.0], [3.0, 4.0]]), 0.5)
    assert end(line) == pytest.approx((3.0, 4.0, np.arctan2(4, 3)), abs=1e-12)
    assert line.kappa == pytest.approx(np.zeros_like(line.s), abs=1e-12)


def test_a_length_that_is_a_multiple_of_the_spacing_gets_no_extra_sample():
    assert len(join(lines.straight(0.3), spacing=0.1).s) == 4


def test_the_nearest_sample_of_two_laps_is_the_one_of_the_first_lap():
    lap = 2 * np.pi * 20.0
    line = join(lines.arc(2 * lap, 0.05), spacing=0.7)
    for s in (0.0, 33.3, 100.0):
        X, Y = lines.offset_point(lines.pose_at(line, s + lap), 1.5)
        assert line.s[lines.nearest_sample(line, X, Y)] == pytest.approx(s, abs=0.36)


CORNER = np.array([[0.0, 0.0], [10.0, 0.0], [10.0, 10.0]])
FINE = polyline.refine(CORNER, 0.3)
angles = np.linspace(0.0, 2 * np.pi, 91)
CIRCLE = 20.0 * np.column_stack([np.cos(angles), np.sin(angles)])


def test_a_refined_polyline_keeps_its_corners_and_turns():
    assert polyline.steps(FINE).max() <= 0.3 + 1e-12
    assert polyline.steps(FINE).sum() == pytest.approx(20.0)
    assert all(np.min(np.hypot(*(FINE - corner).T)) < 1e-12 for corner in CORNER)
    assert polyline.turns(CORNER) == pytest.approx([np.pi / 2])
    assert polyline.turns(np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 0.0]])) == pytest.approx([np.pi])


@everywhere
@given(
    radius=st.floats(15.0, 25.0),
    angle=st.floats(-np.pi, np.pi),
    x=st.floats(0.0, 9.0),
    y=st.floats(-5.0, 1.0),
)
def test_the_left_is_inside_of_a_circle_and_the_other_side_of_the_way_back(radius, angle, x, y):
    X, Y = radius * np.cos(angle), radius * np.sin(angle)
    assert polyline.left_of(CIRCLE, X, Y) == pytest.approx([20.0 - radius], abs=0.03)
    there, back = polyline.left_of(FINE, x, y), polyline.left_of(FINE[::-1], x, y)
    assert there == pytest.approx(-back, abs=1e-12)
    assert there == pytest.approx([y], abs=1e-12)


def test_the_side_is_known_at_a_sharp_corner_and_overruns_count_at_the_ends_alone():
    X, Y = np.array([11.0, 9.0, 10.5]), np.array([-1.0, 1.0, -0.01])
    assert np.sign(polyline.left_of(FINE, X, Y)).tolist() == [-1.0, 1.0, -1.0]
    X, Y = np.array([-2.0, 5.0, 10.0, 10.5]), np.array([0.3, 3.0, 13.0, 9.0])
    assert polyline.overrun(FINE, X, Y) == pytest.approx([2.0, 0.0, 3.0, 0.0])
    # nothing runs over the end of a closed lap
    overrun = polyline.overrun(CIRCLE, *(0.9 * CIRCLE.T))
    assert overrun.max() < polyline.steps(CIRCLE).max()
