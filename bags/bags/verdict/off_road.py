"""Whether the true outline of a car reached beyond an edge of the road, where and how far."""

import numpy as np

from bags.verdict import geometry

STEP_S = 0.01  # between two poses that are looked at
SPACING_M = 0.6  # between two points of the outline
INSIDE = {'left': -1.0, 'right': 1.0}  # sign of the road's side of an edge


def found(drive, s):
    """Return {left_road, left_road_at_m, beyond_edge_m} of a drive and its Series.

    `left_road_at_m` is the station [m] at which the outline first reached beyond an edge,
    `beyond_edge_m` how far [m] its farthest point ever was beyond one; None on the road.
    """
    k, beyond = beyond_edge(drive, s)
    outside = np.flatnonzero(beyond > 0.0)
    if not outside.size:
        return {'left_road': False, 'left_road_at_m': None, 'beyond_edge_m': None}
    first = float(s.station[k[outside[0]]])
    return {'left_road': True, 'left_road_at_m': first, 'beyond_edge_m': float(beyond.max())}


def beyond_edge(drive, s):
    """Return indices (n,) of odometry messages, and how far [m] the outline is beyond an edge then.

    The farthest point counts; negative where the whole outline is inside, minus infinity where it
    is so far inside that nobody asked.
    """
    motion, outline = drive.motion, drive.facts.outline
    k = _every(s.t)
    body = geometry.outline_points(outline, SPACING_M)
    # from the centre of gravity to the farthest point of the outline
    reach = np.hypot(max(outline.front, outline.rear), outline.width / 2)
    centre = np.column_stack([motion.x[k], motion.y[k]])
    beyond = np.full(len(k), -np.inf)
    for side, edge in (('left', drive.scene.left), ('right', drive.scene.right)):
        near = np.flatnonzero(INSIDE[side] * geometry.offset_from_line(centre, edge) < reach)
        if near.size:
            points = geometry.moved(body, *(column[k[near]] for column in motion[1:4]))
            inside = INSIDE[side] * geometry.offset_from_line(points.reshape(-1, 2), edge)
            farthest = -inside.reshape(len(near), -1).min(axis=1)
            beyond[near] = np.maximum(beyond[near], farthest)
    return k, beyond


def _every(t):
    """Return the indices of samples that are STEP_S apart, the last one included."""
    chosen = np.searchsorted(t, np.arange(t[0], t[-1], STEP_S))
    return np.unique(np.append(chosen, len(t) - 1))
