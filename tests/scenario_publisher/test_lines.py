import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.special import fresnel

from scenario_publisher import lines

everywhere = settings(max_examples=60)
lengths = st.floats(5.0, 300.0)
curvatures = st.floats(-0.1, 0.1)
shares = st.floats(-0.7, 0.7)
piece_lengths = st.floats(1.0, 80.0)
pieces = st.one_of(
    st.builds(lines.straight, piece_lengths),
    st.builds(lines.arc, piece_lengths, curvatures),
    st.builds(lines.clothoid, piece_lengths, curvatures, curvatures),
    st.builds(
        lambda advance, share: lines.lane_change(advance, share * advance),
        st.floats(10.0, 80.0),
        st.floats(-0.6, 0.6),
    ),
)
lists = st.lists(pieces, min_size=1, max_size=6)
poses = st.tuples(st.floats(-500, 500), st.floats(-500, 500), st.floats(-3, 3))


def ends(curve):
    return np.array([0.0, curve.length])


def slope(function, s, step):
    return (function(s + step) - function(s - step)) / (2 * step)


@everywhere
@given(length=lengths, kappa_0=curvatures, kappa_1=curvatures)
def test_clothoid_has_the_curvatures_asked_for_at_its_ends(length, kappa_0, kappa_1):
    curve = lines.clothoid(length, kappa_0, kappa_1)
    assert curve.kappa(ends(curve)) == pytest.approx([kappa_0, kappa_1], abs=1e-12)


@everywhere
@given(advance=lengths, share=shares)
def test_lane_change_starts_and_ends_straight_and_without_curvature(advance, share):
    curve = lines.lane_change(advance, share * advance)
    assert curve.kappa(ends(curve)) == pytest.approx([0.0, 0.0], abs=1e-12)
    assert curve.turn(ends(curve)) == pytest.approx([0.0, 0.0], abs=1e-12)


@everywhere
@given(advance=lengths, share=shares)
def test_curvature_of_a_lane_change_is_the_slope_of_its_heading(advance, share):
    curve = lines.lane_change(advance, share * advance)
    s = np.linspace(0.1, 0.9, 9) * curve.length
    derivative = slope(curve.turn, s, 1e-4 * curve.length)
    assert derivative == pytest.approx(curve.kappa(s), abs=1e-6)


@everywhere
@given(length=lengths, kappa_0=curvatures, kappa_1=curvatures)
def test_curvature_of_a_clothoid_is_the_slope_of_its_heading(length, kappa_0, kappa_1):
    curve = lines.clothoid(length, kappa_0, kappa_1)
    s = np.linspace(0.1, 0.9, 9) * length
    assert slope(curve.turn, s, 1e-4 * length) == pytest.approx(curve.kappa(s), abs=1e-8)


@everywhere
@given(advance=lengths, share=shares)
def test_mirrored_lane_change_has_the_opposite_heading_and_the_same_length(advance, share):
    left = lines.lane_change(advance, share * advance)
    right = lines.lane_change(advance, -share * advance)
    s = np.linspace(0.0, left.length, 11)
    assert right.length == pytest.approx(left.length, rel=1e-12)
    assert right.turn(s) == pytest.approx(-left.turn(s), abs=1e-10)


def test_gentle_lane_change_is_the_quintic_of_least_jerk():
    advance, offset = 200.0, 1.0
    curve = lines.lane_change(advance, offset)
    q = np.linspace(0.0, 1.0, 21)
    quintic = offset / advance**2 * (60 * q - 180 * q**2 + 120 * q**3)
    assert curve.kappa(q * curve.length) == pytest.approx(quintic, abs=2e-4 * quintic.max())


def test_lane_change_of_no_offset_is_straight():
    curve = lines.lane_change(30.0, 0.0)
    assert curve.length == pytest.approx(30.0, rel=1e-14)
    assert curve.kappa(np.linspace(0, 30, 7)) == pytest.approx(np.zeros(7), abs=1e-14)


