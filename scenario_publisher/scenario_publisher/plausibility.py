"""Plausibility checks of path, start, finish and obstacles on the road.

Each raises KeyedError.
"""

import math
from collections.abc import Sequence

import numpy as np

from scenario_publisher import actors, lines, schema
from scenario_publisher.actors import Actor
from scenario_publisher.lines import Frame, Line
from scenario_publisher.road_geometry import Road, distance_outside
from scenario_publisher.schema import KeyedError

CAR_RADIUS = 1.1  # m, circle around the centre of gravity that stands for a car
MOTION_STEP = 0.25  # m between the checked positions of a moving obstacle


def check_path_on_road(path: Line, road: Road, tolerance: float) -> None:
    """Reject a path with a sample off the road; ends may differ by `tolerance` [m]."""
    outside = distance_outside(road, path.X, path.Y)
    beyond = {'the left edge': outside.left, 'the right edge': outside.right}
    beyond['the end of the road'] = outside.ends - tolerance
    for name, distance in beyond.items():
        for i in np.flatnonzero(distance > 0.0):
            position = f'at station {path.s[i]:.1f} m, ({path.X[i]:.1f}, {path.Y[i]:.1f})'
            what = f'leaves the road {position}, {distance[i]:.2f} m beyond {name}'
            raise KeyedError('path', f'{what}; allowed only between the edges')


def check_start_is_free(start: Frame, road: Road, crowd: Sequence[Actor], tolerance: float) -> None:
    """Reject a start off the road or in contact with an obstacle."""
    outside = distance_outside(road, start.X, start.Y)
    if max(outside.left[0], outside.right[0], outside.ends[0] - tolerance) > 0.0:
        what = f'lies off the road at ({start.X:.1f}, {start.Y:.1f})'
        raise KeyedError('start', f'{what}; allowed only between the edges')
    for i, actor in enumerate(crowd):
        discs = actor.obstacle.discs()
        gap = min(np.hypot(o.X - start.X, o.Y - start.Y) - o.r_obs - CAR_RADIUS for o in discs)
        if actors.is_present(actor, 0.0) and gap <= 0.0:
            what = 'covers the start: '
            what += f'a car (circle of {CAR_RADIUS:g} m) overlaps it by {-gap:.2f} m'
            raise KeyedError(f'obstacles[{i}]', f'{what}; allowed a gap larger than 0 m')


def check_obstacles_touch_road(crowd: Sequence[Actor], road: Road, end: float) -> None:
    """Reject an obstacle that is never on the road until the end [s] of the run."""
    for i, actor in enumerate(crowd):
        key = f'obstacles[{i}]'
        if actor.disappears <= actor.appears:
            what = f'is not later than it appears ({actor.appears:g} s)'
            raise KeyedError(f'{key}.disappears_at_s', f'{what}; allowed only later')
        if actor.appears >= end:
            what = f'is {actor.appears:g} s, when the run is over; allowed less than {end:g} s'
            raise KeyedError(f'{key}.appears_at_s', what)
        until = min(end, actor.disappears)
        ways = [actors.positions(disc, until, MOTION_STEP) for disc in actor.discs]
        outside = [np.min(np.max(distance_outside(road, X, Y), axis=0)) for X, Y in ways]
        gap = float(min(outside)) - actor.obstacle.r_obs
        if gap >= 0.0:
            what = f'lies off the road by {gap:.2f} m at all times'
            raise KeyedError(key, f'{what}; allowed any place where it touches the road')


def check_stop_is_ahead(path: Line, stop: schema.Stop, start: Frame) -> None:
    """Reject a finish beyond the path or behind the start."""
    if stop.progress_m > path.s[-1]:
        what = f'is {stop.progress_m:g} m, beyond the end of the path'
        raise KeyedError('stop.progress_m', f'{what}; allowed up to {path.s[-1]:.2f} m')
    i = lines.nearest_sample(path, start.X, start.Y)
    if path.s[i] >= stop.progress_m:
        what = f'is {stop.progress_m:g} m, not ahead of the start'
        raise KeyedError('stop.progress_m', f'{what}; allowed more than {path.s[i]:.2f} m')


def check_start_along_path(start: Frame, path: Line) -> None:
    """Reject a start against the path."""
    i = lines.nearest_sample(path, start.X, start.Y)
    heading_error = abs(math.remainder(start.psi - path.psi[i], math.tau))
    if heading_error > math.pi / 2:
        what = f'points {np.degrees(heading_error):.0f} deg away from the path beside it'
        raise KeyedError('start', f'{what}; allowed up to 90 deg')
