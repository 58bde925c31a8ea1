"""Friction over the road: patches of another friction, looked up per wheel and per step.

A patch is a convex quadrilateral in the map with a friction of its own, in place of the road's; of
patches that overlap, the last one counts. Its edge belongs to it. A wheel's friction is that under
the centre of its contact patch, held over a step of 1 ms: it jumps between steps only, where the
integrator keeps its order.

As ROS parameters a map is two flat arrays: `corners_m` = [x1, y1, ..., x4, y4] per patch, corners
in turn either way round, and `friction` with one number per patch. Split mu to the left of a
straight road along X is corners_m: [20, 0, 80, 0, 80, 4, 20, 4], friction: [0.3].
"""

from collections.abc import Sequence
from functools import cache

import casadi as ca
import numpy as np

from node_runtime.parameters import ParameterError
from vehicle_plant import double_track, named
from vehicle_plant.parameters import PatchParams, PlantParams
from vehicle_plant.state import State, Wheels

MOST_PATCHES = 16
_CORNERS = 4
_PLANE = 3  # numbers of a half-plane: n_x, n_y, offset
_SIZE = _CORNERS * _PLANE + 1  # of a patch: its half-planes, its friction
_SMALLEST_M = 1e-3


def patches(corners_m: Sequence[float], friction: Sequence[float]) -> np.ndarray:
    """Return the map as the plant takes it: (k, 13) half-planes n_x X + n_y Y <= offset; friction.

    Empty for no patches. Raises ValueError that names the patch when there are more than 16, the
    arrays do not fit, a friction is not positive, or a quadrilateral is not convex or has an edge
    below 1 mm.
    """
    corners, values = np.asarray(corners_m, dtype=float), np.asarray(friction, dtype=float)
    if corners.size != 2 * _CORNERS * values.size:
        raise ValueError(
            f'patches: corners_m has {corners.size} numbers, '
            f'{2 * _CORNERS} per friction are {2 * _CORNERS * values.size}'
        )
    if values.size > MOST_PATCHES:
        raise ValueError(f'patches: {values.size} of them, allowed are {MOST_PATCHES}')
    rows = [
        np.append(_half_planes(quad, i).ravel(), _positive(mu, i))
        for i, (quad, mu) in enumerate(zip(corners.reshape(-1, _CORNERS, 2), values))
    ]
    return np.array(rows).reshape(-1, _SIZE)


def of(p: PatchParams) -> np.ndarray:
    """Return the map of the node's parameters. Raises ParameterError."""
    try:
        return patches(p.corners_m, p.friction)
    except ValueError as error:
        raise ParameterError(str(error)) from None


def _positive(mu, i):
    if not 0.0 < mu < np.inf:
        raise ValueError(f'patches: friction of patch {i} is {mu}, allowed are positive numbers')
    return mu


def _half_planes(quad, i):
    if not np.isfinite(quad).all():
        raise ValueError(f'patches: a corner of patch {i} is not finite')
    edges = np.roll(quad, -1, axis=0) - quad
    lengths = np.hypot(*edges.T)
    turns = edges[:, 0] * np.roll(edges[:, 1], -1) - edges[:, 1] * np.roll(edges[:, 0], -1)
    # a bow tie has turns of both signs
    if lengths.min() < _SMALLEST_M or not (abs(np.sign(turns).sum()) == _CORNERS):
        raise ValueError(f'patches: patch {i} is not a convex quadrilateral: {quad.tolist()}')
    outward = np.sign(turns[0]) * np.column_stack([edges[:, 1], -edges[:, 0]]) / lengths[:, None]
    return np.column_stack([outward, (outward * quad).sum(axis=1)])


def padded(some: np.ndarray) -> np.ndarray:
    """Return a map with as many patches as there can be; the added ones contain no point."""
    nowhere = np.zeros((MOST_PATCHES - len(some), _SIZE))
    nowhere[:, _PLANE - 1] = -1.0  # 0 X + 0 Y <= -1
    return np.vstack([some, nowhere])


def grip(X, Y, friction, some):
    """Return the friction at a point [m, map] of a road with a map of patches (k, 13)."""
    for i in range(some.shape[0]):
        numbers = [some[i, j] for j in range(_SIZE)]
        inside = 1
        for at in range(0, _CORNERS * _PLANE, _PLANE):
            n_x, n_y, offset = numbers[at : at + _PLANE]
            inside = ca.logic_and(inside, n_x * X + n_y * Y <= offset)
        friction = ca.if_else(inside, numbers[-1], friction)
    return friction


@cache
def function() -> ca.Function:
    """Return grips(x, p, patches, friction) -> (4,) on flat vectors, in the order of WHEELS."""
    x = ca.SX.sym('x', len(named.names(State)))
    p = ca.SX.sym('p', len(named.names(PlantParams)))
    # row by row, as numpy and C keep it
    some = ca.SX.sym('patches', _SIZE, MOST_PATCHES)
    friction = ca.SX.sym('friction')
    planar = named.build(State, ca.vertsplit(x)).planar
    c, s = ca.cos(planar.psi), ca.sin(planar.psi)
    places = [
        (planar.X + c * at.x - s * at.y, planar.Y + s * at.x + c * at.y)
        for at in double_track.corners(named.build(PlantParams, ca.vertsplit(p)).car)
    ]
    grips = Wheels(*(grip(X, Y, friction, some.T) for X, Y in places))
    return ca.Function('grips', [x, p, some, friction], [ca.vertcat(*grips)])
