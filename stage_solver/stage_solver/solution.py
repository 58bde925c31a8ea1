"""What goes into and comes out of a solver; a failed solve is a value, not an exception."""

import math
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np

from stage_solver.stage_problem import Bounds, Plan

SOLVED, STOPPED_EARLY, FAILED = 'solved', 'stopped_early', 'failed'
ONE_STEP = 'one_step'  # of a warm start: not converged, but near enough by `OneStep`


class OneStep(NamedTuple):
    """When a step of Newton's method from a warm start is enough: the real-time iteration."""

    residual: float  # largest violation of a constraint after the step, solver units
    decrease: float  # what the step promised to save, share of the cost


@dataclass(frozen=True)
class SolverOptions:
    """Which solver, and when it stops."""

    name: str = 'riccati'  # or 'fatrop', 'ipopt'
    max_iterations: int = 100
    tolerance: float = 1e-6  # of the optimality conditions, in solver units
    time_limit_s: float | None = None  # wall time of one solve; None: no limit
    compiled: bool = True  # the problem's functions as C; else CasADi's interpreter
    one_step: OneStep | None = None  # None: always converge, as all solvers but riccati do


class Solution(NamedTuple):
    """The outcome of one solve.

    A plan stopped early may be good enough: judge it by its residuals, the largest violation of a
    constraint and the largest slope of the Lagrangian, both in solver units. The plan of a failure
    is the last iterate, or the guess where there is none.
    """

    plan: Plan
    cost: float
    status: str  # SOLVED, ONE_STEP, STOPPED_EARLY or FAILED
    message: str  # why, for a person
    iterations: int
    primal_residual: float
    dual_residual: float
    solve_s: float  # wall time of the whole call
    cpu_s: float = math.nan  # processor time of its thread: other load leaves it nearly alone


class StageSolver(Protocol):
    """Solves one problem again and again with other numbers."""

    # as in the options that choose it; without a C compiler it is not that of the options
    name: str

    def solve(self, x0: np.ndarray, P: np.ndarray, bounds: Bounds, guess: Plan) -> Solution:
        """Return the solution from state x0 (nx,) with stage parameters P (N + 1, np), SI units.

        Raises ProblemError when an array has the wrong shape.
        """

    def set_time_limit(self, seconds: float) -> None:
        """Stop later solves after `seconds` of wall time, if there is a limit in the options.

        A solver that cannot change its limit keeps that of the options.
        """
