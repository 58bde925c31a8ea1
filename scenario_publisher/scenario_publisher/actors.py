"""Obstacles over time: where each one is while it is there. Metres, seconds, frame map."""

from typing import NamedTuple

import numpy as np

from msgs_yaml.types import Obstacle
from scenario_publisher import schema
from scenario_publisher.line import Frame, Line, at, beside


class Actor(NamedTuple):
    """An obstacle, placed where it is when it appears, and how long it stays."""

    obstacle: Obstacle
    appears: float  # s
    disappears: float  # s, infinite: never


def place(number: int, given: schema.MapObstacle | schema.RoadObstacle, centre: Line) -> Actor:
    """Return an obstacle of the file; along and across follow the centre line at its station."""
    if isinstance(given, schema.MapObstacle):
        X, Y, vX, vY = given.x_m, given.y_m, given.vx_mps, given.vy_mps
    else:
        frame = at(centre, given.station_m)
        X, Y = beside(frame, given.offset_m)
        ahead = given.along_mps * np.cos(frame.psi), given.along_mps * np.sin(frame.psi)
        vX, vY = beside(Frame(*ahead, frame.psi), given.across_mps)
    obstacle = Obstacle(number, float(X), float(Y), given.radius_m, float(vX), float(vY))
    return Actor(obstacle, given.appears_at_s, given.disappears_at_s)


def is_there(actor: Actor, t: float) -> bool:
    """Tell whether an obstacle is present t [s] after the start."""
    return actor.appears <= t < actor.disappears


def moved(actor: Actor, t: float) -> Obstacle:
    """Return an obstacle where it is t [s] after the start."""
    o = actor.obstacle
    since = t - actor.appears
    return o._replace(X=o.X + o.vX * since, Y=o.Y + o.vY * since)
