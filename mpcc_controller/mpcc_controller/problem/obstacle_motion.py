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

    step_s: float  # between two points; the first one is now
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
        return self._at(t, self.course.X), self._at(t, self.course.Y)

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
        return np.maximum(self.r_obs + self._at(t, self.course.growth), 0.0)

    def moved(self, t: float) -> 'PredictedObstacle':
        """Return the obstacle as it will be `t` [s] from now."""
        (X, Y), (vX, vY) = self.position(t), self.velocity(t)
        return self._replace(X=X, Y=Y, vX=vX, vY=vY, since=self.since + t if self.course else 0.0)

    def _at(self, t, values):
        number = (self.since + t) / self.course.step_s
        return np.interp(number, np.arange(len(values)), values)


@lru_cache(maxsize=16)
def stages(obstacles: Sequence[PredictedObstacle], count: int, dt: float):
    """Return X, Y and radius (n, count) [m] of obstacles at the stages, not to be changed.

    A tick asks for those of the same obstacles ten times and more.
    """
    t = dt * np.arange(count)
    table = np.empty((3, len(obstacles), count))
    by_form: dict[tuple[float, int], list[int]] = {}
    for row, o in enumerate(obstacles):
        if o.course is None:
            table[:2, row], table[2, row] = o.position(t), o.r_obs
        else:
            by_form.setdefault((o.course.step_s, len(o.course.X)), []).append(row)
    for (step_s, points), rows in by_form.items():  # all at once: `position` and `radius`
        courses = [obstacles[row].course for row in rows]
        values = np.array([[c.X, c.Y, c.growth] for c in courses]).transpose(1, 0, 2)
        since = np.array([[obstacles[row].since] for row in rows])
        number = np.clip((since + t) / step_s, 0.0, points - 1)
        before = np.minimum(number.astype(int), points - 2)
        below, above = (np.take_along_axis(values, (before + k)[None], 2) for k in (0, 1))
        table[:, rows] = below + (number - before) * (above - below)
        table[2, rows] += [[obstacles[row].r_obs] for row in rows]
    np.maximum(table[2], 0.0, out=table[2])
    table.flags.writeable = False
    return table
