"""How the discs of obstacles are predicted to move over the horizon. SI units.

At constant velocity, or along a course: positions at times. What is predicted of which obstacle:
`driving.obstacle_prediction`.
"""

from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import wraps
from operator import is_
from typing import Any, NamedTuple

import numpy as np

STEP_S = 0.01  # over which the velocity on a course is taken
KEPT = 8  # results of `once`


@dataclass(frozen=True, eq=False)
class Course:
    """Where the centre of a disc will be, and by how much its radius grows meanwhile."""

    step_s: float  # between two points; the first one is now
    table: np.ndarray  # (3, k, n) m, of k discs: X and Y in the map, growth, may be negative
    row: int  # of the disc in the table


class PredictedObstacle(NamedTuple):
    """A disc and how it goes on; its first fields are those of an `Obstacle` of one disc."""

    id: int  # of its object: discs and hypotheses of one object share it
    X: float  # m, map
    Y: float  # m, map
    r_obs: float  # m
    vX: float  # m/s, map
    vY: float  # m/s, map
    others: tuple[tuple[float, float], ...] = ()  # none: each disc is one of these
    course: Course | None = None  # None: it keeps its velocity
    since: float = 0.0  # s, time of the course now
    probability: float = 1.0  # of the hypothesis

    def position(self, t: Any) -> tuple[Any, Any]:
        """Return X and Y [m] `t` [s] from now; past its end a course stays where it is."""
        X, Y, _ = places((self,), np.ravel(t))[:, 0].reshape(3, *np.shape(t))
        return X, Y

    def velocity(self, t: float) -> tuple[float, float]:
        """Return vX and vY [m/s] `t` [s] from now."""
        if self.course is None:
            return self.vX, self.vY
        X, Y, _ = places((self,), np.array([t, t + STEP_S]))[:, 0].tolist()
        return (X[1] - X[0]) / STEP_S, (Y[1] - Y[0]) / STEP_S


def places(obstacles: Sequence[PredictedObstacle], t: np.ndarray) -> np.ndarray:
    """Return X, Y and radius in the problem (3, n, k) [m] of obstacles at times (k,) [s] from now.

    The radius grows with the doubt. Past its end a course stays where it is.
    """
    now = np.array([o[1:6] for o in obstacles], float).reshape(-1, 5)
    X, Y, r_obs, vX, vY = now.T[:, :, None]
    table = np.empty((3, len(now), len(t)))
    table[0], table[1], table[2] = X + vX * t, Y + vY * t, r_obs
    alike: dict[tuple[int, float], list[int]] = {}  # rows of one table at one time
    for row, o in enumerate(obstacles):
        if o.course is not None:
            alike.setdefault((id(o.course.table), o.since), []).append(row)
    for (_, since), rows in alike.items():
        courses = [obstacles[row].course for row in rows]
        values = courses[0].table[:, [course.row for course in courses]]
        number = np.clip((since + t) / courses[0].step_s, 0.0, values.shape[2] - 1)
        before = np.minimum(number.astype(int), values.shape[2] - 2)
        below, above = values[:, :, before], values[:, :, before + 1]
        table[:, rows] = below + (number - before) * (above - below)
        table[2, rows] += r_obs[rows]
    np.maximum(table[2], 0.0, out=table[2])
    return table


def moved(obstacles: Sequence[PredictedObstacle], t: float) -> tuple[PredictedObstacle, ...]:
    """Return obstacles as they will be `t` [s] from now."""
    X, Y, _ = places(obstacles, np.array([t, t + STEP_S])).tolist()
    return tuple(
        o._replace(X=x, Y=y)
        if o.course is None
        else o._replace(
            X=x, Y=y, vX=(x_later - x) / STEP_S, vY=(y_later - y) / STEP_S, since=o.since + t
        )
        for o, (x, x_later), (y, y_later) in zip(obstacles, X, Y)
    )


def once(function: Callable) -> Callable:
    """Return the function with its last results kept, by the identity of its arguments.

    A tick asks for the same ones ten times and more. Nobody may change arguments or results.
    """
    kept: deque = deque(maxlen=KEPT)  # arguments and result, the newest first

    @wraps(function)
    def asked(*arguments):
        for known, result in tuple(kept):
            if all(map(is_, known, arguments)):
                return result
        result = function(*arguments)
        kept.appendleft((arguments, result))
        return result

    return asked


@once
def stages(obstacles: Sequence[PredictedObstacle], count: int, dt: float) -> np.ndarray:
    """Return X, Y and radius (3, n, count) [m] of obstacles at the stages, not to be changed."""
    table = places(obstacles, dt * np.arange(count))
    table.flags.writeable = False
    return table
