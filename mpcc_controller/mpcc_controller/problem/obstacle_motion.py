"""How the discs of obstacles are predicted to move over the horizon. SI units.

At constant velocity, or along a course: positions at times. What is predicted of which obstacle:
`driving.obstacle_prediction`.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

STEP_S = 0.01  # over which the velocity on a course is taken


@dataclass(frozen=True, eq=False)
class Course:
    """Where the centre of a disc will be, and by how much its radius grows meanwhile."""

    t: np.ndarray  # (n,) s, increasing
    X: np.ndarray  # (n,) m, map
    Y: np.ndarray  # (n,) m, map
    growth: np.ndarray  # (n,) m, may be negative


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
        if self.course is None:
            return self.X + self.vX * t, self.Y + self.vY * t
        at = self.since + t
        return tuple(np.interp(at, self.course.t, axis) for axis in (self.course.X, self.course.Y))

    def velocity(self, t: float) -> tuple[float, float]:
        """Return vX and vY [m/s] `t` [s] from now."""
        if self.course is None:
            return self.vX, self.vY
        here, later = self.position(t), self.position(t + STEP_S)
        return tuple((b - a) / STEP_S for a, b in zip(here, later))

    def radius(self, t: Any) -> Any:
        """Return the radius [m] in the problem `t` [s] from now: it grows with the doubt."""
        if self.course is None:
            return self.r_obs
        growth = np.interp(self.since + t, self.course.t, self.course.growth)
        return np.maximum(self.r_obs + growth, 0.0)

    def moved(self, t: float) -> 'PredictedObstacle':
        """Return the obstacle as it will be `t` [s] from now."""
        (X, Y), (vX, vY) = self.position(t), self.velocity(t)
        return self._replace(X=X, Y=Y, vX=vX, vY=vY, since=self.since + t if self.course else 0.0)


@lru_cache(maxsize=16)
def stages(obstacles: Sequence[PredictedObstacle], count: int, dt: float):
    """Return X, Y and radius (n, count) [m] of obstacles at the stages, not to be changed.

    A tick asks for those of the same obstacles ten times and more.
    """
    t = dt * np.arange(count)
    table = np.empty((3, len(obstacles), count))
    for row, o in enumerate(obstacles):
        table[:2, row], table[2, row] = o.position(t), o.radius(t)
    table.flags.writeable = False
    return table
