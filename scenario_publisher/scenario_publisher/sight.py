"""Sight: what a car sees along its path, and the speed from which it can stop within that.

A crest hides what stands behind it, and so does a truck. Stations are those of the coarse path.
What obstacles hide bounds the speed as at the edges of the field of view of Orzechowski, Meyer and
Lauer, "Tackling occlusions and limited sensor range with set-based safety verification" (2018): in
every hidden place somebody is taken to begin to move into the way of the car.
"""

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np

from msgs_yaml.types import Obstacle
from node_runtime.parameters import SPEED
from scenario_publisher import actors, lines, road_geometry, schema
from scenario_publisher.actors import Actor
from scenario_publisher.lines import Frame, Line
from scenario_publisher.plausibility import CAR_RADIUS
from scenario_publisher.schema import KeyedError

FRONT = 2.5  # m from the centre of gravity to the front of a car
LENGTH = 5.0  # m, of a car
MARGIN = 0.5  # m that it leaves to who comes out
PERSON = 0.3  # m, radius of who comes out
ACCELERATION = 2.0  # m/s^2 behind: controllers do not follow a short dip of the desired speed
SHARES = {'whole': 1.0, 'half': 0.5}  # of the range within which the car can stop
STEP = 0.2  # m across the path between places; CAR_RADIUS is nearly so much wider than a car


class Sight(NamedTuple):
    """How far ahead what stands on the road is seen, and how a driver accounts for it."""

    path: Line
    table: np.ndarray  # (k, 2) m, stations and ranges there, linear between them
    rules: schema.Sight

    def __repr__(self) -> str:
        return f'Sight({np.min(self.table[:, 1]):g} m at least)'


def build(block: schema.Sight | None, path: Line) -> Sight | None:
    """Return the sight of the block `sight` along a path; None without one.

    Raises KeyedError for a table that is none, and for who comes out where nothing is hidden.
    """
    if block is None:
        return None
    if block.emerging_mps and not block.hidden_by_obstacles:
        what = f'is {block.emerging_mps:g}, but without hidden_by_obstacles nobody is hidden'
        raise KeyedError('sight.emerging_mps', f'{what}; allowed 0 m/s')
    table = road_geometry.build_table(block.stations_m, block.ranges_m, 'sight', 'ranges_m')
    return Sight(path, table, block)


def stopping_speed(distance: np.ndarray, reaction: float, deceleration: float) -> np.ndarray:
    """Return the speeds [m/s] from which a car stops within distances d [m].

    The positive root of v t + v^2 / (2 b) = d, with the reaction time t [s] and the deceleration
    b [m/s^2].
    """
    lost = deceleration * reaction
    return np.sqrt(lost**2 + 2.0 * deceleration * distance) - lost


def bound_speed(sight: Sight, speed: np.ndarray, crowd: Sequence[Actor]) -> np.ndarray:
    """Return a table (n, 2) of stations and desired speeds, from one (k, 2) that ignores sight.

    Where the range ends faster than the car comes nearer, it brakes before. Of the obstacles those
    count that stand there from the start to the end.
    """
    s, rules, share = sight.path.s, sight.rules, SHARES[sight.rules.stop_within]
    range_, b = np.interp(s, *sight.table.T), rules.deceleration_mps2
    safe = stopping_speed(share * range_, rules.reaction_s, b)
    wanted = np.minimum(np.interp(s, *speed.T), _changed_within(safe, s, b))
    if rules.emerging_mps:
        hiding = [disc.obstacle for a in crowd if actors.stays(a) for disc in a.discs]
        wanted = _bound_by_emerging(sight, wanted, _rows(hiding))
    return np.column_stack([s, wanted])


def _changed_within(speed, s, deceleration, acceleration=np.inf):
    """Return the largest speeds (n,) up to those that change by no more than this along s (n,)."""
    # v^2 + 2 b s: that of a car that brakes stays the same
    loss = 2.0 * deceleration * s
    square = np.minimum.accumulate((speed**2 + loss)[::-1])[::-1] - loss
    if np.isfinite(acceleration):
        gain = 2.0 * acceleration * s
        square = np.minimum.accumulate(square - gain) + gain
    return np.sqrt(square)


