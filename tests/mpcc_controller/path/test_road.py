"""Road edges as tangent parabolas, the middle of the road, and distances to edges and obstacles."""

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mpcc_controller.path import distance, road_edges
from mpcc_controller.path.arc import Arc
from mpcc_controller.path.distance import Circle, Disc, Edge
from mpcc_controller.path.road_edges import EdgeError
from msgs_yaml.types import RoadEdges

R = 40.0


def road(left, right):
    return road_edges.build(RoadEdges(0, np.asarray(left, float), np.asarray(right, float)))


def ring(turn):
    """Return a road of 7 m about a circle of radius R that starts along x at the origin."""
    s = np.arange(-30, 90) / R
    sides = (
        np.column_stack(((R - turn * n) * np.sin(s), turn * (R - (R - turn * n) * np.cos(s))))
        for n in (3.5, -3.5)
    )
    return road(*sides)


@given(st.floats(-50, 50), st.floats(-50, 50), st.floats(0.1, 3))
def test_v2o_is_the_gap_between_two_circles(X, Y, r_obs):
    gap = distance.v2o(Circle(0.0, 0.0, 1.1), Disc(X, Y, r_obs))
    assert gap == pytest.approx(np.hypot(X, Y) - 1.1 - r_obs, abs=1.1e-3)


def test_v2o_has_a_gradient_at_the_centre_of_an_obstacle():
    X = ca.SX.sym('X')
    D = distance.v2o(Circle(X, 0.0, 1.0), Disc(0.0, 0.0, 1.0))
    assert np.isfinite(float(ca.Function('g', [X], [ca.gradient(D, X)])(0)))


@pytest.mark.parametrize('turn', [1, -1])
def test_distances_to_curved_edges_are_those_to_circles(turn):
    for angle, n in ((0.3, 0.0), (0.5, 1.5), (1.0, -2.0)):
        radius = R - turn * n
        X, Y = radius * np.sin(angle), turn * (R - radius * np.cos(angle))
        edges = road_edges.edges_near(ring(turn), np.array([X]), np.array([Y]), 4.0)
        to_left, to_right = distance.v2e(Circle(X, Y, 1.1), edges)
        # corners 1 m apart lie 1 / (8 R) = 3 mm outside their chord
        assert float(to_left[0]) == pytest.approx(3.5 - n - 1.1, abs=5e-3)
        assert float(to_right[0]) == pytest.approx(3.5 + n - 1.1, abs=5e-3)
        for edge, at in ((edges.left, 3.5), (edges.right, -3.5)):
            assert edge.kappa[0] == pytest.approx(turn / (R - turn * at), rel=0.05)


def closest(line, X, Y):
    """Return the length [m] along an edge closest to each position; all chords are looked at."""
    (x, y), s = line.table[:2, 1:-1], line.s[1:-1]  # without the continuations
    dx, dy = np.diff(x), np.diff(y)
    ax, ay = X[:, None] - x[:-1], Y[:, None] - y[:-1]
    free = (ax * dx + ay * dy) / (dx**2 + dy**2)
    share = np.clip(free, 0, 1)
    best = np.argmin((ax - share * dx) ** 2 + (ay - share * dy) ** 2, axis=1)
    free, share = (each[np.arange(len(best)), best] for each in (free, share))
    # beyond an end the continuation counts
    outside = ((best == 0) & (share == 0)) | ((best == len(dx) - 1) & (share == 1))
    return s[best] + np.where(outside, free, share) * (s[best + 1] - s[best])


def tangent_parabolas(line, s, window):
    """Return the parabolas through the points at the lengths `s` and `window` [m] beside them."""
    # the continuations are straight: one parabola is tangent everywhere
    s = np.clip(s, line.s[0] + window, line.s[-1] - window)
    before, here, after = (
        np.array([np.interp(s + step, line.s, axis) for axis in line.table[:2]])
        for step in (-window, 0, window)
    )
    chord, into, out = after - before, here - before, after - here
    twice_area = into[0] * out[1] - into[1] * out[0]
    lengths = np.hypot(*into) * np.hypot(*out) * np.hypot(*chord)
    kappa = np.divide(2 * twice_area, lengths, out=np.zeros_like(lengths), where=lengths > 0)
    return Edge(*here, np.arctan2(chord[1], chord[0]), kappa)


