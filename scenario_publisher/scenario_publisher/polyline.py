"""Polylines, straight between their points: lengths, turns and signed distances. Metres, map."""

import numpy as np
import scipy

TIE = 1e-9  # m, below which two distances count as equal


def steps(points: np.ndarray) -> np.ndarray:
    """Return the distance (n - 1,) between neighbouring points (n, 2)."""
    return np.hypot(*np.diff(points, axis=0).T)


def running_sum(steps: np.ndarray) -> np.ndarray:
    """Return 0 and the sums of the first 1, 2, ... n steps, (n + 1,)."""
    return np.concatenate([[0.0], np.cumsum(steps)])


def turns(points: np.ndarray) -> np.ndarray:
    """Return the change of direction (n - 2,) [rad] at each inner point, 0 to pi."""
    chord = np.diff(points, axis=0)
    before, after = chord[:-1], chord[1:]
    cross = before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0]
    return np.abs(np.arctan2(cross, np.sum(before * after, axis=1)))


def refine(points: np.ndarray, spacing: float) -> np.ndarray:
    """Return the same polyline with points at most `spacing` [m] apart."""
    parts = running_sum(np.ceil(steps(points) / spacing - TIE))
    ticks = np.arange(parts[-1] + 1)
    return np.column_stack([np.interp(ticks, parts, column) for column in points.T])


def left_of(line: np.ndarray, X: np.ndarray, Y: np.ndarray) -> np.ndarray:
    """Return the distance [m] of points to the left of a polyline; to the right is negative.

    Only the two segments at the nearest vertex are evaluated, so the points of the polyline must be
    closer together than the distances of interest.
    """
    points = np.column_stack([np.atleast_1d(X), np.atleast_1d(Y)])
    nearest = scipy.spatial.cKDTree(line).query(points)[1]
    before, before_side = _segment_distance(line, np.maximum(nearest - 1, 0), points)
    after, after_side = _segment_distance(line, np.minimum(nearest, len(line) - 2), points)
    # at a shared vertex the segment that the point is more perpendicular to gives the side
    tie = np.abs(before - after) <= TIE
    take_before = np.where(tie, np.abs(before_side) > np.abs(after_side), before < after)
    side = np.where(take_before, before_side, after_side)
    return np.copysign(np.minimum(before, after), side)


def overrun(line: np.ndarray, X: np.ndarray, Y: np.ndarray) -> np.ndarray:
    """Return the distance [m] of points before the start or beyond the end of a line, else 0."""
    points = np.column_stack([np.atleast_1d(X), np.atleast_1d(Y)])
    nearest = scipy.spatial.cKDTree(line).query(points)[1]
    first, last = line[0] - line[1], line[-1] - line[-2]
    behind = (points - line[0]) @ first / np.hypot(*first)
    ahead = (points - line[-1]) @ last / np.hypot(*last)
    at_first, at_last = nearest == 0, nearest == len(line) - 1
    return np.maximum(np.where(at_first, behind, np.where(at_last, ahead, 0.0)), 0.0)


def _segment_distance(line, index, points):
    """Return the distance to a segment each and the signed offset from its infinite line."""
    tail, along = line[index], line[index + 1] - line[index]
    length = np.hypot(*along.T)
    relative = points - tail
    share = np.clip(np.sum(relative * along, axis=1) / length**2, 0.0, 1.0)
    gap = np.hypot(*(relative - share[:, None] * along).T)
    return gap, (along[:, 0] * relative[:, 1] - along[:, 1] * relative[:, 0]) / length
