"""Road edges near the plan: polylines to touching parabolas, and the centre of the road."""

from typing import NamedTuple

import numpy as np

from mpcc_controller.path.arc import Arc
from mpcc_controller.path.distance import Edge, Edges
from msgs_yaml.types import RoadEdges

CONTINUATION = 1e3  # m; a polyline goes on straight for this length at both ends


class EdgeError(ValueError):
    """A road edge cannot be used; the text says which."""


class Polyline(NamedTuple):
    """Corners of an edge, its ends continued."""

    points: np.ndarray  # (n, 2) m, map
    s: np.ndarray  # (n,) m, length up to each corner


class Road(NamedTuple):
    """Both edges in driving direction."""

    left: Polyline
    right: Polyline


class Track(NamedTuple):
    """The middle of the road beside points of the path."""

    centre: Arc
    half_width: np.ndarray  # (k,) m


def build(edges: RoadEdges) -> Road:
    """Check the edges; raises `EdgeError` for fewer than two distinct points or NaN."""
    return Road(_polyline('left', edges.left), _polyline('right', edges.right))


def _polyline(side, points):
    points = np.asarray(points, float)
    if points.ndim != 2 or points.shape[1] != 2 or not np.all(np.isfinite(points)):
        raise EdgeError(f'the {side} edge is not a list of finite points')
    moved = np.any(np.diff(points, axis=0) != 0, axis=1)
    points = points[np.concatenate(([True], moved))] if len(points) else points
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
    return Polyline(points, s)


def nearest(line: Polyline, X, Y) -> np.ndarray:
    """Return the length s [m] along the line next to each point; `X`, `Y` have shape (k,).

    The continuations count only for points whose nearest corner is the end of the edge: those of
    a road that comes back to itself run across it.
    """
    corners, s = line.points[1:-1], line.s[1:-1]
    chords = np.diff(corners, axis=0)
    aX = X[:, None] - corners[:-1, 0]
    aY = Y[:, None] - corners[:-1, 1]
    free = (aX * chords[:, 0] + aY * chords[:, 1]) / np.sum(chords**2, axis=1)
    share = np.clip(free, 0, 1)
    far = (aX - share * chords[:, 0]) ** 2 + (aY - share * chords[:, 1]) ** 2
    best = np.argmin(far, axis=1)
    rows = np.arange(len(best))
    along = share[rows, best]
    outside = ((best == 0) & (along == 0)) | ((best == len(chords) - 1) & (along == 1))
    along = np.where(outside, free[rows, best], along)
    return s[best] + along * np.diff(s)[best]


def touching(line: Polyline, s, window: float) -> Edge:
    """Return the parabolas that touch the line at the lengths `s` (k,).

    Heading and curvature come from the circle through the points `window` [m] before and after:
    the corners of a polyline carry neither.
    """
    before, here, after = (_point(line, s + step) for step in (-window, 0, window))
    chord = after - before
    into, out = here - before, after - here
    twice_area = into[0] * out[1] - into[1] * out[0]
    lengths = np.hypot(*into) * np.hypot(*out) * np.hypot(*chord)
    return Edge(
        X=here[0],
        Y=here[1],
        psi=np.arctan2(chord[1], chord[0]),
        kappa=2 * twice_area / lengths,
    )


def _point(line, s):
    return np.array([np.interp(s, line.s, line.points[:, axis]) for axis in (0, 1)])


def near_plan(road: Road, X, Y, window: float) -> Edges:
    """Return both edges beside the planned positions (k,)."""
    return Edges(*(touching(line, nearest(line, X, Y), window) for line in road))


def beside_path(road: Road, path: Arc, window: float) -> Track:
    """Return the centre of the road beside points of the path, as arcs along its theta."""
    left, right = near_plan(road, path.X, path.Y, window)
    psi = np.arctan2(np.sin(left.psi) + np.sin(right.psi), np.cos(left.psi) + np.cos(right.psi))
    centre = Arc(
        X=(left.X + right.X) / 2,
        Y=(left.Y + right.Y) / 2,
        psi=psi,
        kappa=(left.kappa + right.kappa) / 2,
        theta=path.theta,
    )
    return Track(centre, np.hypot(left.X - right.X, left.Y - right.Y) / 2)