def test_lane_change_that_would_drive_across_is_refused_with_what_is_allowed():
    with pytest.raises(ValueError, match=r'moves 40 m aside within 30 m; allowed at most [\d.]+ m'):
        lines.lane_change(30.0, 40.0)


def mirrored(piece):
    return lines.Curve(piece.length, lambda s: -piece.kappa(s), lambda s: -piece.turn(s))


def chords(line):
    return np.hypot(np.diff(line.X), np.diff(line.Y))


def end(line):
    return line.X[-1], line.Y[-1], line.psi[-1]


def test_arc_lies_on_its_circle():
    line = lines.line_from_curves([lines.arc(30.0, 0.05)], 1.0, 2.0, 0.3, 0.5)
    X = 1.0 + 20.0 * (np.sin(0.3 + 0.05 * line.s) - np.sin(0.3))
    Y = 2.0 - 20.0 * (np.cos(0.3 + 0.05 * line.s) - np.cos(0.3))
    assert pytest.approx(X, abs=1e-11) == line.X
    assert pytest.approx(Y, abs=1e-11) == line.Y


@pytest.mark.parametrize('spacing', [0.1, 0.5, 5.0])
def test_clothoid_from_a_straight_is_the_fresnel_integral(spacing):
    length, kappa = 40.0, 0.1
    line = lines.line_from_curves([lines.clothoid(length, 0.0, kappa)], 0.0, 0.0, 0.0, spacing)
    scale = np.sqrt(np.pi * length / kappa)
    sine, cosine = fresnel(line.s / scale)
    assert pytest.approx(scale * cosine, abs=1e-9) == line.X
    assert pytest.approx(scale * sine, abs=1e-9) == line.Y


@pytest.mark.parametrize(('advance', 'offset'), [(30.0, 3.5), (25.0, -3.5), (61.3, 30.0)])
def test_lane_change_ends_exactly_beside_where_it_began(advance, offset):
    line = lines.line_from_curves([lines.lane_change(advance, offset)], 0.0, 0.0, 0.0, 0.5)
    assert end(line) == pytest.approx((advance, offset, 0.0), abs=1e-9)
    assert line.kappa[[0, -1]] == pytest.approx([0.0, 0.0], abs=1e-12)


@everywhere
@given(given_pieces=lists, pose=poses, spacing=st.floats(0.2, 2.0))
def test_any_list_of_segments_gives_a_continuous_line(given_pieces, pose, spacing):
    line = lines.line_from_curves(given_pieces, *pose, spacing)
    steps = np.diff(line.s)
    assert (line.X[0], line.Y[0], line.psi[0]) == pose
    assert np.all(steps > 0.0)
    assert np.all(steps <= spacing * (1 + 1e-8))
    # a chord is shorter than its piece of line, by no more than the bend allows
    sharpest = max(np.abs(p.kappa(np.linspace(0, p.length, 200))).max() for p in given_pieces)
    assert np.all(chords(line) <= steps * (1 + 1e-9))
    assert np.all(chords(line) >= steps * (1 - (sharpest * steps) ** 2 / 20) - 1e-9)
    assert np.all(np.abs(np.diff(line.psi)) <= 1.01 * sharpest * steps + 1e-9)


@everywhere
@given(given_pieces=lists, pose=poses, spacing=st.floats(0.2, 2.0))
def test_heading_points_along_the_line_at_every_joint(given_pieces, pose, spacing):
    line = lines.line_from_curves(given_pieces, *pose, spacing)
    direction = np.arctan2(np.diff(line.Y), np.diff(line.X))
    middle = (line.psi[:-1] + line.psi[1:]) / 2
    error = np.abs(np.remainder(direction - middle + np.pi, 2 * np.pi) - np.pi)
    assert np.all(error < 0.05)


