"""The motion of an obstacle along way-points on the road: where it is and how fast, over time.

Between two way-points the obstacle accelerates constantly from the speed of the first to that of
the second (v^2 = v_0^2 + 2 a s over the distance s along its way), and its offset from the centre
line changes as the quintic of least jerk over the stations between them. At a way-point it may
wait. Behind the last one it goes straight on at the speed and in the direction it has there.
"""

from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from scenario_publisher import lines, schema
from scenario_publisher.lines import Line
from scenario_publisher.polyline import running_sum, steps
from scenario_publisher.schema import KeyedError

SPACING = 0.1  # m between the points of a way; at 30 m of radius a turn of 0.003 rad
MIN_LEG = 0.1  # m between two way-points
MAX_WAYPOINTS = 100


class Track(NamedTuple):
    """A way as a polyline, and the phases of constant acceleration along it."""

    s: np.ndarray  # m (n,), distance along the way
    X: np.ndarray  # m (n,)
    Y: np.ndarray  # m (n,)
    begin: np.ndarray  # s (k,), at which each phase begins, since the appearance
    from_s: np.ndarray  # m (k,), where
    from_v: np.ndarray  # m/s (k,), at what speed
    a: np.ndarray  # m/s^2 (k,), acceleration in it

    @property
    def fastest(self) -> float:
        """The highest speed [m/s]."""
        return float(self.from_v.max())

    def __repr__(self) -> str:
        return f'Track({self.s[-1]:.1f} m, {len(self.begin)} phases)'


def build_track(waypoints: Sequence[schema.Waypoint], centre: Line, key: str) -> Track:
    """Return the motion along way-points on a road with a centre line.

    Raises KeyedError about the obstacle `key` for fewer than two way-points or more than
    MAX_WAYPOINTS, two at one place, one beyond the road, and for a leg that would take forever.
    """
    if not 2 <= len(waypoints) <= MAX_WAYPOINTS:
        what = f'has {len(waypoints)} way-points; allowed 2 to {MAX_WAYPOINTS}'
        raise KeyedError(f'{key}.waypoints', what)
    for i, point in enumerate(waypoints):
        if not 0.0 <= point.station_m <= centre.s[-1]:
            what = f'lies beyond the road with {point.station_m:g}; allowed 0 to '
            at = f'{key}.waypoints[{i}].station_m'
            raise KeyedError(at, f'{what}{centre.s[-1]:.2f} m')
    X, Y, distance = _way(waypoints, centre, key)
    speed = np.array([point.speed_mps for point in waypoints])
    wait = np.array([point.wait_s for point in waypoints])
    for i, point in enumerate(waypoints):
        if point.wait_s > 0.0 and point.speed_mps > 0.0:
            what = f'is {point.wait_s:g} s at {point.speed_mps:g} m/s'
            allowed = 'allowed a wait at speed_mps: 0 only'
            raise KeyedError(f'{key}.waypoints[{i}].wait_s', f'{what}; {allowed}')
    length = np.diff(distance)
    total = speed[1:] + speed[:-1]
    for i in np.flatnonzero(total <= 0.0):
        what = 'is 0 m/s, as is the one before: the obstacle would never arrive'
        allowed = 'allowed more than 0 m/s at one of both'
        raise KeyedError(f'{key}.waypoints[{i + 1}].speed_mps', f'{what}; {allowed}')
    duration = 2.0 * length / total
    a = (speed[1:] ** 2 - speed[:-1] ** 2) / (2.0 * length)
    arrive = np.concatenate([[0.0], np.cumsum(duration + wait[:-1])])
    # per way-point a phase of waiting, empty where it does not, and one of driving on
    begin = np.column_stack([arrive, arrive + wait]).ravel()
    drive = np.append(a, 0.0)
    return Track(
        running_sum(steps(np.column_stack([X, Y]))),
        X,
        Y,
        begin,
        np.repeat(distance, 2),
        np.repeat(speed, 2),
        np.column_stack([np.zeros(len(drive)), drive]).ravel(),
    )


def build_road_track(block: schema.RoadObstacle, centre: Line) -> Track | None:
    """Return the motion along the road: at constant speed and offset, or drifting across.

    The speed is that of `along_mps` and `across_mps` together, on its own way. None for an obstacle
    that does not move along the road, or that is at its end already.
    """
    end = float(centre.s[-1]) if block.along_mps > 0.0 else 0.0
    length = abs(end - block.station_m)
    if block.along_mps == 0.0 or length < MIN_LEG:
        return None
    station = np.linspace(block.station_m, end, 2 + int(length / SPACING))
    drift = block.across_mps / abs(block.along_mps) * np.abs(station - block.station_m)
    offset = block.offset_m + drift
    way = np.column_stack(lines.offset_point(lines.pose_at(centre, station), offset))
    speed = float(np.hypot(block.along_mps, block.across_mps))
    once = np.zeros(1)
    return Track(running_sum(steps(way)), *way.T, once, once, np.array([speed]), once)


def _way(waypoints, centre, key):
    """Return the points X, Y (n,) of the way and the distance (k,) along it of each way-point."""
    pieces, distance = [], [0.0]
    for i, (here, there) in enumerate(pairwise(waypoints)):
        direct = np.hypot(there.station_m - here.station_m, there.offset_m - here.offset_m)
        if direct < MIN_LEG - lines.ROUNDING:
            what = f'lies {direct:g} m from the way-point before'
            at = f'{key}.waypoints[{i + 1}]'
            raise KeyedError(at, f'{what}; allowed {MIN_LEG:g} m or more')
        q = np.linspace(0.0, 1.0, 2 + int(direct / SPACING))
        smooth = q**3 * (10.0 - 15.0 * q + 6.0 * q**2)
        frame = lines.pose_at(centre, here.station_m + q * (there.station_m - here.station_m))
        offset = here.offset_m + smooth * (there.offset_m - here.offset_m)
        piece = np.column_stack(lines.offset_point(frame, offset))
        distance.append(distance[-1] + float(steps(piece).sum()))
        pieces.append(piece[bool(i) :])
    return *np.concatenate(pieces).T, np.array(distance)


def motion_at(track: Track, t: np.ndarray) -> tuple[np.ndarray, ...]:
    """Return X, Y [m] and vX, vY [m/s] at times t [s], 0 or more, since the appearance."""
    k = np.searchsorted(track.begin, t, side='right') - 1
    since = t - track.begin[k]
    v = np.maximum(track.from_v[k] + track.a[k] * since, 0.0)
    s = track.from_s[k] + (track.from_v[k] + track.a[k] * since / 2.0) * since
    # the last segment goes on beyond the end
    i = np.clip(np.searchsorted(track.s, s, side='right') - 1, 0, len(track.s) - 2)
    length = track.s[i + 1] - track.s[i]
    tX, tY = (track.X[i + 1] - track.X[i]) / length, (track.Y[i + 1] - track.Y[i]) / length
    ahead = s - track.s[i]
    return track.X[i] + ahead * tX, track.Y[i] + ahead * tY, v * tX, v * tY
