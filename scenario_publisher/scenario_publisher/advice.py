"""What is allowed in a scenario but rarely meant, with numbers.

A path that ends too soon or asks for more grip than there is, obstacles that leave the road, a run
that ends before the car can be there.
"""

import math
from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from scenario_publisher import polyline
from scenario_publisher.polyline import running_sum, steps
from scenario_publisher.scenario import Scenario

ALONG_ROAD_RAD = 0.5  # an obstacle whose heading differs less from the road's drives along it
MOVING = 0.5  # m/s
STEP_S = 0.1
GRAVITY = 9.81  # m/s^2
NOTICEABLE_M = 0.5  # up to here controllers make up for a path that nobody could drive exactly
LATE_S = 2.0  # after the desired arrival at the finish line an obstacle may leave the road


class Advice(NamedTuple):
    """One thing that was looked at."""

    check: str  # what holds where there is no warning
    warnings: tuple[str, ...]
    slight: bool = False  # whether a controller copes: not worth a line before each run


class PathDemand(NamedTuple):
    """What the coarse path asks for at its desired speed, sample by sample, (n,) each."""

    station: np.ndarray  # m
    t: np.ndarray  # s since the first sample
    speed: np.ndarray  # m/s
    lateral: np.ndarray  # m/s^2, to the left positive
    friction: np.ndarray  # of the road or the patch there, 1 is dry


def judge(scn: Scenario, horizon_s: float) -> list[Advice]:
    """Return everything that is looked at, with what is probably a mistake.

    horizon_s   how far ahead [s] the controller plans
    """
    demand = path_demand(scn)
    grip, wide = _missing_grip(driven_demand(scn))
    return [
        Advice(
            'the path goes on for the horizon behind the finish line',
            tuple(_short_path(scn, horizon_s)),
        ),
        Advice(
            'the path asks for no more than the grip of the road',
            tuple(grip),
            wide < NOTICEABLE_M,
        ),
        Advice('there is time to reach the finish line', tuple(_short_time(scn, demand))),
        Advice('obstacles that drive along the road stay on it', tuple(_leaving_obstacles(scn))),
    ]


def flatten(advice: Iterable[Advice]) -> list[str]:
    """Return the warnings that are worth a line before a run."""
    return [text for item in advice if not item.slight for text in item.warnings]


def path_demand(scn: Scenario) -> PathDemand:
    """Return what the coarse path asks for."""
    ref, station = scn.reference, _stations(scn)
    speed = np.interp(station, (station[1:] + station[:-1]) / 2, np.diff(station) / np.diff(ref.t))
    lateral = np.gradient(ref.psi, station) * speed**2
    friction = np.full(len(station), scn.friction)
    corners = np.reshape(scn.patches.corners_m, (-1, 4, 2))
    for quadrilateral, value in zip(corners, scn.patches.friction):
        inside = np.ones(len(ref.X), dtype=bool)  # of the convex quadrilateral
        for (x, y), (x_next, y_next) in zip(quadrilateral, np.roll(quadrilateral, -1, axis=0)):
            inside &= (x_next - x) * (ref.Y - y) - (y_next - y) * (ref.X - x) >= 0.0
        friction[inside] = value
    return PathDemand(station, ref.t - ref.t[0], speed, lateral, friction)


def driven_demand(scn: Scenario) -> PathDemand:
    """Return what the coarse path asks for from where the car starts to the finish line."""
    demand = path_demand(scn)
    end = int(np.searchsorted(demand.station, finish_station(scn))) + 1
    return PathDemand(*(column[_nearest_row(scn, scn.start) : end] for column in demand))


def finish_station(scn: Scenario) -> float:
    """Return the station [m] of the path at the finish line."""
    ref = scn.reference
    station = _stations(scn)
    ahead = np.hypot(ref.X - scn.stop.X, ref.Y - scn.stop.Y)
    # of a path with laps the last pass
    near = int(np.flatnonzero(ahead <= ahead.min() + 1e-3)[-1])
    before, after = max(near - 1, 0), min(near + 1, len(station) - 1)
    step = np.array([ref.X[after] - ref.X[before], ref.Y[after] - ref.Y[before]])
    beyond = np.array([scn.stop.X - ref.X[near], scn.stop.Y - ref.Y[near]])
    return float(station[near] + beyond @ step / np.linalg.norm(step))


def start_station(scn: Scenario) -> float:
    """Return the station [m] of the path beside which the car starts."""
    return float(_stations(scn)[_nearest_row(scn, scn.start)])


