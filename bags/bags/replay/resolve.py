"""One recorded tick, solved again: is it the same command, and what if something were different?"""

from collections.abc import Sequence
from typing import NamedTuple

from bags.closed_loop import again, posed
from bags.closed_loop.posed import Solved
from bags.errors import BagError
from bags.replay import check, feed, fields, sensitivity
from bags.replay.feed import Tick
from bags.replay.fields import Pair
from bags.replay.sensitivity import Sensitivity
from bags.replay.settings import Changes
from bags.storage import read


class Question(NamedTuple):
    """What is asked about a tick."""

    tick: int
    changes: Changes
    sensitivities: bool


class Answer(NamedTuple):
    """What there is to say about it."""

    name: str  # of the controller
    tick: Tick
    command: tuple[Pair, ...]  # recorded, and solved again; empty where it was lost
    chain: int  # ticks before it that were not answered as recorded: its warm start is another one
    solved: Solved
    changed: Solved | None
    sensitivities: tuple[Sensitivity, ...]

    @property
    def is_same(self) -> bool:
        """Tell whether solving again gives the recorded command."""
        return not any(pair.differs for pair in self.command)


def ask(bag: read.Bag, question: Question) -> Answer:
    """Replay the ticks before, pose the problem of one, and solve it again.

    The plan of the tick before, which is the first guess and the warm start, is not recorded; it
    comes from answering all ticks before. Raises BagError for a tick that the bag does not have or
    for which no problem was solved, and for changes that cannot be made.
    """
    name = str(bag.path)
    ticks = feed.ticks(bag)
    tick = _chosen(ticks, question.tick, name)
    repeated = again.of_notes(bag.run_info, {}, name)
    before = check.of(ticks[: tick.number], repeated)
    problem = posed.of_tick(repeated, tick)
    solved, changed = problem.solve(), None
    parameters, factors = question.changes
    if parameters or factors:
        other = problem
        if parameters:
            other = problem.changed(*again.params(bag.run_info, parameters, name))
        changed = other.weighted(factors).solve()
    return Answer(
        bag.run_info.get('controller', 'controller'),
        tick,
        tuple(fields.of_command(tick.command, solved.command)) if tick.command else (),
        sum(bool(one.differing) for one in before),
        solved,
        changed,
        sensitivity.of(problem) if question.sensitivities else (),
    )


def _chosen(ticks: Sequence[Tick], number: int, name: str) -> Tick:
    if not 0 <= number < len(ticks):
        raise BagError(f'{name}: there is no tick {number}; it has 0 to {len(ticks) - 1}')
    return ticks[number]
