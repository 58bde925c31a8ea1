"""The solvers that are measured: every one that the project has, under the names of the tables."""

from typing import NamedTuple

import numpy as np

from mpcc_controller.solvers import solver
from mpcc_controller.solvers.shooting import Bounds, Plan, StageProblem
from mpcc_controller.solvers.solver import Solution, SolverOptions, StageSolver

OWN = 'riccati'
OURS, ONE_STEP, BASELINE = 'ours', 'ours_one_step', 'fatrop_c'
# the reference of every cost gap
REFERENCE = SolverOptions(
    name='ipopt', max_iterations=1000, tolerance=1e-8, time_limit_s=None, compiled=True
)


class Variant(NamedTuple):
    """A solver, or a way to use it."""

    label: str
    options: SolverOptions


class RealTimeIteration:
    """A StageSolver that takes one iteration from a plan with multipliers, and converges from none.

    Without the latter it would drive on a plan that never was one (Diehl et al. 2005).
    """

    def __init__(self, problem: StageProblem, options: SolverOptions):
        self._converging = solver.make(problem, options)
        self._single = solver.make(problem, SolverOptions(**vars(options) | {'max_iterations': 1}))

    def solve(self, x0: np.ndarray, P: np.ndarray, bounds: Bounds, guess: Plan) -> Solution:
        """See `solution.StageSolver`."""
        chosen = self._converging if guess.multipliers is None else self._single
        return chosen.solve(x0, P, bounds, guess)


def available(rules, interpreted: bool) -> list[Variant]:
    """Return the variants that this version of the project has, ours first.

    `rules` are the solver parameters of a controller; with `interpreted`, CasADi's interpreter
    instead of compiled functions is measured, too.
    """
    made = []
    for name in sorted(solver.SOLVERS, key=lambda name: (name != OWN, name)):
        options = SolverOptions(name, rules.max_iterations, rules.tolerance, None, compiled=True)
        if name == OWN:
            made += [Variant(OURS, options), Variant(ONE_STEP, options)]
            continue
        made.append(Variant(f'{name}_c', options))
        if interpreted:
            made.append(Variant(f'{name}_vm', SolverOptions(**vars(options) | {'compiled': False})))
    return made


def make(problem: StageProblem, variants: list[Variant]) -> dict[str, StageSolver]:
    """Return a solver per label; compiles what is not in the cache."""
    return {
        variant.label: RealTimeIteration(problem, variant.options)
        if variant.label == ONE_STEP
        else solver.make(problem, variant.options)
        for variant in variants
    }
