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

    def nearest(self, X: np.ndarray, Y: np.ndarray) -> np.ndarray:
        """Return the distances [m] at the places of the line that are nearest to points (n,)."""
        dX, dY, length = np.diff(self.X), np.diff(self.Y), np.diff(self.distance)
        to_X, to_Y = X[:, None] - self.X[:-1], Y[:, None] - self.Y[:-1]
        share = np.clip((to_X * dX + to_Y * dY) / length**2, 0.0, 1.0)
        k = np.argmin((to_X - share * dX) ** 2 + (to_Y - share * dY) ** 2, axis=1)
        return self.distance[k] + share[np.arange(len(k)), k] * length[k]

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

    def positions(self, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return X and Y (discs, n) [m] of its discs at times `t` (n,) [s] from now."""
        here = self.position(t)
        if not self.others:
            return here[0][None], here[1][None]
        if self.line is None:
            return tuple(
                np.concatenate([x[None], x + dx[:, None]])
                for x, dx in zip(here, np.array(self.others).T)
            )
        along, aside = _feet(self)
        way = along[:, None] + np.hypot(self.vX, self.vY) * self._driven(t)
        lines = zip(here, self.line.at(way), aside)
        return tuple(np.concatenate([x[None], line + dx[:, None]]) for x, line, dx in lines)

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
        others = ()
        if self.others:
            ends = (end[1:, 0] - here for end, here in zip(self.positions(np.array([t])), (X, Y)))
            others = tuple(zip(*(end.tolist() for end in ends)))
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
    alone, line = obstacle._replace(others=()), obstacle.line
    if not obstacle.others:
        return (alone,)
    places = [(obstacle.X + dX, obstacle.Y + dY) for dX, dY in obstacle.others]
    if line is None:
        return alone, *(alone._replace(X=X, Y=Y) for X, Y in places)
    along, aside = _feet(obstacle)
    return alone, *(
        alone._replace(X=X, Y=Y, line=Line(line.distance, line.X + dX, line.Y + dY), along=s)
        for (X, Y), s, (dX, dY) in zip(places, along.tolist(), aside.T)
    )


@lru_cache(maxsize=1024)
def _feet(obstacle: PredictedObstacle) -> tuple[np.ndarray, np.ndarray]:
    """Return where on its line its further discs are (n,) [m], and how far beside it (2, n) [m]."""
    places = np.array([obstacle.others]).T[..., 0] + [[obstacle.X], [obstacle.Y]]
    along = obstacle.line.nearest(*places)
    return along, places - obstacle.line.at(along)


class Motion(NamedTuple):
    """The discs of obstacles over the stages; not to be changed."""

    X: np.ndarray  # (n, stages) m
    Y: np.ndarray  # (n, stages) m
    radius: np.ndarray  # (n, stages) m
    owner: np.ndarray  # (n,) which obstacle each belongs to
    first: np.ndarray  # (obstacles,) which disc is the first one of each


@lru_cache(maxsize=16)
def motion_of(
    obstacles: tuple[PredictedObstacle, ...], count: int, dt: float, growth: float
) -> Motion:
    """Return the discs of obstacles at the stages.

    A tick asks for those of the same obstacles ten times and more. The radius of an obstacle
    that moves grows by `growth` [m/s], `safety.growth_mps`: the longer the prediction, the less is
    known of where it is. The cost sees a distance that shrinks, as if D_sft grew.
    """
    t, sizes = dt * np.arange(count), [1 + len(o.others) for o in obstacles]
    X, Y = (np.concatenate(axis) for axis in zip(*(o.positions(t) for o in obstacles)))
    owner = np.repeat(np.arange(len(obstacles)), sizes)
    moves = np.array([[o.vX != 0 or o.vY != 0] for o in obstacles])
    radius = np.array([[o.r_obs] for o in obstacles]) + growth * t * moves
    motion = Motion(X, Y, radius[owner], owner, np.cumsum([0, *sizes[:-1]]))
    for shared in motion:
        shared.flags.writeable = False
    return motion
