"""One recorded tick, solved again: is it the same command, and what if something were different?"""

from typing import NamedTuple

from bags.errors import BagError
from bags.storage import read
from experiments.configuration.set_option import Changes
from experiments.replay import check, feed, fields, replayed_controller, sensitivity, tick_problem
from experiments.replay.feed import Tick
from experiments.replay.fields import Pair
from experiments.replay.sensitivity import Sensitivity
from experiments.replay.tick_problem import Problem, Solved


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


class Posed(NamedTuple):
    """A tick with its problem."""

    tick: Tick
    problem: Problem
    chain: int  # see `Answer`


def ask(bag: read.Bag, question: Question) -> Answer:
    """Pose the problem of a tick and solve it again, as it was and changed. Raises BagError."""
    return answer(bag, pose(bag, question.tick), question)


def pose(bag: read.Bag, number: int) -> Posed:
    """Return a tick and the problem that was solved for it.

    The plan of the tick before, which is the first guess and the warm start, is not recorded; it
    comes from answering all ticks before. Raises BagError for a tick that the bag does not have
    and for one without a problem.
    """
    ticks = feed.ticks(bag, number + 1)
    if not 0 <= number < len(ticks):
        count = len(feed.ticks(bag))
        raise BagError(f'{bag.path}: there is no tick {number}; it has 0 to {count - 1}')
    repeated = replayed_controller.of_notes(bag.run_info, {}, str(bag.path))
    before = check.of(ticks[:number], repeated)
    tick = ticks[number]
    chain = sum(bool(one.differing) for one in before)
    return Posed(tick, tick_problem.of_tick(repeated, tick), chain)


def answer(bag: read.Bag, found: Posed, question: Question) -> Answer:
    """Return what is asked about a tick; BagError for changes that cannot be made."""
    tick, problem, chain = found
    solved, changed = problem.solve(), None
    parameters, factors = question.changes
    if parameters or factors:
        other = problem
        if parameters:
            other = problem.changed(
                *replayed_controller.params(bag.run_info, parameters, str(bag.path))
            )
        changed = other.weighted(factors).solve()
    return Answer(
        bag.run_info.get('controller', 'controller'),
        tick,
        tuple(fields.of_command(tick.command, solved.command)) if tick.command else (),
        chain,
        solved,
        changed,
        sensitivity.of(problem) if question.sensitivities else (),
    )
