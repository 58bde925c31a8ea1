"""Which limits a plan leans against, at which stages, from values, limits and multipliers."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np


class Group(NamedTuple):
    """Quantities with limits at some stages; arrays (stages, quantities) in SI units."""

    names: tuple[str, ...]
    values: np.ndarray
    low: np.ndarray
    high: np.ndarray
    multipliers: np.ndarray  # cost per SI unit, positive where the upper limit pushes
    scale: np.ndarray  # (quantities,) SI units per unit of the solver
    first: int = 0  # the stage of row 0


class Active(NamedTuple):
    """One limit that holds a plan back over neighbouring stages."""

    quantity: str
    side: str  # lower or upper
    first: int  # stage
    last: int
    limit: float  # SI units, at the stage of the largest multiplier
    multiplier: float  # cost per SI unit, the largest
    at: int  # stage of it


def of(group: Group) -> Iterator[Active]:
    """Yield what is active: its multiplier is larger than the room left, in the solver's units.

    At the end of an interior-point method the product of both is the barrier parameter: one of
    them is large and the other one small.
    """
    force = np.abs(group.multipliers) * group.scale
    upper = group.multipliers > 0
    limit = np.where(upper, group.high, group.low)
    room = np.abs(limit - group.values) / group.scale
    holds = np.isfinite(limit) & (force > room)
    for i, name in enumerate(group.names):
        for side, pushes in (('lower', ~upper[:, i]), ('upper', upper[:, i])):
            for rows in _runs(holds[:, i] & pushes):
                at = rows[np.argmax(force[rows, i])]
                yield Active(
                    name,
                    side,
                    first=group.first + int(rows[0]),
                    last=group.first + int(rows[-1]),
                    limit=float(limit[at, i]),
                    multiplier=float(abs(group.multipliers[at, i])),
                    at=group.first + int(at),
                )


def _runs(holds):
    """Return the rows of every unbroken run of True."""
    rows = np.flatnonzero(holds)
    breaks = np.flatnonzero(np.diff(rows) > 1) + 1
    return [run for run in np.split(rows, breaks) if len(run)]
