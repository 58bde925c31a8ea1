"""Friction over the road: patches of another friction, evaluated per wheel and per step.

A patch is a convex quadrilateral in the map whose friction replaces that of the road; where patches
overlap, the last one counts. Its edge belongs to it. A wheel's friction is that under the centre of
its contact patch, held over a step of 1 ms: it jumps between steps only, where the integrator keeps
its order.

As ROS parameters the patches are two flat arrays: `corners_m` = [x1, y1, ..., x4, y4] per patch,
corners in turn either way round, and `friction` with one number per patch. Split mu to the left of
a straight road along X is corners_m: [20, 0, 80, 0, 80, 4, 20, 4], friction: [0.3].
"""

from collections.abc import Sequence
from functools import cache

import casadi as ca
import numpy as np

from node_runtime import named_vector
from node_runtime.parameters import ParameterError
from vehicle_plant import suspension
from vehicle_plant.parameters import PlantParams
from vehicle_plant.state import PerWheel, State

MAX_PATCHES = 16
_CORNERS = 4
_PLANE = 3  # numbers of a half-plane: n_x, n_y, offset
_SIZE = _CORNERS * _PLANE + 1  # of a patch: its half-planes, its friction
_SHORTEST_EDGE_M = 1e-3


def patch_array(corners_m: Sequence[float], friction: Sequence[float]) -> np.ndarray:
    """Return the patches as the plant takes them, (k, 13), k = 0 for none.

    Each row has four half-planes n_x X + n_y Y <= offset and the friction. Raises ParameterError,
    which names the patch, when there are more than 16, the arrays do not fit, a friction is not
    positive, or a quadrilateral is not convex or has an edge below 1 mm.
    """
    corners, values = np.asarray(corners_m, dtype=float), np.asarray(friction, dtype=float)
    if corners.size != 2 * _CORNERS * values.size:
        raise ParameterError(
            f'patches: corners_m has {corners.size} numbers, '
            f'{2 * _CORNERS} per friction are {2 * _CORNERS * values.size}'
        )
    if values.size > MAX_PATCHES:
        raise ParameterError(f'patches: {values.size} of them, allowed are {MAX_PATCHES}')
    for i, mu in enumerate(values):
        if not 0.0 < mu < np.inf:
            raise ParameterError(
                f'patches: friction of patch {i} is {mu}, allowed are positive numbers'
            )
    planes = [_half_planes(quad, i) for i, quad in enumerate(corners.reshape(-1, _CORNERS, 2))]
    rows = [np.append(plane.ravel(), mu) for plane, mu in zip(planes, values)]
    return np.array(rows).reshape(-1, _SIZE)


def _half_planes(quad, i):
    if not np.isfinite(quad).all():
        raise ParameterError(f'patches: a corner of patch {i} is not finite')
    edges = np.roll(quad, -1, axis=0) - quad
    lengths = np.hypot(*edges.T)
    turns = edges[:, 0] * np.roll(edges[:, 1], -1) - edges[:, 1] * np.roll(edges[:, 0], -1)
    # a bow tie has turns of both signs
    if lengths.min() < _SHORTEST_EDGE_M or not (abs(np.sign(turns).sum()) == _CORNERS):
        raise ParameterError(f'patches: patch {i} is not a convex quadrilateral: {quad.tolist()}')
    outward = np.sign(turns[0]) * np.column_stack([edges[:, 1], -edges[:, 0]]) / lengths[:, None]
    return np.column_stack([outward, (outward * quad).sum(axis=1)])


def pad_patches(patches: np.ndarray) -> np.ndarray:
    """Return the patches filled up to the greatest number; the added ones contain no point."""
    empty = np.zeros((MAX_PATCHES - len(patches), _SIZE))
    empty[:, _PLANE - 1] = -1.0  # 0 X + 0 Y <= -1
    return np.vstack([patches, empty])


def friction_at(X, Y, friction, patches):
    """Return the friction at a point [m, map] of a road with patches (k, 13)."""
    for i in range(patches.shape[0]):
        numbers = [patches[i, j] for j in range(_SIZE)]
        inside = 1
        for first in range(0, _CORNERS * _PLANE, _PLANE):
            n_x, n_y, offset = numbers[first : first + _PLANE]
            inside = ca.logic_and(inside, n_x * X + n_y * Y <= offset)
        friction = ca.if_else(inside, numbers[-1], friction)
    return friction


@cache
def friction_function(state: type = State) -> ca.Function:
    """Return local_friction(x, p, patches, friction) -> (4,) on flat vectors, in WHEELS order.

    state: named tuple of the state x, with a `planar`.
    """
    x = ca.SX.sym('x', len(named_vector.names(state)))
    p = ca.SX.sym('p', len(named_vector.names(PlantParams)))
    # row by row, as numpy and C store it
    patches = ca.SX.sym('patches', _SIZE, MAX_PATCHES)
    friction = ca.SX.sym('friction')
    planar = named_vector.build(state, ca.vertsplit(x)).planar
    c, s = ca.cos(planar.psi), ca.sin(planar.psi)
    car = named_vector.build(PlantParams, ca.vertsplit(p)).car
    contacts = [
        (planar.X + c * corner.x - s * corner.y, planar.Y + s * corner.x + c * corner.y)
        for corner in suspension.wheel_corners(car)
    ]
    local = PerWheel(*(friction_at(X, Y, friction, patches.T) for X, Y in contacts))
    return ca.Function('local_friction', [x, p, patches, friction], [ca.vertcat(*local)])
