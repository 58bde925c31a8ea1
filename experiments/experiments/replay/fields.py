"""What of a tick is compared, and how closely; only times may differ as they like.

The numbers are in SI units. On one machine a replay gives the same bits; another instruction set
rounds differently, by less than 1e-10 of these tolerances' units (docs/replay.md).
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from msgs_yaml.types import Command, Prediction, Why

COMMAND_TOLERANCE = 1e-6  # rad, rad/s, N
VALUE_TOLERANCE = 1e-6  # of max(1, |recorded|), for all other numbers
EXEMPT = 'time.'  # wall time, which nobody can repeat
ABSENT = 'absent'
COMMAND_UNITS = {'delta': 'rad', 'd_delta': 'rad/s', 'Fxf': 'N', 'Fxr': 'N'}
POSES = ('X', 'Y', 'psi')


class Pair(NamedTuple):
    """One field of a tick, recorded and replayed."""

    field: str  # command.delta, cost.con, prediction.X
    recorded: float | int | str | bool
    replayed: float | int | str | bool
    allowed: float  # of their difference

    @property
    def difference(self) -> float:
        """How far apart they are; infinite for unlike words, 0 for the same."""
        if self.recorded == self.replayed:
            return 0.0
        if isinstance(self.recorded, str) or isinstance(self.replayed, str):
            return np.inf
        gap = abs(float(self.recorded) - float(self.replayed))
        return gap if gap == gap else np.inf

    @property
    def differs(self) -> bool:
        """Tell whether they are further apart than allowed."""
        return self.difference > self.allowed


def of_command(recorded: Command, replayed: Command) -> Iterator[Pair]:
    """Yield the numbers of two commands."""
    for name in COMMAND_UNITS:
        pair = getattr(recorded, name), getattr(replayed, name)
        yield Pair(f'command.{name}', *pair, COMMAND_TOLERANCE)


def of_why(recorded: Why, replayed: Why) -> Iterator[Pair]:
    """Yield every value of two reports but times; one that is missing in one of them is absent."""
    for name in recorded.values | replayed.values:
        if not name.startswith(EXEMPT):
            pair = recorded.values.get(name, ABSENT), replayed.values.get(name, ABSENT)
            yield Pair(name, *pair, _allowed(pair[0]))


def of_prediction(recorded: Prediction, replayed: Prediction) -> Iterator[Pair]:
    """Yield the poses of two plans, of each number that of the stage where they differ most."""
    if len(recorded.X) != len(replayed.X):
        yield Pair('prediction.stages', len(recorded.X), len(replayed.X), 0.0)
        return
    for name in POSES:
        one, other = getattr(recorded, name), getattr(replayed, name)
        if len(one):
            stage = int(np.argmax(np.abs(one - other)))
            pair = float(one[stage]), float(other[stage])
            yield Pair(f'prediction.{name}', *pair, _allowed(pair[0]))


def _allowed(value):
    return 0.0 if isinstance(value, str) else VALUE_TOLERANCE * max(1.0, abs(value))
