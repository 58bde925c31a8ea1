"""What must be true of path, start, stop and obstacles on the road before anybody drives there."""

import math
from collections.abc import Sequence

import numpy as np

from scenario_publisher import actors, line, road, schema
from scenario_publisher.actors import Actor
from scenario_publisher.line import Frame, Line
from scenario_publisher.road import Road
from scenario_publisher.shape import Fail

CAR_RADIUS = 1.1  # m, circle around the centre of gravity that stands for a car
MAX_OBSTACLES = 200  # each may take two of the 400 markers that topics.yaml allows
MOTION_STEP = 0.25  # m between the places at which a moving obstacle is looked at


def path_stays_on_road(path: Line, where: Road, slack: float, fail: Fail):
    """Refuse a path with a sample off the road; ends may differ by `slack` [m]."""
    off = road.outside(where, path.X, path.Y)
    beyond = {'the left edge': off.left, 'the right edge': off.right}
    beyond['the end of the road'] = off.ends - slack
    for name, distance in beyond.items():
        for i in np.flatnonzero(distance > 0.0):
            place = f'at station {path.s[i]:.1f} m, ({path.X[i]:.1f}, {path.Y[i]:.1f})'
            what = f'leaves the road {place}, {distance[i]:.2f} m beyond {name}'
            raise fail('path', f'{what}; allowed only between the edges')


def start_is_free(start: Frame, where: Road, crowd: Sequence[Actor], slack: float, fail: Fail):
    """Refuse a start off the road or in contact with an obstacle."""
    off = road.outside(where, start.X, start.Y)
    if max(off.left[0], off.right[0], off.ends[0] - slack) > 0.0:
        place = f'({start.X:.1f}, {start.Y:.1f})'
        raise fail('start', f'lies off the road at {place}; allowed only between the edges')
    for i, actor in enumerate(crowd):
        o = actor.obstacle
        gap = np.hypot(o.X - start.X, o.Y - start.Y) - o.r_obs - CAR_RADIUS
        if actors.is_there(actor, 0.0) and gap <= 0.0:
            what = (
                f'covers the start: a car (circle of {CAR_RADIUS:g} m) overlaps it by {-gap:.2f} m'
            )
            raise fail(f'obstacles[{i}]', f'{what}; allowed a gap larger than 0 m')


def obstacles_touch_road(crowd: Sequence[Actor], where: Road, end: float, fail: Fail):
    """Refuse an obstacle that is never on the road until the end [s] of the run."""
    for i, actor in enumerate(crowd):
        key = f'obstacles[{i}]'
        if actor.disappears <= actor.appears:
            what = f'is not later than it appears ({actor.appears:g} s)'
            raise fail(f'{key}.disappears_at_s', f'{what}; allowed only later')
        if actor.appears >= end:
            what = f'is {actor.appears:g} s, when the run is over; allowed less than {end:g} s'
            raise fail(f'{key}.appears_at_s', what)
        gap = _distance_to_road(actor, where, min(end, actor.disappears))
        if gap >= 0.0:
            what = f'lies off the road by {gap:.2f} m at all times'
            raise fail(key, f'{what}; allowed any place where it touches the road')


def _distance_to_road(actor, where, until):
    o = actor.obstacle
    life = until - actor.appears
    steps = int(np.ceil(np.hypot(o.vX, o.vY) * life / MOTION_STEP))
    since = np.linspace(0.0, life, steps + 1)
    off = road.outside(where, o.X + o.vX * since, o.Y + o.vY * since)
    return float(np.min(np.max(off, axis=0))) - o.r_obs


def stop_is_ahead(path: Line, stop: schema.Stop, start: Frame, fail: Fail):
    """Refuse an end of the run beyond the path or behind the start, and a start the wrong way."""
    length = path.s[-1]
    if stop.progress_m > length:
        what = f'is {stop.progress_m:g} m, beyond the end of the path'
        raise fail('stop.progress_m', f'{what}; allowed up to {length:.2f} m')
    i = line.nearest(path, start.X, start.Y)
    turned = abs(math.remainder(start.psi - path.psi[i], math.tau))
    if turned > math.pi / 2:
        what = f'points {np.degrees(turned):.0f} deg away from the path beside it'
        raise fail('start', f'{what}; allowed up to 90 deg')
    if path.s[i] >= stop.progress_m:
        what = f'is {stop.progress_m:g} m, not ahead of the start'
        raise fail('stop.progress_m', f'{what}; allowed more than {path.s[i]:.2f} m')
