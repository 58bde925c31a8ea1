"""The compiled queries of path and road edges equal the numpy functions that define them."""

import numpy as np
import pytest
from capabilities import require
from hypothesis import given, settings
from hypothesis import strategies as st

from mpcc_controller.path import arc, compiled_queries, frenet_frame, reference_path, road_edges
from mpcc_controller.path.arc import Arc, Pose
from mpcc_controller.path.distance import Edge
from mpcc_controller.path.reference_path import ReferencePath
from msgs_yaml.types import Reference, RoadEdges

EXACT = {'rel': 1e-12, 'abs': 1e-12}
NEAR = {'rel': 1e-12, 'abs': 1e-10}  # m, of coordinates of some 100 m
any_line = settings(max_examples=150)
lines = st.tuples(
    st.integers(0, 2**32 - 1),
    st.integers(2, 150),  # points
    st.sampled_from([0.0, 0.02, 0.2]),  # rad between two chords
    st.sampled_from([0.3, 2.0, 40.0]),  # m, length of a chord
)


@pytest.fixture(autouse=True, scope='module')
def _compiled():
    """These tests compare with the machine code: without a compiler they would compare nothing."""
    require('compiler')
    assert compiled_queries.library() is not None


def random_line(seed, points, bend, chord):
    """Return a generator of random numbers, the points (n, 2) of a line, and its headings (n,)."""
    rng = np.random.default_rng(seed)
    turn = np.cumsum(rng.normal(0.0, bend, points))
    steps = chord * np.column_stack([np.cos(turn), np.sin(turn)])
    return rng, np.cumsum(steps, axis=0), turn


def random_path(*line) -> tuple[np.random.Generator, ReferencePath]:
    """Return a generator of random numbers and a path that can be driven."""
    rng, points, turn = random_line(*line)
    t = np.cumsum(rng.uniform(0.01, 2.0, len(points)))
    return rng, reference_path.build(Reference(0, *points.T, turn, t))


def beside(rng, points, count, away):
    """Return X and Y (count,) of positions near random points of a line."""
    return (points[rng.integers(len(points), size=count)] + away * rng.normal(size=(count, 2))).T


@any_line
@given(lines)
def test_arcs_are_those_of_numpy_on_and_beyond_the_path(line):
    rng, path = random_path(*line)
    theta = rng.uniform(-30.0, path.length + 30.0, 60)
    theta[:3] = 0.0, path.length, path.arcs.theta[1]
    (arcs, v), (expected, desired) = (
        query(path, theta) for query in (reference_path.arcs_at, reference_path.arcs_by_numpy)
    )
    for mine, other in zip(arcs, expected):
        assert mine == pytest.approx(other, **NEAR)
    assert np.array_equal(v, desired)
    one, _ = reference_path.arcs_at(path, theta[5])
    assert tuple(one) == tuple(column[5] for column in arcs)


@any_line
@given(lines, st.sampled_from([0.0, 0.5, 5.0]), st.sampled_from([3.0, 20.0]))
def test_projections_are_those_of_numpy(line, away, reach):
    rng, path = random_path(*line)
    for X, Y in zip(*beside(rng, np.column_stack(path.arcs[:2]), 20, away)):
        near = rng.uniform(-5.0, path.length + 5.0)
        foot, expected = (
            query(path, X, Y, near, reach)
            for query in (reference_path.project, reference_path.project_by_numpy)
        )
        assert foot == pytest.approx(expected, **NEAR)


def closest_node(path, X, Y, near):
    """Return the theta of the nearer end of the chord closest to a point.

    The chord decides, not its ends: on a long one both are far from the foot.
    """
    arcs = Arc(*(column[1:] for column in path.arcs))
    share, inside, square = reference_path.feet_on_chords(arcs, X, Y)
    theta = arcs.theta[:-1] + inside * np.diff(arcs.theta)
    best = np.argmin(np.sqrt(square) + compiled_queries.S_PENALTY * np.abs(theta - near))
    return arcs.theta[best + int(share[best] > 0.5)]


