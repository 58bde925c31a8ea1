"""How cost and least distance of one plan answer to the weights, at its own solution."""

from typing import NamedTuple

import numpy as np

from bags.errors import BagError
from experiments.replay.tick_problem import Problem, Solved

STEP = 1e-3  # relative, of a weight: a difference of 1e-6 is then known to about 1e-4
TOLERANCE = 1e-10  # of the solver


class Sensitivity(NamedTuple):
    """Of one weight, both per relative change of it: 0.01 times these for one percent."""

    weight: str
    value: float
    cost: float  # d J / d ln w: the term itself (envelope theorem)
    cost_difference: float  # the same by central differences, as a check
    v2o: float  # m, d min D_V2O / d ln w, by central differences; NaN without obstacles


def of(problem: Problem) -> tuple[Sensitivity, ...]:
    """Return the sensitivities to every weight that is not zero.

    Differences are taken between solves to 1e-10 of the cost that start from the solution. Raises
    BagError when one of them fails.
    """
    precise = problem.precise(TOLERANCE)
    solution = _solved(precise)
    begun = precise.begun_at(solution)
    found = []
    for name, weight in begun.weights.items():
        if weight:
            less, more = (_solved(begun.weighted({name: 1 + s * STEP})) for s in (-1, 1))
            step = np.log1p(STEP) - np.log1p(-STEP)
            found.append(
                Sensitivity(
                    name,
                    weight,
                    solution.terms[name],
                    (more.cost - less.cost) / step,
                    (more.least_v2o - less.least_v2o) / step,
                )
            )
    return tuple(found)


def _solved(problem: Problem) -> Solved:
    solved = problem.solve()
    if not solved.good:
        raise BagError(f'sensitivities: a neighbouring problem was not solved: {solved.told}')
    return solved
