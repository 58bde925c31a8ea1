import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.special import fresnel

from scenario_publisher import curves, line

everywhere = settings(deadline=None, derandomize=True, max_examples=60)
lengths = st.floats(1.0, 80.0)
curvatures = st.floats(-0.1, 0.1)
pieces = st.one_of(
    st.builds(curves.straight, lengths),
    st.builds(curves.arc, lengths, curvatures),
    st.builds(curves.clothoid, lengths, curvatures, curvatures),
    st.builds(
        lambda advance, share: curves.lane_change(advance, share * advance),
        st.floats(10.0, 80.0),
        st.floats(-0.6, 0.6),
    ),
)
lists = st.lists(pieces, min_size=1, max_size=6)
poses = st.tuples(st.floats(-500, 500), st.floats(-500, 500), st.floats(-3, 3))


def mirrored(piece):
    return curves.Curve(piece.length, lambda s: -piece.kappa(s), lambda s: -piece.turn(s))


def chords(made):
    return np.hypot(np.diff(made.X), np.diff(made.Y))


def end(made):
    return made.X[-1], made.Y[-1], made.psi[-1]


def test_arc_lies_on_its_circle():
    made = line.from_curves([curves.arc(30.0, 0.05)], 1.0, 2.0, 0.3, 0.5)
    X = 1.0 + 20.0 * (np.sin(0.3 + 0.05 * made.s) - np.sin(0.3))
    Y = 2.0 - 20.0 * (np.cos(0.3 + 0.05 * made.s) - np.cos(0.3))
    assert pytest.approx(X, abs=1e-11) == made.X
    assert pytest.approx(Y, abs=1e-11) == made.Y


@pytest.mark.parametrize('spacing', [0.1, 0.5, 5.0])
def test_clothoid_from_a_straight_is_the_fresnel_integral(spacing):
    length, kappa = 40.0, 0.1
    made = line.from_curves([curves.clothoid(length, 0.0, kappa)], 0.0, 0.0, 0.0, spacing)
    scale = np.sqrt(np.pi * length / kappa)
    sine, cosine = fresnel(made.s / scale)
    assert pytest.approx(scale * cosine, abs=1e-9) == made.X
    assert pytest.approx(scale * sine, abs=1e-9) == made.Y


@pytest.mark.parametrize(('advance', 'offset'), [(30.0, 3.5), (25.0, -3.5), (61.3, 30.0)])
def test_lane_change_ends_exactly_beside_where_it_began(advance, offset):
    made = line.from_curves([curves.lane_change(advance, offset)], 0.0, 0.0, 0.0, 0.5)
    assert end(made) == pytest.approx((advance, offset, 0.0), abs=1e-9)
    assert made.kappa[[0, -1]] == pytest.approx([0.0, 0.0], abs=1e-12)


@everywhere
@given(given_pieces=lists, pose=poses, spacing=st.floats(0.2, 2.0))
def test_any_list_of_segments_gives_a_continuous_line(given_pieces, pose, spacing):
    made = line.from_curves(given_pieces, *pose, spacing)
    steps = np.diff(made.s)
    assert (made.X[0], made.Y[0], made.psi[0]) == pose
    assert np.all(steps > 0.0)
    assert np.all(steps <= spacing * (1 + 1e-8))
    # a chord is shorter than its piece of line, by no more than the bend allows
    sharpest = max(np.abs(p.kappa(np.linspace(0, p.length, 200))).max() for p in given_pieces)
    assert np.all(chords(made) <= steps * (1 + 1e-9))
    assert np.all(chords(made) >= steps * (1 - (sharpest * steps) ** 2 / 20) - 1e-9)
    assert np.all(np.abs(np.diff(made.psi)) <= 1.01 * sharpest * steps + 1e-9)


@everywhere
@given(given_pieces=lists, pose=poses, spacing=st.floats(0.2, 2.0))
def test_heading_points_along_the_line_at_every_joint(given_pieces, pose, spacing):
    made = line.from_curves(given_pieces, *pose, spacing)
    direction = np.arctan2(np.diff(made.Y), np.diff(made.X))
    middle = (made.psi[:-1] + made.psi[1:]) / 2
    error = np.abs(np.remainder(direction - middle + np.pi, 2 * np.pi) - np.pi)
    assert np.all(error < 0.05)


