"""The path curvature that a course demands of any car, by a linear program.

A point mass drives along a straight road. Its lateral position y(x) has one curvature y'' per
STEP_M of road (small heading angles); at a constant speed v the lateral acceleration is v^2 y''.
The constraints are the safety distances to obstacles and edges, on the sides on which the coarse
path passes the obstacles; the program minimises the largest |y''|. The result is a property of the
task: no controller and no tyre model is involved.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy import sparse
from scipy.optimize import linprog

STEP_M = 0.5


class Area(NamedTuple):
    """An area that the centre of gravity must not enter, and the side on which it passes."""

    x: float  # m, centre
    y: float  # m
    radius: float  # m, obstacle + vehicle circle + safety distance
    on_left: bool  # whether the car passes to the left of the obstacle, y above it


def least_curvature(
    x: np.ndarray, low: np.ndarray, high: np.ndarray, areas: Sequence[Area]
) -> float:
    """Return the least peak curvature [1/m] that keeps a point mass within a corridor.

    x      (n,) m, ascending, driving direction of a straight road
    low    (n,) m, least y that the right edge allows to the centre of gravity
    high   (n,) m, largest y that the left edge allows
    areas  that it must not enter

    The car enters at y = 0 without heading angle. Returns inf when no curvature, however large,
    keeps it within the corridor.
    """
    low, high = low.copy(), high.copy()
    for area in areas:
        beside = np.abs(x - area.x) < area.radius
        half = np.sqrt(area.radius**2 - (x[beside] - area.x) ** 2)
        if area.on_left:
            low[beside] = np.maximum(low[beside], area.y + half)
        else:
            high[beside] = np.minimum(high[beside], area.y - half)
    if low[0] > 0.0 or high[0] < 0.0 or np.any(low > high):
        return float('inf')
    # unknowns: y and y' at every x, y'' in every interval, the peak; sparse, so that thousands of
    # tasks can be solved
    count = len(x) - 1
    step = np.diff(x)
    here, there = sparse.eye(count, count + 1), sparse.eye(count, count + 1, 1)
    moved, turned = (sparse.diags(step**power / power) for power in (2, 1))
    motion = sparse.bmat(
        [
            [there - here, -sparse.diags(step) @ here, -moved, None],
            [None, there - here, -turned, sparse.csr_matrix((count, 1))],
        ]
    )
    states = sparse.csr_matrix((count, 2 * len(x)))
    peak_column = sparse.csr_matrix(np.ones((count, 1)))
    identity = sparse.identity(count)
    within = sparse.bmat([[states, identity, -peak_column], [states, -identity, -peak_column]])
    bounds = [(0.0, 0.0), *zip(low[1:], high[1:]), (0.0, 0.0), *[(None, None)] * (2 * count)]
    solution = linprog(
        c=np.append(np.zeros(2 * len(x) + count), 1.0),
        A_ub=within,
        b_ub=np.zeros(2 * count),
        A_eq=motion,
        b_eq=np.zeros(2 * count),
        bounds=[*bounds, (0.0, None)],
    )
    return float(solution.fun) if solution.success else float('inf')
