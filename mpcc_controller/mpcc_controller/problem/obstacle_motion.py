"""How obstacles move over the horizon: on a line, at constant speed or braking to a stop. SI units.

The line is straight or, of one that moves along the road, beside it (`road_following`): the message
of an obstacle has its velocity, not its intention, and where the road bends nobody drives straight
on. Braking is observed from the messages before. An obstacle that gets faster keeps its speed: its
acceleration tells little about the next seconds, while one that brakes often brakes to a stop.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from msgs_yaml.conversions import NS_PER_S, ns_to_s
from msgs_yaml.types import Obstacle, Obstacles

MAX_DECELERATION = 12.0  # m/s^2; more is an error of the measured velocity
LEAST_SPEED_MPS = 0.5  # a slower obstacle stands
LEAST_DECELERATION = 1.0  # m/s^2; an obstacle that surely slows down by less goes on
# Student's t that a value exceeds once in 10,000 times, for 1, 2, ... degrees of freedom
STUDENT = (3183.1, 70.7, 22.2, 13.03, 9.68, 8.02, 7.06, 6.44, 6.01, 5.69, 5.45, 5.26, 5.11, 4.99)


@dataclass(frozen=True, eq=False)
class Line:
    """Where an obstacle goes: corners (n,) and their distances [m] from the first one."""

    distance: np.ndarray
    X: np.ndarray
    Y: np.ndarray

    def at(self, distance: Any) -> tuple[Any, Any]:
        """Return X and Y [m] at a distance [m] from the first corner."""
        return tuple(np.interp(distance, self.distance, axis) for axis in (self.X, self.Y))

    def direction(self, distance: float) -> tuple[float, float]:
        """Return the direction (1) there, in the map."""
        k = int(np.searchsorted(self.distance, distance, side='right'))
        k = min(max(k, 1), len(self.distance) - 1)
        dX, dY = self.X[k] - self.X[k - 1], self.Y[k] - self.Y[k - 1]
        length = math.hypot(dX, dY)
        return dX / length, dY / length


class ExpectedObstacle(NamedTuple):
    """An obstacle that slows down or follows the road; its first fields are those of `Obstacle`."""

    id: int
    X: float  # m, map
    Y: float  # m, map
    r_obs: float  # m
    vX: float  # m/s, map
    vY: float  # m/s, map
    braking: float = 0.0  # m/s^2, deceleration until it stands
    line: Line | None = None  # that it follows; None: a straight one
    along: float = 0.0  # m, how far along the line it is


AnyObstacle = Obstacle | ExpectedObstacle


def position(obstacle: AnyObstacle, t: Any) -> tuple[Any, Any]:
    """Return X and Y [m] of an obstacle `t` [s] from now."""
    t = _driven(obstacle, t)
    if isinstance(obstacle, ExpectedObstacle) and obstacle.line is not None:
        return obstacle.line.at(obstacle.along + np.hypot(obstacle.vX, obstacle.vY) * t)
    return obstacle.X + obstacle.vX * t, obstacle.Y + obstacle.vY * t


def _driven(obstacle, t):
    """Return the time [s] in which an obstacle comes as far at its present speed as in `t`."""
    if not isinstance(obstacle, ExpectedObstacle) or not obstacle.braking:
        return t
    speed = np.hypot(obstacle.vX, obstacle.vY)
    braked = np.minimum(t, speed / obstacle.braking)
    return braked - obstacle.braking * braked**2 / (2.0 * speed)


def velocity(obstacle: AnyObstacle, t: float) -> tuple[float, float]:
    """Return vX and vY [m/s] of an obstacle `t` [s] from now."""
    if not isinstance(obstacle, ExpectedObstacle):
        return obstacle.vX, obstacle.vY
    speed = np.hypot(obstacle.vX, obstacle.vY)
    share = max(1.0 - obstacle.braking * t / speed, 0.0)
    vX, vY = obstacle.vX, obstacle.vY
    if obstacle.line is not None:
        dX, dY = obstacle.line.direction(obstacle.along + speed * _driven(obstacle, t))
        vX, vY = speed * dX, speed * dY
    return vX * share, vY * share


def moved(obstacle: AnyObstacle, t: float) -> AnyObstacle:
    """Return an obstacle as it will be `t` [s] from now; one that then stands brakes no more."""
    (X, Y), (vX, vY) = position(obstacle, t), velocity(obstacle, t)
    if not isinstance(obstacle, ExpectedObstacle):
        return obstacle._replace(X=X, Y=Y, vX=vX, vY=vY)
    if np.hypot(vX, vY) < LEAST_SPEED_MPS:
        return Obstacle(obstacle.id, X, Y, obstacle.r_obs, 0.0, 0.0)
    along = obstacle.along + np.hypot(obstacle.vX, obstacle.vY) * _driven(obstacle, t)
    return obstacle._replace(X=X, Y=Y, vX=vX, vY=vY, along=along)


Speeds = Mapping[int, tuple[tuple[int, float], ...]]  # by id: (stamp_ns, m/s), the newest last


def observed(speeds: Speeds, obstacles: Obstacles, window_s: float | None) -> Speeds:
    """Return the last speeds of every obstacle, with those of a message, over a window of time.

    Without a window there are none. An obstacle that is missing is forgotten after the window. The
    controller shows the obstacles of every tick since its (re)start, and no others: then a node,
    the ring in process and a replay predict the same bits, whatever was received between.
    """
    if window_s is None:
        return {}

    def is_kept(stamp_ns):
        return ns_to_s(obstacles.stamp_ns - stamp_ns) <= window_s

    kept = {key: last for key, last in speeds.items() if is_kept(last[-1][0])}
    for o in obstacles.items:
        before = kept.get(o.id, ())
        if before and before[-1][0] == obstacles.stamp_ns:
            before = before[:-1]  # the message is repeated
        elif before and before[-1][0] > obstacles.stamp_ns:
            before = ()  # the clock was set back
        now = (obstacles.stamp_ns, float(np.hypot(o.vX, o.vY)))
        kept[o.id] = (*(s for s in before if is_kept(s[0])), now)
    return kept


def expected(obstacles: Obstacles, speeds: Speeds) -> Obstacles:
    """Return the obstacles, those that were observed to slow down as `ExpectedObstacle`."""
    if not speeds:
        return obstacles

    def predict(o):
        braking = _deceleration(speeds.get(o.id, ()))
        is_braking = braking > 0.0 and np.hypot(o.vX, o.vY) >= LEAST_SPEED_MPS
        return ExpectedObstacle(*o, braking=braking) if is_braking else o

    return obstacles._replace(items=tuple(map(predict, obstacles.items)))


def _deceleration(last) -> float:
    """Return the deceleration [m/s^2] that speeds show, 0 where noise may explain it.

    A line is fitted to the last ones. An obstacle brakes if the slope differs from 0 by more than
    the speeds scatter about the line: as many speeds as that takes, from three on, are used.
    """
    for count in range(3, len(last) + 1):
        t, v = np.array(last[-count:], float).T
        t = (t - t[-1]) / NS_PER_S
        t -= np.mean(t)
        square = np.sum(t**2)
        slope = np.sum(t * v) / square
        scatter = np.sum((v - np.mean(v) - slope * t) ** 2) / (count - 2)
        uncertain = STUDENT[min(count - 3, len(STUDENT) - 1)] * np.sqrt(scatter / square)
        if -slope > uncertain:
            return min(float(-slope), MAX_DECELERATION)
        if uncertain - slope < LEAST_DECELERATION:
            return 0.0
    return 0.0