@everywhere
@given(given_pieces=lists)
def test_mirrored_segments_mirror_the_line(given_pieces):
    left = line.from_curves(given_pieces, 0.0, 0.0, 0.0, 1.0)
    right = line.from_curves([mirrored(p) for p in given_pieces], 0.0, 0.0, 0.0, 1.0)
    assert pytest.approx(left.X, abs=1e-9) == right.X
    for name in ('Y', 'psi', 'kappa'):
        assert getattr(right, name) == pytest.approx(-getattr(left, name), abs=1e-9)


@everywhere
@given(given_pieces=lists)
def test_finer_sampling_is_the_same_line(given_pieces):
    coarse = line.from_curves(given_pieces, 0.0, 0.0, 0.0, 2.0)
    fine = line.from_curves(given_pieces, 0.0, 0.0, 0.0, 0.3)
    assert coarse.s[-1] == pytest.approx(fine.s[-1], abs=1e-9)
    assert end(coarse) == pytest.approx(end(fine), abs=1e-8)


def test_points_of_a_circle_give_back_its_curvature_and_length():
    angle = np.linspace(0.0, 3.0, 61)
    points = 20.0 * np.column_stack([np.sin(angle), 1.0 - np.cos(angle)])
    made = line.through_points(points, 0.5)
    assert made.s[-1] == pytest.approx(60.0, abs=1e-4)
    assert made.kappa == pytest.approx(np.full_like(made.s, 0.05), abs=1e-3)
    assert made.psi == pytest.approx(made.s / 20.0, abs=1e-3)
    assert np.hypot(made.X, made.Y - 20.0) == pytest.approx(np.full_like(made.s, 20.0), abs=1e-4)


def test_line_through_points_is_sampled_evenly_whatever_the_points_are():
    x = np.cumsum([0.0, 1.0, 3.0, 2.0, 6.0, 5.0, 2.0, 9.0])
    made = line.through_points(np.column_stack([x, np.sin(x / 9.0)]), 0.5)
    assert chords(made) == pytest.approx(np.diff(made.s), rel=1e-3)
    assert np.ptp(np.diff(made.s)) < 1e-9


def test_two_points_give_a_straight_line_through_both():
    made = line.through_points(np.array([[0.0, 0.0], [3.0, 4.0]]), 0.5)
    assert end(made) == pytest.approx((3.0, 4.0, np.arctan2(4, 3)), abs=1e-12)
    assert made.kappa == pytest.approx(np.zeros_like(made.s), abs=1e-12)


def test_pose_between_samples_lies_on_the_arc():
    made = line.from_curves([curves.arc(40.0, 0.05)], 0.0, 0.0, 0.0, 1.0)
    frame = line.at(made, 17.37)
    exact = (20 * np.sin(0.05 * 17.37), 20 - 20 * np.cos(0.05 * 17.37), 0.05 * 17.37)
    assert tuple(frame) == pytest.approx(exact, abs=1e-5)


def test_beside_an_arc_is_an_arc_of_smaller_radius_on_its_inside():
    made = line.from_curves([curves.arc(40.0, 0.05)], 0.0, 0.0, 0.0, 1.0)
    X, Y = line.beside(line.Frame(made.X, made.Y, made.psi), 3.0)
    assert np.hypot(X, Y - 20.0) == pytest.approx(np.full_like(X, 17.0), abs=1e-9)


def test_length_that_is_a_multiple_of_the_spacing_gets_no_extra_sample():
    made = line.from_curves([curves.straight(0.3)], 0.0, 0.0, 0.0, 0.1)
    assert len(made.s) == 4


def test_nearest_sample_of_two_laps_is_the_one_of_the_first_lap():
    made = line.from_curves([curves.arc(4 * np.pi * 20.0, 0.05)], 0.0, 0.0, 0.0, 0.7)
    for s in (0.0, 33.3, 100.0):
        i = line.nearest(made, *line.beside(line.at(made, s + 2 * np.pi * 20.0), 1.5))
        assert made.s[i] == pytest.approx(s, abs=1.5)