def refine_by_numpy(path, X, Y, s):
    """Return `refine` by numpy."""
    for _ in range(compiled_queries.PROJECTION_STEPS):
        piece, _ = reference_path.arcs_by_numpy(path, s)
        left = arc.contouring_error(Pose(piece.X, piece.Y, piece.psi), X, Y)
        s = np.where(piece.kappa * left < 1, frenet_frame.to_frenet_on_arc(piece, X, Y).s, s)
    piece, _ = reference_path.arcs_by_numpy(path, s)
    return frenet_frame.FrenetPoint(
        s, arc.contouring_error(Pose(piece.X, piece.Y, piece.psi), X, Y)
    )


@any_line
@given(lines, st.sampled_from([0.0, 0.5, 5.0, 300.0]))
def test_path_coordinates_are_those_of_numpy(line, away):
    rng, path = random_path(*line)
    X, Y = beside(rng, np.column_stack(path.arcs[:2]), 20, away)
    near = rng.uniform(0.0, path.length)
    nodes = np.array([closest_node(path, *point, near) for point in zip(X, Y)])
    expected = refine_by_numpy(path, X, Y, nodes)
    point = frenet_frame.to_frenet(path, X, Y, near)
    again = frenet_frame.refine(path, X, Y, nodes)
    # a rounding before the Newton steps grows where the point is near the centre of an arc
    for mine in (point, again):
        assert mine.s == pytest.approx(expected.s, rel=1e-9, abs=1e-8)
        assert mine.e == pytest.approx(expected.e, rel=1e-9, abs=1e-8)


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

    def point(length):
        return np.array([np.interp(length, line.s, axis) for axis in line.table[:2]])

    # the continuations are straight: one parabola is tangent everywhere
    s = np.clip(s, line.s[0] + window, line.s[-1] - window)
    before, here, after = (point(s + step) for step in (-window, 0, window))
    chord, into, out = after - before, here - before, after - here
    twice_area = into[0] * out[1] - into[1] * out[0]
    lengths = np.hypot(*into) * np.hypot(*out) * np.hypot(*chord)
    kappa = np.divide(2 * twice_area, lengths, out=np.zeros_like(lengths), where=lengths > 0)
    return Edge(*here, np.arctan2(chord[1], chord[0]), kappa)


@any_line
@given(lines, st.sampled_from([0.0, 1.0, 30.0]), st.sampled_from([1, 51]))
def test_edges_beside_positions_are_those_of_numpy(line, away, count):
    rng, points, _ = random_line(*line)
    edge = road_edges.build(RoadEdges(0, points, points)).left
    X, Y = beside(rng, points, count, away)
    window = float(rng.uniform(0.5, 6.0))
    result = road_edges.edge_beside(edge, X, Y, window)
    expected = tangent_parabolas(edge, closest(edge, X, Y), window)
    for mine, other in zip(result[:2], expected[:2]):
        assert mine == pytest.approx(other, **NEAR)
    assert np.abs(np.sin((result.psi - expected.psi) / 2)).max() < 1e-9
    assert result.kappa == pytest.approx(expected.kappa, rel=1e-9, abs=1e-9)


def test_positions_that_are_not_finite_give_values_that_are_not_finite():
    _, points, turn = random_line(1, 30, 0.02, 2.0)
    path = reference_path.build(Reference(0, *points.T, turn, np.arange(30.0)))
    edge = road_edges.build(RoadEdges(0, points, points)).left
    nowhere = np.array([np.nan])
    assert not np.isfinite(road_edges.edge_beside(edge, nowhere, nowhere, 2.0).X).any()
    assert not np.isfinite(reference_path.arcs_at(path, nowhere)[0].X).any()
    assert not np.isfinite(frenet_frame.refine(path, nowhere, nowhere, nowhere).e).any()


def test_long_roads_are_searched_in_blocks():
    """The closest chord of 40,000 is found in the block that holds it."""
    x = np.arange(40_000) * 0.5
    road = road_edges.build(RoadEdges(0, *(np.column_stack((x, 0 * x + y)) for y in (3.0, -3.0))))
    assert road.left.discs.shape == (3, 2_500)
    X = np.linspace(12_345.6, 12_395.6, 51)
    left, right = road_edges.edges_near(road, X, 0 * X, 4.0)
    assert pytest.approx(X, **EXACT) == left.X
    assert pytest.approx(np.full(51, -3.0), **EXACT) == right.Y