def _bound_by_emerging(sight, wanted, discs):
    """Return the largest speeds (n,) up to the wanted ones [m/s] that are safe for who comes out.

    Somebody hidden at a place is in the way of the car after the time T, from when its front is d
    before that place. With the reaction time t, the deceleration b and the margin c, the car

    - stops before them from v t + v^2 / (2 b) + c <= d, that is v <= `stopping_speed(d - c)`, or
    - has passed them with its whole length L, at the speed that it has, from v T >= d + L.

    Safe are all up to the first speed and all from the second one on; none between, and so a speed
    between becomes the first one. One that is to be safe at every d has to pass from where it does
    not stop any more, v T >= v t + v^2 / (2 b) + c + L: between the roots of that, if it has any.
    """
    path, b, reaction = sight.path, sight.rules.deceleration_mps2, sight.rules.reaction_s
    fastest = float(np.max(wanted))
    reach = FRONT + MARGIN + fastest * reaction + fastest**2 / (2.0 * b)
    # who needs longer is passed at every speed v: T = t + v / (2 b) + (c + L) / v, which is convex
    slowest = min(SPEED.low, fastest)
    last = max(v / (2.0 * b) + (MARGIN + LENGTH) / v for v in (slowest, fastest))
    beside = CAR_RADIUS + PERSON
    aside = beside + sight.rules.emerging_mps * (reaction + last)
    offset = np.arange(0.0, aside, STEP)
    in_way_s = np.maximum(offset - beside, 0.0) / sight.rules.emerging_mps
    frame = Frame(path.X[:, None], path.Y[:, None], path.psi[:, None])
    X, Y = lines.offset_point(frame, np.array([-1.0, 1.0])[:, None, None] * offset)
    taken = np.zeros(X.shape, dtype=bool)
    for cX, cY, radius in discs:
        taken |= np.hypot(X - cX, Y - cY) < radius + PERSON
    # who is behind an obstacle, seen from the path, has to come out in front of it
    can_come = ~np.logical_or.accumulate(taken, axis=-1)
    gaps = [np.empty((3, 0))]  # of speeds: index of the station, above, below
    for i, here in enumerate(path.s):
        car = path.X[i], path.Y[i]
        near = discs[np.hypot(*(discs[:, :2] - car).T) < np.hypot(reach, aside) + discs[:, 2]]
        rows = slice(*np.searchsorted(path.s, [here + FRONT, here + reach]))
        if len(near) and rows.start < rows.stop:
            d = (path.s[rows] - here - FRONT)[:, None]
            stops = stopping_speed(np.maximum(d - MARGIN, 0.0), reaction, b)
            stops = np.maximum(stops, SPEED.low)
            counts = can_come[:, rows] & (d + LENGTH > stops * in_way_s)
            counts[counts] = hidden_places(car, X[:, rows][counts], Y[:, rows][counts], near)
            row, place = np.nonzero(counts)[1:]
            with np.errstate(divide='ignore'):
                passes = (d[row, 0] + LENGTH) / in_way_s[place]
            gaps.append(np.array([np.full(len(row), i), stops[row, 0], passes]))
    station, stops, passes = np.hstack(gaps)
    station, bound = station.astype(int), np.full(len(wanted), np.inf)
    while True:  # the braking before a place may bring a speed between those of another one
        speed = np.minimum(wanted, _changed_within(bound, path.s, b, ACCELERATION))
        between = (speed[station] > stops + 1e-9) & (speed[station] < passes)
        if not between.any():
            return speed
        np.minimum.at(bound, station[between], stops[between])


