"""How obstacles move over the horizon: at constant velocity, or braking to a stop. SI units.

The message of an obstacle has its velocity, not its acceleration: braking is observed from the
messages before. An obstacle that gets faster, or turns, keeps its velocity: its acceleration tells
little about the next seconds, while one that brakes often brakes to a stop.
"""

from collections import deque
from typing import Any, NamedTuple

import numpy as np

from mpcc_controller.parameters import Surroundings
from msgs_yaml.conversions import ns_to_s
from msgs_yaml.types import Obstacle, Obstacles

MAX_DECELERATION = 12.0  # m/s^2; more is an error of the measured velocity
LEAST_SPEED_MPS = 0.5  # a slower obstacle stands


class BrakingObstacle(NamedTuple):
    """An obstacle that slows down; the fields before the last are those of `Obstacle`."""

    id: int
    X: float  # m, map
    Y: float  # m, map
    r_obs: float  # m
    vX: float  # m/s, map
    vY: float  # m/s, map
    braking: float  # m/s^2, deceleration until it stands


def position(obstacle: Obstacle | BrakingObstacle, t: Any) -> tuple[Any, Any]:
    """Return X and Y [m] of an obstacle `t` [s] from now."""
    if isinstance(obstacle, BrakingObstacle):
        speed = np.hypot(obstacle.vX, obstacle.vY)
        braked = np.minimum(t, speed / obstacle.braking)
        # the time in which it would come as far at its present speed
        t = braked - obstacle.braking * braked**2 / (2.0 * speed)
    return obstacle.X + obstacle.vX * t, obstacle.Y + obstacle.vY * t


def velocity(obstacle: Obstacle | BrakingObstacle, t: float) -> tuple[float, float]:
    """Return vX and vY [m/s] of an obstacle `t` [s] from now."""
    if not isinstance(obstacle, BrakingObstacle):
        return obstacle.vX, obstacle.vY
    share = max(1.0 - obstacle.braking * t / np.hypot(obstacle.vX, obstacle.vY), 0.0)
    return obstacle.vX * share, obstacle.vY * share


def moved(obstacle: Obstacle | BrakingObstacle, t: float) -> Obstacle | BrakingObstacle:
    """Return an obstacle as it will be `t` [s] from now; one that then stands brakes no more."""
    (X, Y), (vX, vY) = position(obstacle, t), velocity(obstacle, t)
    if isinstance(obstacle, BrakingObstacle) and np.hypot(vX, vY) < LEAST_SPEED_MPS:
        return Obstacle(obstacle.id, X, Y, obstacle.r_obs, 0.0, 0.0)
    return obstacle._replace(X=X, Y=Y, vX=vX, vY=vY)


class ObstacleObserver:
    """Observes how obstacles slow down over `surroundings.braking_window_s`.

    The controller shows it the obstacles of every tick since its (re)start, and no others: then a
    node, the ring in process and a replay predict the same bits, whatever was received between.
    """

    def __init__(self, params: Surroundings):
        self._window_s = params.braking_window_s
        self.reset()

    def reset(self) -> None:
        """Forget every obstacle."""
        self._speeds: dict[int, deque[tuple[int, float]]] = {}  # by id: (stamp_ns, m/s)

    def observe(self, obstacles: Obstacles) -> None:
        """Take a message. An obstacle that is missing in it is forgotten after the window."""
        if self._window_s is None:
            return
        self._speeds = {
            key: speeds
            for key, speeds in self._speeds.items()
            if ns_to_s(obstacles.stamp_ns - speeds[-1][0]) <= self._window_s
        }
        for o in obstacles.items:
            speeds = self._speeds.setdefault(o.id, deque())
            if speeds and speeds[-1][0] == obstacles.stamp_ns:
                speeds.pop()  # the message is repeated
            elif speeds and speeds[-1][0] > obstacles.stamp_ns:
                speeds.clear()  # the clock was set back
            speeds.append((obstacles.stamp_ns, float(np.hypot(o.vX, o.vY))))
            while ns_to_s(obstacles.stamp_ns - speeds[0][0]) > self._window_s:
                speeds.popleft()

    def predict(self, obstacles: Obstacles) -> Obstacles:
        """Return the obstacles, those that slow down as `BrakingObstacle`."""
        if self._window_s is None:
            return obstacles
        return obstacles._replace(items=tuple(map(self._predict, obstacles.items)))

    def _predict(self, o):
        braking = self._deceleration(o.id)
        is_braking = braking > 0.0 and np.hypot(o.vX, o.vY) >= LEAST_SPEED_MPS
        return BrakingObstacle(*o, braking=braking) if is_braking else o

    def _deceleration(self, key):
        """Return the mean deceleration [m/s^2] over the window."""
        speeds = self._speeds.get(key, ())
        if len(speeds) < 2:
            return 0.0
        (first_ns, first), (last_ns, last) = speeds[0], speeds[-1]
        return min((first - last) / ns_to_s(last_ns - first_ns), MAX_DECELERATION)
