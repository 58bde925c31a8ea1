"""Obstacles over time: position while present. Metres, seconds, frame map."""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from msgs_yaml.types import Obstacle
from scenario_publisher import schema, waypoint_track
from scenario_publisher.lines import Frame, Line, offset_point, pose_at
from scenario_publisher.schema import KeyedError
from scenario_publisher.waypoint_track import Track

MAX_OBSTACLES = 200  # each may take two of the 400 markers that topics.yaml allows
MAX_DISCS = 16  # as topics.yaml allows


class Actor(NamedTuple):
    """An obstacle as it appears, and the time during which it is present."""

    obstacle: Obstacle
    appears: float  # s
    disappears: float  # s, infinite: never
    track: Track | None = None  # of one that follows way-points or the road; None: goes straight on
    others: tuple['Actor', ...] = ()  # its further discs, each on a way of its own

    @property
    def discs(self) -> tuple['Actor', ...]:
        """All of its discs."""
        return self, *self.others


def place_actors(blocks: Sequence[schema.Obstacle], centre: Line) -> tuple[Actor, ...]:
    """Return the obstacles of the file; along and across follow the centre line at their station.

    Raises KeyedError for too many, for one beyond the road and for way-points that nobody drives.
    """
    if len(blocks) > MAX_OBSTACLES:
        what = f'has {len(blocks)} obstacles; allowed at most {MAX_OBSTACLES}'
        raise KeyedError('obstacles', what)
    return tuple(
        _place_actor(i + 1, block, centre, f'obstacles[{i}]') for i, block in enumerate(blocks)
    )


def _place_actor(number, block, centre, key):
    if not 1 <= len(block.discs_m) <= MAX_DISCS:
        what = f'has {len(block.discs_m)} discs; allowed 1 to {MAX_DISCS}'
        raise KeyedError(f'{key}.discs_m', what)
    first, *others = (_place_disc(number, block, ahead, centre, key) for ahead in block.discs_m)
    first = first._replace(others=tuple(others))
    return first._replace(obstacle=obstacle_at(first, first.appears))


def _place_disc(number, block, ahead, centre, key):
    """Return the disc so far ahead [m] of the centre as an actor of its own."""
    times = block.appears_at_s, block.disappears_at_s
    track = None
    if isinstance(block, schema.WaypointObstacle):
        points = [replace(point, station_m=point.station_m + ahead) for point in block.waypoints]
        track = waypoint_track.build_track(points, centre, key)
    elif isinstance(block, schema.RoadObstacle):
        if block.motion == schema.ALONG_ROAD or not (block.along_mps or block.across_mps):
            block, ahead = replace(block, station_m=block.station_m + ahead), 0.0
        if not 0.0 <= block.station_m <= centre.s[-1]:
            what = f'lies beyond the road with {block.station_m:g}'
            raise KeyedError(f'{key}.station_m', f'{what}; allowed 0 to {centre.s[-1]:.2f} m')
        if block.motion == schema.ALONG_ROAD:
            track = waypoint_track.build_road_track(block, centre)
    if track is not None:
        X, Y, vX, vY = waypoint_track.motion_at(track, 0.0)
    elif isinstance(block, schema.MapObstacle):
        X, Y, vX, vY = block.x_m, block.y_m, block.vx_mps, block.vy_mps
    else:
        frame = pose_at(centre, block.station_m)
        X, Y = offset_point(frame, block.offset_m)
        along = block.along_mps * np.cos(frame.psi), block.along_mps * np.sin(frame.psi)
        vX, vY = offset_point(Frame(*along, frame.psi), block.across_mps)
    if track is None and ahead:
        course = np.arctan2(vY, vX)
        X, Y = X + ahead * np.cos(course), Y + ahead * np.sin(course)
    obstacle = Obstacle(number, float(X), float(Y), block.radius_m, float(vX), float(vY))
    return Actor(obstacle, *times, track)


def is_present(actor: Actor, t: float) -> bool:
    """Return whether an obstacle is present t [s] after the start."""
    return actor.appears <= t < actor.disappears


def stays(actor: Actor) -> bool:
    """Return whether an obstacle stands at its place from the start of a run to its end."""
    return not (_fastest(actor) or actor.appears) and bool(np.isinf(actor.disappears))


def obstacle_at(actor: Actor, t: float) -> Obstacle:
    """Return an obstacle at its position, t [s] after the start, with that of its first disc."""
    first, *others = (disc_at(disc, t) for disc in actor.discs)
    return first._replace(others=tuple((o.X - first.X, o.Y - first.Y) for o in others))


def disc_at(actor: Actor, t: float) -> Obstacle:
    """Return the first disc at its position, with its velocity, t [s] after the start."""
    o = actor.obstacle._replace(others=())
    since = t - actor.appears
    if actor.track is None:
        return o._replace(X=o.X + o.vX * since, Y=o.Y + o.vY * since)
    X, Y, vX, vY = (float(value) for value in waypoint_track.motion_at(actor.track, since))
    return o._replace(X=X, Y=Y, vX=vX, vY=vY)


def expected(actor: Actor, t: float, ahead: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return X and Y (n,) of an obstacle at times `ahead` (n,) [s] of t [s] after the start."""
    o, since = actor.obstacle, t - actor.appears + ahead
    if actor.track is None:
        return o.X + o.vX * since, o.Y + o.vY * since
    X, Y, _, _ = waypoint_track.motion_at(actor.track, since)
    return X, Y


def positions(actor: Actor, until: float, step: float) -> tuple[np.ndarray, np.ndarray]:
    """Return X and Y (n,) of the first disc from its appearance until a time [s].

    Two neighbours are at most `step` [m] apart.
    """
    duration = until - actor.appears
    count = int(np.ceil(_fastest(actor) * duration / step))
    return expected(actor, actor.appears, np.linspace(0.0, duration, count + 1))


def _fastest(actor):
    """Return the highest speed [m/s]."""
    o = actor.obstacle
    return float(np.hypot(o.vX, o.vY)) if actor.track is None else actor.track.fastest
