"""What is allowed in a scenario but rarely meant: short paths, obstacles that leave the road."""

import math

import numpy as np

from scenario_publisher import polyline
from scenario_publisher.polyline import running_sum, steps
from scenario_publisher.scenario import Scenario

ALONG_ROAD_RAD = 0.5  # an obstacle whose heading differs less from the road's drives along it
MOVING = 0.5  # m/s
STEP_S = 0.1
LATE_S = 2.0  # after the desired arrival at the finish line an obstacle may leave the road


def find_advice(scn: Scenario, horizon_s: float) -> list[str]:
    """Return one line for each thing that is probably a mistake; [] without any.

    horizon_s   how far ahead [s] the controller plans
    """
    return [*_short_path(scn, horizon_s), *_leaving_obstacles(scn)]


def finish_station(scn: Scenario) -> float:
    """Return the station [m] of the path at the finish line."""
    ref = scn.reference
    station = running_sum(steps(np.column_stack([ref.X, ref.Y])))
    ahead = np.hypot(ref.X - scn.stop.X, ref.Y - scn.stop.Y)
    # of a path with laps the last pass
    near = np.flatnonzero(ahead <= ahead.min() + 1e-3)
    return float(station[near[-1]])


def _short_path(scn, horizon_s):
    ref = scn.reference
    station = running_sum(steps(np.column_stack([ref.X, ref.Y])))
    finish = finish_station(scn)
    speed = float(np.interp(finish, station[1:], np.diff(station) / np.diff(ref.t)))
    left, needed = float(station[-1]) - finish, speed * horizon_s
    if left >= needed:
        return []
    return [
        f'the path ends {left:.0f} m behind the finish line, within the horizon: a plan of '
        f'{horizon_s:g} s at {speed:.1f} m/s reaches {needed:.0f} m ahead, so the car may brake '
        f'before the finish; let path and road go on for {math.ceil(needed - left)} m more'
    ]


def _leaving_obstacles(scn):
    arrival = float(np.interp(finish_station(scn), _stations(scn), scn.reference.t))
    end = min(scn.stop.time, arrival + LATE_S)
    for actor in scn.actors:
        o, until = actor.obstacle, min(end, actor.disappears)
        speed = np.hypot(o.vX, o.vY)
        if actor.track is not None or speed < MOVING or until <= actor.appears:
            continue
        since = np.arange(0.0, until - actor.appears, STEP_S)
        X, Y = o.X + o.vX * since, o.Y + o.vY * since
        if not _drives_along(scn, o):
            continue
        beyond = np.maximum(
            polyline.left_of(scn.edges.left, X, Y), -polyline.left_of(scn.edges.right, X, Y)
        )
        outside = beyond - o.r_obs > 0.0
        if outside[0] or not outside.any():
            continue
        t = actor.appears + since[int(np.argmax(outside))]
        yield (
            f'obstacle {o.id} goes straight on and leaves the road {t:.1f} s after the start: '
            '`motion: along_road` beside along_mps, or way-points, keep it on the road'
        )


def _stations(scn):
    return running_sum(steps(np.column_stack([scn.reference.X, scn.reference.Y])))


def _drives_along(scn, o):
    """Return whether an obstacle begins along the road, in either direction."""
    edge = scn.edges.right
    i = int(np.argmin(np.hypot(edge[:, 0] - o.X, edge[:, 1] - o.Y)))
    i = min(i, len(edge) - 2)
    road = np.arctan2(*(edge[i + 1] - edge[i])[::-1])
    angle = np.arctan2(o.vY, o.vX) - road
    return abs(np.sin(angle)) < np.sin(ALONG_ROAD_RAD)
