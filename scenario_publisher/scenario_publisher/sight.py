"""Sight: how far a car sees along its path, and the speed from which it can stop within that.

A crest or a truck hides what stands behind it. Stations are those of the coarse path.
"""

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from msgs_yaml.types import Obstacle
from scenario_publisher import lines, road_geometry, schema
from scenario_publisher.lines import Line


class Sight(NamedTuple):
    """How far ahead what stands on the road is seen, and how a driver accounts for it."""

    path: Line
    table: np.ndarray  # (k, 2) m, stations and ranges there, linear between them
    share: float  # of the range within which the car can stop
    reaction: float  # s
    deceleration: float  # m/s^2

    def __repr__(self) -> str:
        return f'Sight({np.min(self.table[:, 1]):g} m at least)'


def build(block: schema.Sight | None, path: Line) -> Sight | None:
    """Return the sight of the block `sight` along a path; None without one.

    Raises KeyedError for a table that is none.
    """
    if block is None:
        return None
    table = road_geometry.build_table(block.stations_m, block.ranges_m, 'sight', 'ranges_m')
    share = 0.5 if block.stop_within == 'half' else 1.0
    return Sight(path, table, share, block.reaction_s, block.deceleration_mps2)


def stopping_speed(distance: np.ndarray, reaction: float, deceleration: float) -> np.ndarray:
    """Return the speeds [m/s] from which a car stops within distances d [m].

    The positive root of v t + v^2 / (2 b) = d, with the reaction time t [s] and the deceleration
    b [m/s^2].
    """
    lost = deceleration * reaction
    return np.sqrt(lost**2 + 2.0 * deceleration * distance) - lost


def bound_speed(sight: Sight, speed: np.ndarray) -> np.ndarray:
    """Return a table (n, 2) of stations and desired speeds, from one (k, 2) that ignores sight.

    Where the range ends faster than the car comes nearer, it brakes before.
    """
    s, range_ = sight.path.s, np.interp(sight.path.s, *sight.table.T)
    safe = stopping_speed(sight.share * range_, sight.reaction, sight.deceleration)
    # v^2 + 2 b s: that of a car that brakes stays the same
    energy = safe**2 + 2.0 * sight.deceleration * s
    least = np.minimum.accumulate(energy[::-1])[::-1] - 2.0 * sight.deceleration * s
    return np.column_stack([s, np.minimum(np.interp(s, *speed.T), np.sqrt(least))])


def seen(
    sight: Sight, car: tuple[float, float], obstacles: Iterable[Obstacle]
) -> tuple[Obstacle, ...]:
    """Return the obstacles of which something is within the range of a car at (X, Y), or behind."""
    here = _station(sight, *car)
    end = here + float(np.interp(here, *sight.table.T))
    return tuple(
        o
        for o in obstacles
        if min(_station(sight, o.X + x, o.Y + y) for x, y in ((0.0, 0.0), *o.others))
        <= end + o.r_obs
    )


def _station(sight, X, Y):
    return float(sight.path.s[lines.nearest_sample(sight.path, X, Y)])