def _short_path(scn, horizon_s):
    ref, station = scn.reference, _stations(scn)
    finish = finish_station(scn)
    speed = float(np.interp(finish, station[1:], np.diff(station) / np.diff(ref.t)))
    left, needed = float(station[-1]) - finish, speed * horizon_s
    if left < needed:
        yield (
            f'the path ends {left:.0f} m behind the finish line, within the horizon: a plan of '
            f'{horizon_s:g} s at {speed:.1f} m/s reaches {needed:.0f} m ahead, so the car may '
            'brake before the finish; let path and road go on for '
            f'{math.ceil(needed - left)} m more'
        )


def _missing_grip(demand: PathDemand) -> tuple[list[str], float]:
    """Return the warning about too little grip, at most one, and how wide [m] a car runs."""
    grip = demand.friction * GRAVITY
    use = np.abs(demand.lateral) / grip
    bounds = np.flatnonzero(np.diff(np.concatenate([[0], use > 1.0, [0]])))
    stretches = [slice(first, behind) for first, behind in bounds.reshape(-1, 2)]
    if not stretches:
        return [], 0.0
    excess = np.abs(demand.lateral) - grip
    wide = 0.0  # how far a car is carried outwards by the acceleration that is missing
    for rows in stretches:
        t, a = demand.t[rows], excess[rows]
        speed = running_sum((a[1:] + a[:-1]) / 2 * np.diff(t))
        wide = max(wide, float(np.sum((speed[1:] + speed[:-1]) / 2 * np.diff(t))))
    k = int(np.argmax(use))
    speed, more = demand.speed[k], len(stretches) - 1
    others = f', and for too much at {more} other place{"s" * (more > 1)}' if more else ''
    text = (
        f'the path asks for {use[k]:.0%} of the grip at {demand.station[k]:.0f} m '
        f'({abs(demand.lateral[k]):.1f} m/s2 sideways at {speed:.1f} m/s, friction '
        f'{demand.friction[k]:g} holds {grip[k]:.1f}){others}: a car that follows it runs wide by '
        f'{wide:.1f} m; at {speed / np.sqrt(use[k]):.1f} m/s the grip would do'
    )
    return [text], wide


def _short_time(scn, demand: PathDemand):
    """Yield the warning that the run ends before a car at the desired speed can be there."""
    begin = demand.t[_nearest_row(scn, scn.start)]
    finish = finish_station(scn)
    needed = float(np.interp(finish, demand.station, demand.t)) - begin
    if needed <= scn.stop.time:
        return
    reached = float(np.interp(begin + scn.stop.time, demand.t, demand.station))
    ahead = [
        str(actor.obstacle.id)
        for actor in scn.actors
        if actor.track is None
        and np.hypot(actor.obstacle.vX, actor.obstacle.vY) < MOVING
        and demand.station[_nearest_row(scn, actor.obstacle)] > reached
    ]
    named = f'obstacle{"s" * (len(ahead) > 1)} {", ".join(ahead)}'
    obstacles = f', and before {named}' if ahead else ''
    yield (
        f'the run ends after {scn.stop.time:g} s (stop.time_s), with a car at the desired speed at '
        f'{reached:.0f} m, {finish - reached:.0f} m before the finish line{obstacles}: it needs '
        f'{math.ceil(needed)} s or more'
    )


def _nearest_row(scn, place):
    ref = scn.reference
    return int(np.argmin(np.hypot(ref.X - place.X, ref.Y - place.Y)))


def _leaving_obstacles(scn):
    arrival = float(np.interp(finish_station(scn), _stations(scn), scn.reference.t))
    end = min(scn.stop.time, arrival + LATE_S)
    for actor in scn.actors:
        o, until = actor.obstacle, min(end, actor.disappears)
        speed = np.hypot(o.vX, o.vY)
        if actor.track is not None or speed < MOVING or until <= actor.appears:
            continue
        # whether it begins along the road, in either direction
        edge = scn.edges.right
        i = int(np.argmin(np.hypot(edge[:, 0] - o.X, edge[:, 1] - o.Y)))
        i = min(i, len(edge) - 2)
        road = np.arctan2(*(edge[i + 1] - edge[i])[::-1])
        if abs(np.sin(np.arctan2(o.vY, o.vX) - road)) >= np.sin(ALONG_ROAD_RAD):
            continue
        since = np.arange(0.0, until - actor.appears, STEP_S)
        X, Y = o.X + o.vX * since, o.Y + o.vY * since
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
