"""Road edges: polylines to tangent parabolas near the plan, and the centre of the road."""

from typing import NamedTuple

import numpy as np

from mpcc_controller.path import compiled_queries
from mpcc_controller.path.arc import Arc
from mpcc_controller.path.distance import Edge, Edges
from msgs_yaml.types import RoadEdges

CONTINUATION = 1e3  # m; a polyline continues straight for this length at both ends


class EdgeError(ValueError):
    """A road edge cannot be used; the text names it and what is wrong."""


class Polyline(NamedTuple):
    """Corners of an edge with its continuations."""

    table: np.ndarray  # (3, n) m: X and Y in the map, length s up to each corner
    discs: np.ndarray  # of `compiled_queries`, without the continuations

    @property
    def s(self) -> np.ndarray:
        """The length (n,) [m] up to each corner."""
        return self.table[2]

    def __repr__(self):
        length = self.s[-2] - CONTINUATION
        return f'Polyline({self.table.shape[1] - 2} points, {length:.1f} m)'


class Road(NamedTuple):
    """Both edges in driving direction."""

    left: Polyline
    right: Polyline


class Track(NamedTuple):
    """The centre of the road beside points of the path."""

    centre: Arc
    half_width: np.ndarray  # (k,) m


def build(edges: RoadEdges) -> Road:
    """Check the edges; raises `EdgeError` for fewer than two distinct points or NaN."""
    return Road(_polyline('left', edges.left), _polyline('right', edges.right))


def _polyline(side, points):
    points = np.asarray(points, float)
    if points.ndim != 2 or points.shape[1] != 2 or not np.all(np.isfinite(points)):
        raise EdgeError(f'the {side} edge is not a list of finite points')
    # repetitions count once, and so does what is so near that the square of its distance, which is
    # divided by, underflows
    while len(points) > 1:
        moved = np.sum(np.diff(points, axis=0) ** 2, axis=1) > 0
        if np.all(moved):
            break
        points = points[np.concatenate(([True], moved))]
    if len(points) < 2:
        raise EdgeError(f'the {side} edge has fewer than two distinct points')
    start, end = points[0] - points[1], points[-1] - points[-2]
    points = np.vstack(
        (
            points[0] + CONTINUATION * start / np.hypot(*start),
            points,
            points[-1] + CONTINUATION * end / np.hypot(*end),
        )
    )
    s = np.concatenate(([0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))))
    table = compiled_queries.row(np.vstack((points.T, s)))
    return Polyline(table, compiled_queries.make_discs(*points[1:-1].T))


def edge_beside(line: Polyline, X, Y, window: float) -> Edge:
    """Return the parabolas tangent to the line where it is closest to positions (k,) [m].

    The continuations count only for positions whose closest corner is an end of the edge: on a
    closed road they would run across it. Heading and curvature come from the circle through the
    points `window` [m] before and after: the corners of a polyline define neither. Beyond its
    continuations the line is straight. Where it doubles back the curvature is 0.
    """
    X, Y, table = compiled_queries.row(X), compiled_queries.row(Y), line.table
    out = np.empty((4, len(X)))
    compiled_queries.call(
        'edge_beside', table.shape[1], table, line.discs, len(X), X, Y, window, out
    )
    return Edge(*out)


def edges_near(road: Road, X, Y, window: float) -> Edges:
    """Return both edges beside the planned positions (k,)."""
    return Edges(*(edge_beside(line, X, Y, window) for line in road))


def track_beside(road: Road, path: Arc, window: float, aligned: bool = False) -> Track:
    """Return the centre of the road beside points of the path, as arcs along its theta.

    The centre is that of the closest points of both edges. Where the road widens or narrows they
    lie ahead of the point of the path or behind it, and so does their centre: `aligned` moves it
    along its own direction until it is beside.
    """
    left, right = edges_near(road, path.X, path.Y, window)
    psi = np.arctan2(np.sin(left.psi) + np.sin(right.psi), np.cos(left.psi) + np.cos(right.psi))
    centre = Arc(
        X=(left.X + right.X) / 2,
        Y=(left.Y + right.Y) / 2,
        psi=psi,
        kappa=(left.kappa + right.kappa) / 2,
        theta=path.theta,
    )
    if aligned:
        cos_psi, sin_psi = np.cos(psi), np.sin(psi)
        ahead = cos_psi * (path.X - centre.X) + sin_psi * (path.Y - centre.Y)
        centre = centre._replace(X=centre.X + ahead * cos_psi, Y=centre.Y + ahead * sin_psi)
    return Track(centre, np.hypot(left.X - right.X, left.Y - right.Y) / 2)
