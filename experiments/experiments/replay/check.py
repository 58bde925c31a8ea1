"""Does today's controller answer a recording as the recorded one did?"""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from bags.errors import BagError
from bags.storage import read
from experiments.replay import feed, fields, replayed_controller
from experiments.replay.feed import Tick
from experiments.replay.fields import Pair

# after a tick that cannot be repeated the warm start is another one; so many later its trace is
# gone, and a difference counts again
SHADOW = 20


class Compared(NamedTuple):
    """One tick, recorded and replayed."""

    tick: Tick
    pairs: tuple[Pair, ...]
    gap: str  # why a difference here proves nothing, '' where it does

    @property
    def differing(self) -> tuple[Pair, ...]:
        """The fields that are further apart than allowed."""
        return tuple(pair for pair in self.pairs if pair.differs)


class Report(NamedTuple):
    """What came of a check."""

    name: str  # of the bag
    run_info: Mapping[str, str]
    ticks: tuple[Compared, ...]

    @property
    def failures(self) -> tuple[Compared, ...]:
        """The ticks that differ though nothing kept them from being repeated."""
        return tuple(one for one in self.ticks if one.differing and not one.gap)

    @property
    def repeatable(self) -> int:
        """How many ticks can be repeated."""
        return sum(not one.gap for one in self.ticks)

    @property
    def unproven(self) -> tuple[Compared, ...]:
        """The ticks that differ, but could not be repeated exactly."""
        return tuple(one for one in self.ticks if one.differing and one.gap)


def check(bag: read.Bag, settings: Mapping[str, Any]) -> Report:
    """Give a recording to today's controller, with the parameters of the run, and compare.

    `settings` change parameters by dotted name. Every tick begins where the recording says that
    the car and its set-points were; the plan it is warm-started from is that of the tick before in
    this replay. Raises BagError for a bag that cannot be replayed.
    """
    name = str(bag.path)
    compared = of(feed.ticks(bag), replayed_controller.of_notes(bag.run_info, settings, name))
    if all(one.gap for one in compared):
        raise BagError(f'{name}: no tick can be repeated: {compared[0].gap}')
    return Report(name, bag.run_info, compared)


def of(ticks: Sequence[Tick], repeated: replayed_controller.Again) -> tuple[Compared, ...]:
    """Answer ticks one after the other and compare each."""
    compared, shadow, cause = [], 0, ''
    for tick in ticks:
        if tick.told.actuators is not None:
            shadow = 0  # it started anew
        if tick.gaps:
            shadow, cause = SHADOW, tick.gaps[0]
        compared.append(Compared(tick, answered(repeated, tick), cause if shadow else ''))
        shadow = max(shadow - 1, 0)
    return tuple(compared)


def answered(repeated: replayed_controller.Again, tick: Tick) -> tuple[Pair, ...]:
    """Answer a tick, go on from the recorded command, and return both answers field by field."""
    command, prediction, why = repeated.answer(tick.told, tick.stamp_ns)
    pairs = list(fields.of_why(tick.why, why))
    if tick.command is not None:
        pairs[:0] = fields.of_command(tick.command, command)
        repeated.follow(tick.command)
    if tick.prediction is not None:
        pairs += fields.of_prediction(tick.prediction, prediction)
    return tuple(pairs)


def largest(report: Report) -> dict[str, tuple[float, int]]:
    """Return per group of fields the largest difference that counts, and the tick it is at.

    The groups: command, cost, prediction, and the rest of the reasons. Of the last three the
    difference is relative to max(1, |recorded|); words count when they differ.
    """
    found = {'command': (0.0, 0), 'cost': (0.0, 0), 'prediction': (0.0, 0), 'other': (0.0, 0)}
    for one in report.ticks:
        for pair in one.pairs if not one.gap else ():
            group = pair.field.partition('.')[0]
            group = group if group in found else 'other'
            scale = 1.0 if isinstance(pair.recorded, str) else max(1.0, abs(pair.recorded))
            size = pair.difference if group == 'command' else pair.difference / scale
            found[group] = max(found[group], (size, one.tick.number), key=lambda known: known[0])
    return found