@everywhere
@given(given_pieces=lists)
def test_mirrored_segments_mirror_the_line(given_pieces):
    left = lines.line_from_curves(given_pieces, 0.0, 0.0, 0.0, 1.0)
    right = lines.line_from_curves([mirrored(p) for p in given_pieces], 0.0, 0.0, 0.0, 1.0)
    assert pytest.approx(left.X, abs=1e-9) == right.X
    for name in ('Y', 'psi', 'kappa'):
        assert getattr(right, name) == pytest.approx(-getattr(left, name), abs=1e-9)


@everywhere
@given(given_pieces=lists)
def test_finer_sampling_is_the_same_line(given_pieces):
    coarse = lines.line_from_curves(given_pieces, 0.0, 0.0, 0.0, 2.0)
    fine = lines.line_from_curves(given_pieces, 0.0, 0.0, 0.0, 0.3)
    assert coarse.s[-1] == pytest.approx(fine.s[-1], abs=1e-9)
    assert end(coarse) == pytest.approx(end(fine), abs=1e-8)


def test_points_of_a_circle_give_back_its_curvature_and_length():
    angle = np.linspace(0.0, 3.0, 61)
    points = 20.0 * np.column_stack([np.sin(angle), 1.0 - np.cos(angle)])
    line = lines.line_through_points(points, 0.5)
    assert line.s[-1] == pytest.approx(60.0, abs=1e-4)
    assert line.kappa == pytest.approx(np.full_like(line.s, 0.05), abs=1e-3)
    assert line.psi == pytest.approx(line.s / 20.0, abs=1e-3)
    assert np.hypot(line.X, line.Y - 20.0) == pytest.approx(np.full_like(line.s, 20.0), abs=1e-4)


def test_line_through_points_is_sampled_evenly_whatever_the_points_are():
    x = np.cumsum([0.0, 1.0, 3.0, 2.0, 6.0, 5.0, 2.0, 9.0])
    line = lines.line_through_points(np.column_stack([x, np.sin(x / 9.0)]), 0.5)
    assert chords(line) == pytest.approx(np.diff(line.s), rel=1e-3)
    assert np.ptp(np.diff(line.s)) < 1e-9


def test_two_points_give_a_straight_line_through_both():
    line = lines.line_through_points(np.array([[0.0, 0.0], [3.0, 4.0]]), 0.5)
    assert end(line) == pytest.approx((3.0, 4.0, np.arctan2(4, 3)), abs=1e-12)
    assert line.kappa == pytest.approx(np.zeros_like(line.s), abs=1e-12)


def test_pose_between_samples_lies_on_the_arc():
    line = lines.line_from_curves([lines.arc(40.0, 0.05)], 0.0, 0.0, 0.0, 1.0)
    frame = lines.pose_at(line, 17.37)
    exact = (20 * np.sin(0.05 * 17.37), 20 - 20 * np.cos(0.05 * 17.37), 0.05 * 17.37)
    assert tuple(frame) == pytest.approx(exact, abs=1e-5)


def test_beside_an_arc_is_an_arc_of_smaller_radius_on_its_inside():
    line = lines.line_from_curves([lines.arc(40.0, 0.05)], 0.0, 0.0, 0.0, 1.0)
    X, Y = lines.offset_point(lines.Frame(line.X, line.Y, line.psi), 3.0)
    assert np.hypot(X, Y - 20.0) == pytest.approx(np.full_like(X, 17.0), abs=1e-9)


def test_length_that_is_a_multiple_of_the_spacing_gets_no_extra_sample():
    line = lines.line_from_curves([lines.straight(0.3)], 0.0, 0.0, 0.0, 0.1)
    assert len(line.s) == 4


def test_nearest_sample_of_two_laps_is_the_one_of_the_first_lap():
    line = lines.line_from_curves([lines.arc(4 * np.pi * 20.0, 0.05)], 0.0, 0.0, 0.0, 0.7)
    for s in (0.0, 33.3, 100.0):
        i = lines.nearest_sample(
            line, *lines.offset_point(lines.pose_at(line, s + 2 * np.pi * 20.0), 1.5)
        )
        assert line.s[i] == pytest.approx(s, abs=1.5)