def hidden_places(
    car: tuple[float, float], X: np.ndarray, Y: np.ndarray, discs: np.ndarray
) -> np.ndarray:
    """Return whether one of the discs (m, 3), rows of X, Y, radius, is before places (...) [m].

    A disc at c hides p, both from the car at (X, Y), where the angle between them is at most that
    of the tangents, whose length is l: p c >= |p| l, and p is farther than l. A disc around the car
    hides nothing.
    """
    dX, dY = X[..., None] - car[0], Y[..., None] - car[1]
    cX, cY = discs[:, 0] - car[0], discs[:, 1] - car[1]
    square = cX**2 + cY**2 - discs[:, 2] ** 2
    distance, tangent = np.hypot(dX, dY), np.sqrt(np.maximum(square, 0.0))
    behind = (dX * cX + dY * cY >= distance * tangent) & (distance > tangent)
    return np.any(behind & (square > 0.0), axis=-1)


def seen(
    sight: Sight, car: tuple[float, float], obstacles: Iterable[Obstacle]
) -> tuple[Obstacle, ...]:
    """Return the obstacles of which something is seen by a car at (X, Y).

    What is within the range of the car, or behind it, and not hidden by another obstacle.
    """
    present = tuple(obstacles)
    here, last = _station(sight, *car), float(sight.path.s[-1])
    end = here + float(np.interp(here, *sight.table.T))
    shown = present
    if end < last:  # a station is found in tens of microseconds
        places = ((o, ((0.0, 0.0), *o.others)) for o in present)
        shown = (
            o
            for o, discs in places
            if min(_station(sight, o.X + x, o.Y + y) for x, y in discs) <= end + o.r_obs
        )
    hidden = _hidden(car, present, present) if sight.rules.hidden_by_obstacles else {}
    return tuple(o for o in shown if o.id not in hidden)


def is_hidden(car: tuple[float, float], obstacle: Obstacle, present: Iterable[Obstacle]) -> bool:
    """Return whether others of `present` hide every disc of an obstacle from a car at (X, Y)."""
    return obstacle.id in _hidden(car, (obstacle,), present)


def _hidden(car, obstacles, present):
    """Return the ids of the obstacles of which every disc is hidden by others of `present`.

    A disc is hidden where the angle that it takes up is covered by those of nearer discs. Of two
    discs apart from each other the one with the shorter tangent is nearer: their radical axis is
    between them, and all rays from the car cross it in one direction.
    """
    (own_id, (cX, cY), radius), (ids, (oX, oY), radii) = (
        (np.array([d.id for d in discs]), (_rows(discs)[:, :2] - car).T, _rows(discs)[:, 2])
        for discs in ([d for o in some for d in o.discs()] for some in (obstacles, present))
    )
    own, theirs = cX**2 + cY**2 - radius**2, oX**2 + oY**2 - radii**2
    nearer = (theirs > 0.0) & (theirs < own[:, None]) & (ids != own_id[:, None])
    across, along = np.outer(cX, oY) - np.outer(cY, oX), np.outer(cX, oX) + np.outer(cY, oY)
    turn, half = np.arctan2(across, along), np.arcsin(radii / np.maximum(np.hypot(oX, oY), radii))
    low = np.where(nearer, turn - half, np.inf)
    end = np.arctan2(radius, np.sqrt(np.maximum(own, 0.0)))
    # in the order of their beginnings, from the beginning of the disc on, until a gap
    order = np.argsort(low, axis=1)
    low, high = (
        np.take_along_axis(values, order, axis=1)
        for values in (low, np.where(nearer, turn + half, -np.inf))
    )
    reached = np.maximum.accumulate(np.column_stack([-end, high]), axis=1)
    joined = np.logical_and.accumulate(low <= reached[:, :-1], axis=1)
    covered = np.max(high, axis=1, where=joined, initial=-np.inf)
    return {*own_id.tolist()} - {*own_id[covered < end].tolist()}


def _rows(discs):
    return np.array([(disc.X, disc.Y, disc.r_obs) for disc in discs]).reshape(-1, 3)


def _station(sight, X, Y):
    return float(sight.path.s[lines.nearest_sample(sight.path, X, Y)])
