"""How an obstacle is predicted to move over the horizon. SI units.

At constant velocity, unless it was observed to brake: then until it stands. Straight on, unless it
follows a line. What is predicted of which obstacle: `driving.obstacle_prediction`.
"""

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

LEAST_SPEED_MPS = 0.5  # a slower obstacle that brakes stands


@dataclass(frozen=True, eq=False)
class Line:
    """Where an obstacle goes: corners (n,) and their distances [m] from the first one."""

    distance: np.ndarray
    X: np.ndarray
    Y: np.ndarray

    def at(self, distance: Any) -> tuple[Any, Any]:
        """Return X and Y [m] at a distance [m] from the first corner."""
        return tuple(np.interp(distance, self.distance, axis) for axis in (self.X, self.Y))

    def nearest(self, X: float, Y: float) -> float:
        """Return the distance [m] at the place of the line that is nearest to a point."""
        dX, dY, length = np.diff(self.X), np.diff(self.Y), np.diff(self.distance)
        ahead = ((X - self.X[:-1]) * dX + (Y - self.Y[:-1]) * dY) / (dX**2 + dY**2)
        ahead = np.clip(ahead, 0.0, 1.0)
        k = np.argmin(np.hypot(self.X[:-1] + ahead * dX - X, self.Y[:-1] + ahead * dY - Y))
        return float(self.distance[k] + ahead[k] * length[k])

    def direction(self, distance: float) -> tuple[float, float]:
        """Return the direction (1) there, in the map."""
        k = int(np.searchsorted(self.distance, distance, side='right'))
        k = min(max(k, 1), len(self.distance) - 1)
        dX, dY = self.X[k] - self.X[k - 1], self.Y[k] - self.Y[k - 1]
        length = math.hypot(dX, dY)
        return dX / length, dY / length


class PredictedObstacle(NamedTuple):
    """An obstacle and how it goes on; its first fields are those of `Obstacle`."""

    id: int
    X: float  # m, map
    Y: float  # m, map
    r_obs: float  # m
    vX: float  # m/s, map
    vY: float  # m/s, map
    others: tuple[tuple[float, float], ...] = ()  # m, map: further discs, from the first one
    braking: float = 0.0  # m/s^2, deceleration until it stands
    line: Line | None = None  # that it follows; None: a straight one
    along: float = 0.0  # m, how far along the line it is

    def position(self, t: Any) -> tuple[Any, Any]:
        """Return X and Y [m] `t` [s] from now."""
        t = self._driven(t)
        if self.line is not None:
            return self.line.at(self.along + np.hypot(self.vX, self.vY) * t)
        return self.X + self.vX * t, self.Y + self.vY * t

    def velocity(self, t: float) -> tuple[float, float]:
        """Return vX and vY [m/s] `t` [s] from now."""
        vX, vY, speed = self.vX, self.vY, np.hypot(self.vX, self.vY)
        if self.line is not None:
            dX, dY = self.line.direction(self.along + speed * self._driven(t))
            vX, vY = speed * dX, speed * dY
        share = max(1.0 - self.braking * t / speed, 0.0) if self.braking else 1.0
        return vX * share, vY * share

    def moved(self, t: float) -> 'PredictedObstacle':
        """Return the obstacle as it will be `t` [s] from now; one that then stands stays there."""
        (X, Y), (vX, vY) = self.position(t), self.velocity(t)
        ends = [disc.position(t) for disc in discs_of(self)[1:]]
        others = tuple((float(end[0] - X), float(end[1] - Y)) for end in ends)
        if self.braking and np.hypot(vX, vY) < LEAST_SPEED_MPS:
            return PredictedObstacle(self.id, X, Y, self.r_obs, 0.0, 0.0, others)
        along = self.along + np.hypot(self.vX, self.vY) * self._driven(t) if self.line else 0.0
        return self._replace(X=X, Y=Y, vX=vX, vY=vY, others=others, along=along)

    def _driven(self, t):
        """Return the time [s] in which it comes as far at its present speed as in `t`."""
        if not self.braking:
            return t
        speed = np.hypot(self.vX, self.vY)
        braked = np.minimum(t, speed / self.braking)
        return braked - self.braking * braked**2 / (2.0 * speed)


@lru_cache(maxsize=1024)
def discs_of(obstacle: PredictedObstacle) -> tuple[PredictedObstacle, ...]:
    """Return the discs of an obstacle, each as an obstacle of one disc that moves as it will.

    Along a line each follows the line from where it is, so that a truck with a trailer bends.
    """
    discs = [obstacle._replace(others=())]
    for dX, dY in obstacle.others:
        X, Y, line, along = obstacle.X + dX, obstacle.Y + dY, obstacle.line, 0.0
        if line is not None:
            along = line.nearest(X, Y)
            foot_X, foot_Y = line.at(along)
            line = Line(line.distance, line.X + (X - foot_X), line.Y + (Y - foot_Y))
        discs.append(discs[0]._replace(X=X, Y=Y, line=line, along=along))
    return tuple(discs)
