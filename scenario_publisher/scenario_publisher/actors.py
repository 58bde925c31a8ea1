"""Obstacles over time: position while present. Metres, seconds, frame map."""

from typing import NamedTuple

import numpy as np

from msgs_yaml.types import Obstacle
from scenario_publisher import schema
from scenario_publisher.lines import Frame, Line, offset_point, pose_at


class Actor(NamedTuple):
    """An obstacle at the position where it appears, and the time during which it is present."""

    obstacle: Obstacle
    appears: float  # s
    disappears: float  # s, infinite: never


def place_actor(
    number: int, block: schema.MapObstacle | schema.RoadObstacle, centre: Line
) -> Actor:
    """Return an obstacle of the file; along and across follow the centre line at its station."""
    if isinstance(block, schema.MapObstacle):
        X, Y, vX, vY = block.x_m, block.y_m, block.vx_mps, block.vy_mps
    else:
        frame = pose_at(centre, block.station_m)
        X, Y = offset_point(frame, block.offset_m)
        along = block.along_mps * np.cos(frame.psi), block.along_mps * np.sin(frame.psi)
        vX, vY = offset_point(Frame(*along, frame.psi), block.across_mps)
    obstacle = Obstacle(number, float(X), float(Y), block.radius_m, float(vX), float(vY))
    return Actor(obstacle, block.appears_at_s, block.disappears_at_s)


def is_present(actor: Actor, t: float) -> bool:
    """Return whether an obstacle is present t [s] after the start."""
    return actor.appears <= t < actor.disappears


def obstacle_at(actor: Actor, t: float) -> Obstacle:
    """Return an obstacle at its position t [s] after the start."""
    o = actor.obstacle
    since = t - actor.appears
    return o._replace(X=o.X + o.vX * since, Y=o.Y + o.vY * since)
