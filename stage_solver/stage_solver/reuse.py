"""What is made of a problem is made once in a process, for every problem that is equal to it."""

import dataclasses
import functools
import hashlib
from collections import OrderedDict
from collections.abc import Callable
from typing import Any

import casadi as ca

from stage_solver.stage_problem import StageProblem

MOST = 8  # a process that drives many cars one after the other has a few problems in turn


def once(make: Callable[..., Any]) -> Callable[..., Any]:
    """Decorate make(problem, *others): equal arguments get what was made the first time.

    What is made must never be changed; the last few are kept.
    """
    made: OrderedDict[tuple, Any] = OrderedDict()

    @functools.wraps(make)
    def made_once(problem: StageProblem, *others):
        key = (content(problem), *others)
        if key not in made:
            made[key] = make(problem, *others)
        made.move_to_end(key)
        while len(made) > MOST:
            made.popitem(last=False)
        return made[key]

    return made_once


def content(problem: StageProblem) -> str:
    """Return a digest of all that a problem consists of."""
    facts = [getattr(problem, field.name) for field in dataclasses.fields(problem)]
    plain = [fact.serialize() if isinstance(fact, ca.Function) else fact for fact in facts]
    return hashlib.sha256(repr(plain).encode()).hexdigest()
