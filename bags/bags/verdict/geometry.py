"""Plane geometry of the judge: polylines, circles and a rectangle; metres, radians, numpy only.

Shares nothing with the controller's distances: here a polyline stays a polyline, and the vehicle
is also judged by its true outline, not only by the circle the controller sees.
"""

from itertools import pairwise
from typing import NamedTuple

import numpy as np

TIE = 1e-9  # m, below which two distances count as equal


class Projection(NamedTuple):
    """Where points lie along a polyline; every array has one entry per point."""

    distance: np.ndarray  # m, from the start of the polyline to the foot
    offset: np.ndarray  # m, from the foot to the point, left of the driving direction positive


class Outline(NamedTuple):
    """A rectangle in the vehicle frame, x forward from the centre of gravity."""

    front: float  # m, centre of gravity to the front bumper
    rear: float  # m, centre of gravity to the rear bumper, positive
    width: float  # m


def arc_length(points):
    """Return the distance (n,) [m] of each vertex of `points` (n, 2) from the first one."""
    return np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))])


def distance_to_polyline(points, polyline):
    """Return the distance (m,) [m] of `points` (m, 2) to the nearest of the segments (n, 2).

    Positive left of the line and negative right of it, seen in the order of its vertices; beyond
    an end the side is the one of the end segment.
    """
    points = np.asarray(points, dtype=float)
    best = np.full(len(points), np.inf)
    side = np.ones(len(points))
    for tail, tip in pairwise(polyline):
        gap, offset = _to_segment(points, tail, tip)
        # at a shared vertex the segment that sees the point more squarely decides about the side
        tie = np.abs(gap - best) <= TIE
        nearer = (gap < best) & ~tie | tie & (np.abs(offset) > np.abs(side))
        side = np.where(nearer, offset, side)
        best = np.minimum(gap, best)
    return np.where(side >= 0.0, best, -best)


def _to_segment(points, tail, tip):
    """Return the distance to one segment and the signed offset from its infinite line [m]."""
    along = tip - tail
    length = np.hypot(*along)
    relative = points - tail
    share = np.clip(relative @ along / length**2, 0.0, 1.0)
    gap = np.hypot(*(relative - share[:, None] * along).T)
    return gap, (along[0] * relative[:, 1] - along[1] * relative[:, 0]) / length


def beside(line, offset):
    """Return a polyline (n, 2) moved to its left by `offset` [m], vertex by vertex."""
    along = np.gradient(line, axis=0)
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    return line + offset * np.column_stack([-along[:, 1], along[:, 0]])


def track(points, polyline, ahead):
    """Project a drive on a polyline without ever jumping to another lap or to a crossing branch.

    `points` (m, 2) are in driving order. Each is looked for within `ahead` [m] behind and before
    the foot of the one before it; the first one on the whole polyline. Return a Projection.
    """
    points = np.asarray(points, dtype=float)
    vertex = arc_length(polyline)
    tails, steps = polyline[:-1], np.diff(polyline, axis=0)
    lengths = np.diff(vertex)
    feet, offsets = np.empty(len(points)), np.empty(len(points))
    first, last = 0, len(steps)
    for i, point in enumerate(points):
        relative = point - tails[first:last]
        share = np.einsum('ij,ij->i', relative, steps[first:last]) / lengths[first:last] ** 2
        share = np.clip(share, 0.0, 1.0)
        gap = np.hypot(*(relative - share[:, None] * steps[first:last]).T)
        # the earliest of equals: a closed road starts where it ends
        k = int(np.argmax(gap <= gap.min() + TIE))
        feet[i] = vertex[first + k] + share[k] * lengths[first + k]
        dx, dy = steps[first + k]
        left = dx * relative[k, 1] - dy * relative[k, 0]
        offsets[i] = np.copysign(gap[k], left)
        first = max(0, int(np.searchsorted(vertex, feet[i] - ahead)) - 1)
        last = min(len(steps), int(np.searchsorted(vertex, feet[i] + ahead)) + 1)
    return Projection(feet, offsets)


def gap_to_circle(x, y, yaw, outline, circle_x, circle_y, radius):
    """Return the clearance (m,) [m] between the outline of the vehicle and a round obstacle.

    All arguments but `outline` are broadcast. Negative values are the depth of the overlap: how
    far the circle would have to move to touch from outside.
    """
    dx, dy = circle_x - x, circle_y - y
    forward = np.cos(yaw) * dx + np.sin(yaw) * dy
    leftward = -np.sin(yaw) * dx + np.cos(yaw) * dy
    middle = (outline.front - outline.rear) / 2
    beyond_x = np.abs(forward - middle) - (outline.front + outline.rear) / 2
    beyond_y = np.abs(leftward) - outline.width / 2
    outside = np.hypot(np.maximum(beyond_x, 0.0), np.maximum(beyond_y, 0.0))
    inside = np.minimum(np.maximum(beyond_x, beyond_y), 0.0)
    return outside + inside - radius


def corners(x, y, yaw, outline):
    """Return the four corners (4, 2) [m, map] of one vehicle, front left first, clockwise."""
    half = outline.width / 2
    body = np.array(
        [
            [outline.front, half],
            [outline.front, -half],
            [-outline.rear, -half],
            [-outline.rear, half],
        ]
    )
    turn = np.array([[np.cos(yaw), np.sin(yaw)], [-np.sin(yaw), np.cos(yaw)]])
    return body @ turn + [x, y]
