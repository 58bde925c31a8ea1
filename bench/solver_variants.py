"""The measured solvers, under their names in the tables."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from stage_solver.nlpsol_solver import NlpsolSolver

from mpcc_controller.driving import fallback, solver_selection
from mpcc_controller.parameters import ControllerParams
from stage_solver import compiled_functions, solver
from stage_solver.solution import Solution, SolverOptions, StageSolver
from stage_solver.stage_problem import Bounds, Plan, StageProblem

OWN = 'riccati'
OURS, ONE_STEP, BASELINE, NATIVE = 'ours', 'ours_one_step', 'fatrop_c', 'fatrop_c_native'
NATIVE_FLAGS = ('-O3', '-march=native')  # what our own solver may use, too
SECOND = 'second solver: '  # prefix of the message of an answer by the second solver
# the reference of every cost gap
REFERENCE = SolverOptions(
    name='ipopt', max_iterations=1000, tolerance=1e-8, time_limit_s=None, compiled=True
)


class Variant(NamedTuple):
    """A solver, or a way to use it."""

    label: str
    options: SolverOptions
    flags: tuple[str, ...] = compiled_functions.FLAGS  # of the compiler, for CasADi's functions


class WithSecondSolver:
    """A StageSolver that calls a second one when the fallback would reject the first plan.

    As in the controller: both share its time limit, and the plan of the second solver has no
    multipliers.
    """

    def __init__(self, first: StageSolver, second: StageSolver, params: ControllerParams):
        self._first, self._second = first, second
        self._rules, self._limit_s = params.fallback, params.solver.fallback_limit_s

    def solve(self, x0: np.ndarray, P: np.ndarray, bounds: Bounds, guess: Plan) -> Solution:
        """See `solution.StageSolver`."""
        found = self._first.solve(x0, P, bounds, guess)
        if not fallback.rejection_reason(found, self._rules):
            return found
        self._second.set_time_limit(max(self._limit_s - found.solve_s, 0.0))
        aid = self._second.solve(x0, P, bounds, guess._replace(multipliers=None))
        return aid._replace(
            plan=aid.plan._replace(multipliers=None),
            message=SECOND + aid.message,
            iterations=found.iterations + aid.iterations,
            solve_s=found.solve_s + aid.solve_s,
            cpu_s=found.cpu_s + aid.cpu_s,
        )


def with_mode(params: ControllerParams, mode: str, **others) -> ControllerParams:
    """Return the parameters with our solver in a mode, and its other settings where given."""
    return replace(params, solver=replace(params.solver, name=OWN, mode=mode, **others))


def available(params: ControllerParams, interpreted: bool) -> list[Variant]:
    """Return the available variants, ours first; `interpreted` adds CasADi's interpreter."""
    rules = params.solver

    def options(name, compiled=True):
        return SolverOptions(name, rules.max_iterations, rules.tolerance, None, compiled)

    one_step = solver_selection.first_solver_options(
        with_mode(params, 'one_step'), limit_time=False
    )
    variants = [Variant(OURS, options(OWN)), Variant(ONE_STEP, replace(one_step, compiled=True))]
    for name in sorted(solver.SOLVERS.keys() - {OWN}):
        variants.append(Variant(f'{name}_c', options(name)))
        if f'{name}_c' == BASELINE:
            variants.append(Variant(NATIVE, options(name), NATIVE_FLAGS))
        if interpreted:
            variants.append(Variant(f'{name}_vm', options(name, compiled=False)))
    return variants


def make_solvers(
    problem: StageProblem, variants: list[Variant], params: ControllerParams
) -> dict[str, StageSolver]:
    """Return a solver per label; compiles what is not in the cache."""
    return {variant.label: _make_solver(problem, variant, params) for variant in variants}


def _make_solver(problem, variant, params):
    if variant.flags != compiled_functions.FLAGS:
        return NlpsolSolver(problem, variant.options, variant.flags)
    made = solver.make_solver(problem, variant.options)
    if variant.label not in (OURS, ONE_STEP):
        return made
    second = solver_selection.make_second_solver(
        with_mode(params, 'converged'), problem, limit_time=True, first=made
    )
    return made if second is None else WithSecondSolver(made, second, params)
