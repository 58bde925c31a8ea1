"""The coarse path of a scenario as a coordinate line: stations along it, offsets to its left.

With the edges of its road. SI units, frame map.
"""

from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from msgs_yaml.types import Reference, RoadEdges

BEYOND_M = 80.0  # the line goes on straight behind its end
SPACING_M = 0.5


class RoadCoordinates:
    """A line with n samples; metres, radians, frame map.

    A road that comes close to itself (laps, crossings) has several stations there; the nearest
    counts.
    """

    def __init__(self, reference: Reference, edges: RoadEdges):
        """Take the line from the coarse path, and the offsets of the edges beside it."""
        X, Y = np.asarray(reference.X, float), np.asarray(reference.Y, float)
        s = np.concatenate([[0.0], np.cumsum(np.hypot(np.diff(X), np.diff(Y)))])
        end = np.array([X[-1] - X[-2], Y[-1] - Y[-2]]) / (s[-1] - s[-2])
        beyond = np.arange(SPACING_M, BEYOND_M, SPACING_M)
        self.s = np.concatenate([s, s[-1] + beyond])
        self.X = np.concatenate([X, X[-1] + end[0] * beyond])
        self.Y = np.concatenate([Y, Y[-1] + end[1] * beyond])
        self.psi = np.unwrap(np.arctan2(np.gradient(self.Y), np.gradient(self.X)))
        self._tree = cKDTree(np.column_stack([self.X, self.Y]))
        self.left = self._edge_offset(edges.left)
        self.right = self._edge_offset(edges.right)

    def project(self, X: np.ndarray, Y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return station and offset [m] of points, arrays of any one shape."""
        X, Y = np.asarray(X, float), np.asarray(Y, float)
        _, i = self._tree.query(np.stack([X, Y], axis=-1))
        dx, dy = X - self.X[i], Y - self.Y[i]
        cos, sin = np.cos(self.psi[i]), np.sin(self.psi[i])
        return self.s[i] + dx * cos + dy * sin, dy * cos - dx * sin

    def room(self, s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the offsets [m] of the right and the left edge at stations."""
        return np.interp(s, self.s, self.right), np.interp(s, self.s, self.left)

    def beyond_edge(self, X: np.ndarray, Y: np.ndarray) -> np.ndarray:
        """Return how far points are beyond the nearer edge [m]; negative on the road."""
        s, n = self.project(X, Y)
        right, left = self.room(s)
        return np.maximum(n - left, right - n)

    def shifted(self, s: np.ndarray, n: np.ndarray) -> 'Path':
        """Return the line at offsets n (m,) from stations s (m,), in metres."""
        x, y, psi = (np.interp(s, self.s, column) for column in (self.X, self.Y, self.psi))
        X, Y = x - n * np.sin(psi), y + n * np.cos(psi)
        along = np.concatenate([[0.0], np.cumsum(np.hypot(np.diff(X), np.diff(Y)))])
        heading = np.unwrap(np.arctan2(np.gradient(Y, along), np.gradient(X, along)))
        return Path(s, X, Y, heading, np.gradient(heading, along))

    def _edge_offset(self, points):
        """Return the offset [m] of an edge at each station."""
        # an edge bends more than its vertices show: on each side of a vertex it is straight
        along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))])
        fine = np.linspace(0.0, along[-1], max(2, int(along[-1] / SPACING_M) + 1))
        x, y = (np.interp(fine, along, column) for column in points.T)
        s, n = self.project(x, y)
        order = np.argsort(s, kind='stable')
        return np.interp(self.s, s[order], n[order])


class Path(NamedTuple):
    """A line beside the course, m samples in driving order."""

    s: np.ndarray  # m, station on the course
    X: np.ndarray  # m
    Y: np.ndarray  # m
    psi: np.ndarray  # rad, heading, continuous
    kappa: np.ndarray  # 1/m


def reference_of(path: Path, speed: np.ndarray, stamp_ns: int) -> Reference:
    """Return a path as the coarse path of a controller; `speed` (m,) [m/s] is the desired one."""
    steps = np.hypot(np.diff(path.X), np.diff(path.Y))
    t = np.concatenate([[0.0], np.cumsum(steps / ((speed[1:] + speed[:-1]) / 2))])
    return Reference(stamp_ns, path.X, path.Y, path.psi, t)