@settings(max_examples=100)
@given(st.integers(0, 2**32 - 1), st.sampled_from([0.0, 1.0, 30.0]), st.sampled_from([1, 51]))
def test_an_edge_is_met_at_its_closest_chord_of_all(seed, away, count):
    rng = np.random.default_rng(seed)
    points, chord = rng.integers(2, 150), rng.choice([0.3, 2.0, 40.0])
    turn = np.cumsum(rng.normal(0.0, rng.choice([0.0, 0.02, 0.2]), points))
    line = np.cumsum(chord * np.column_stack([np.cos(turn), np.sin(turn)]), axis=0)
    edge = road(line, line).left
    at = line[rng.integers(points, size=count)] + away * rng.normal(size=(count, 2))
    window = float(rng.uniform(0.5, 6.0))
    result = road_edges.edge_beside(edge, *at.T, window)
    expected = tangent_parabolas(edge, closest(edge, *at.T), window)
    for mine, other in zip(result[:2], expected[:2]):
        assert mine == pytest.approx(other, rel=1e-12, abs=1e-10)
    assert np.abs(np.sin((result.psi - expected.psi) / 2)).max() < 1e-9
    assert result.kappa == pytest.approx(expected.kappa, rel=1e-9, abs=1e-9)


def test_an_edge_that_doubles_back_has_a_curvature_everywhere():
    back = road([[0, 3], [10, 3], [0, 3]], [[0, -3], [10, -3]])
    edges = road_edges.edges_near(back, np.linspace(-5.0, 20.0, 26), np.zeros(26), 2.0)
    assert np.all(np.isfinite(edges.left))
    nowhere = np.array([np.nan])
    assert not np.isfinite(road_edges.edge_beside(back.left, nowhere, nowhere, 2.0).X).any()


def test_in_a_funnel_the_centre_is_moved_beside_the_path():
    """Both edges close in by 45 deg: the closest points lie ahead of the point of the path."""
    sides = ([[-20.0, y * 5.0], [0.0, y * 5.0], [3.0, y * 2.0], [40.0, y * 2.0]] for y in (1, -1))
    funnel, at = road(*sides), np.array([-0.5, 1.0, 2.0])
    on_path = Arc(at, np.zeros(3), np.zeros(3), np.zeros(3), at)
    closest_points = road_edges.track_beside(funnel, on_path, 0.2)
    assert np.all(closest_points.centre.X[1:] > at[1:] + 0.5)
    track = road_edges.track_beside(funnel, on_path, 0.2, aligned=True)
    assert pytest.approx(at, abs=1e-9) == track.centre.X
    assert pytest.approx(np.zeros(3), abs=1e-9) == track.centre.Y
    assert np.array_equal(track.half_width, closest_points.half_width)


@pytest.mark.filterwarnings('error::RuntimeWarning')
def test_points_of_an_edge_whose_distance_underflows_are_merged():
    near = np.array([[0.0, 3.0], [0.0, 3.0], [5e-324, 3.0], [1e-170, 3.0], [10.0, 3.0]])
    merged = road(near, near - [0.0, 6.0])
    assert np.all(np.diff(merged.left.s) > 0)
    edges = road_edges.edges_near(merged, np.linspace(-5.0, 15.0, 21), np.zeros(21), 2.0)
    assert np.all(np.isfinite(edges.left))
    with pytest.raises(EdgeError, match='the left edge has fewer than two distinct points'):
        road(near[:4], near)


@pytest.mark.parametrize('side', ['left', 'right'])
@pytest.mark.parametrize('points', [[[0, 3]], [[0, 3], [np.nan, 3]], np.zeros((3, 2)), [1, 2]])
def test_an_edge_that_is_no_line_is_rejected_and_its_side_named(side, points):
    line = [[0, -3], [10, -3]]
    sides = {'left': line, 'right': line} | {side: points}
    with pytest.raises(EdgeError, match=f'the {side} edge'):
        road(**sides)


@pytest.mark.parametrize('along', [-5000.0, -200.0, 200.0, 1500.0])
def test_past_its_ends_an_edge_is_the_same_straight_line(along):
    direction, across = np.array([0.8, 0.6]), np.array([-0.6, 0.8])
    X, Y = along * direction + 1.0 * across
    sides = (np.outer((0.0, 10.0), direction) + n * across for n in (3.0, -3.0))
    edges = road_edges.edges_near(road(*sides), np.array([X]), np.array([Y]), 2.0)
    assert (*edges.left.kappa, *edges.right.kappa) == pytest.approx((0.0, 0.0), abs=1e-9)
    to_left, to_right = distance.v2e(Circle(X, Y, 1.1), edges)
    assert (to_left[0], to_right[0]) == pytest.approx((0.9, 2.9), abs=1e-6)
