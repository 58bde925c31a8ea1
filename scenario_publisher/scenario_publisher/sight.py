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
MARGIN = 0.5  # m that it leaves to who comes out
PERSON = 0.3  # m, radius of who comes out
ACCELERATION = 2.0  # m/s^2 behind: controllers do not follow a short dip of the desired speed
STEP = 0.2  # m across the path between places; CAR_RADIUS is nearly so much wider than a car


class Sight(NamedTuple):
    """How far ahead what stands on the road is seen, and how a driver accounts for it."""

    path: Line
    table: np.ndarray  # (k, 2) m, stations and ranges there, linear between them
    share: float  # of the range within which the car can stop
    reaction: float  # s
    deceleration: float  # m/s^2
    hides: bool = False  # whether obstacles hide what is behind them
    emerging: float = 0.0  # m/s, at most, of who comes out from there; 0: nobody does

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
    share = 0.5 if block.stop_within == 'half' else 1.0
    driver = block.reaction_s, block.deceleration_mps2
    return Sight(path, table, share, *driver, block.hidden_by_obstacles, block.emerging_mps)


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
    s, range_ = sight.path.s, np.interp(sight.path.s, *sight.table.T)
    safe = stopping_speed(sight.share * range_, sight.reaction, sight.deceleration)
    if sight.emerging:
        hiding = [disc.obstacle for a in crowd if actors.stays(a) for disc in a.discs]
        safe = np.minimum(safe, _emerging_bound(sight, float(np.max(speed[:, 1])), _rows(hiding)))
    # v^2 + 2 b s: that of a car that brakes stays the same
    energy = safe**2 + 2.0 * sight.deceleration * s
    least = np.minimum.accumulate(energy[::-1])[::-1] - 2.0 * sight.deceleration * s
    return np.column_stack([s, np.minimum(np.interp(s, *speed.T), np.sqrt(least))])


def _emerging_bound(sight, fastest, discs):
    """Return the speeds [m/s] (n,) from which the car stops for who comes out, or is there first.

    Who is hidden at an offset needs the time t until the way of the car. At a speed v with
    v reaction + v^2 / (2 b) <= v t the front of the car is there first wherever it cannot stop any
    more. Who walks on then, into its side, is not accounted for.
    """
    path, b = sight.path, sight.deceleration
    reach = FRONT + MARGIN + fastest * sight.reaction + fastest**2 / (2.0 * b)
    beside = CAR_RADIUS + PERSON
    # from farther aside nobody is in time
    aside = beside + sight.emerging * (sight.reaction + fastest / (2.0 * b))
    offset = np.arange(0.0, aside, STEP)
    t = np.maximum(offset - beside, 0.0) / sight.emerging
    past = 2.0 * b * np.maximum(t - sight.reaction, 0.0)
    frame = Frame(path.X[:, None], path.Y[:, None], path.psi[:, None])
    X, Y = lines.offset_point(frame, np.array([-1.0, 1.0])[:, None, None] * offset)
    taken = np.zeros(X.shape, dtype=bool)
    for cX, cY, radius in discs:
        taken |= np.hypot(X - cX, Y - cY) < radius + PERSON
    # who is behind an obstacle, seen from the path, has to come out in front of it
    can_come = ~np.logical_or.accumulate(taken, axis=-1)
    bound = np.full(len(path.s), np.inf)
    for i, here in enumerate(path.s):
        car = path.X[i], path.Y[i]
        near = discs[np.hypot(*(discs[:, :2] - car).T) < np.hypot(reach, aside) + discs[:, 2]]
        rows = slice(*np.searchsorted(path.s, [here + FRONT, here + reach]))
        if len(near) and rows.start < rows.stop:
            gap = np.maximum(path.s[rows] - here - FRONT - MARGIN, 0.0)
            allowed = np.maximum(stopping_speed(gap, sight.reaction, b)[:, None], past)
            hidden = can_come[:, rows] & hidden_places(car, X[:, rows], Y[:, rows], near)
            bound[i] = np.min(np.broadcast_to(allowed, hidden.shape), where=hidden, initial=np.inf)
    gain = 2.0 * ACCELERATION * path.s
    return np.sqrt(np.minimum.accumulate(np.maximum(bound, SPEED.low) ** 2 - gain) + gain)


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
    here = _station(sight, *car)
    end = here + float(np.interp(here, *sight.table.T))
    within = (
        o
        for o in present
        if min(_station(sight, o.X + x, o.Y + y) for x, y in ((0.0, 0.0), *o.others))
        <= end + o.r_obs
    )
    return tuple(o for o in within if not (sight.hides and is_hidden(car, o, present)))


def is_hidden(car: tuple[float, float], obstacle: Obstacle, present: Iterable[Obstacle]) -> bool:
    """Return whether others of `present` hide every disc of an obstacle from a car at (X, Y)."""
    discs = _rows([disc for o in present if o.id != obstacle.id for disc in o.discs()])
    return all(_is_disc_hidden(car, disc, discs) for disc in _rows(obstacle.discs()))


def _is_disc_hidden(car, disc, others):
    """Return whether the angle that a disc takes up is covered by those of nearer discs.

    Of two discs apart from each other the one with the shorter tangent is nearer: their radical
    axis is between them, and all rays from the car cross it in one direction.
    """
    (cX, cY), radius = disc[:2] - car, disc[2]
    oX, oY = (others[:, :2] - car).T
    own, theirs = cX**2 + cY**2 - radius**2, oX**2 + oY**2 - others[:, 2] ** 2
    nearer = (theirs > 0.0) & (theirs < own)
    turn = np.arctan2(cX * oY - cY * oX, cX * oX + cY * oY)[nearer]
    half = np.arcsin(others[nearer, 2] / np.hypot(oX, oY)[nearer])
    end = np.arctan2(radius, np.sqrt(max(own, 0.0)))
    covered = -end
    for low, high in sorted(zip(turn - half, turn + half)):
        if low > covered:
            break
        covered = max(covered, high)
    return bool(covered >= end)


def _rows(discs):
    return np.array([(disc.X, disc.Y, disc.r_obs) for disc in discs]).reshape(-1, 3)


def _station(sight, X, Y):
    return float(sight.path.s[lines.nearest_sample(sight.path, X, Y)])
