"""Options, status and result of a solve; a failed solve is a value, not an exception."""

import math
import time
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np

from stage_solver.stage_problem import Bounds, Plan

SOLVED, STOPPED_EARLY, FAILED = 'solved', 'stopped_early', 'failed'
ONE_STEP = 'one_step'  # not converged, but the first step satisfies `OneStep`


class OneStep(NamedTuple):
    """When one Newton step from a warm start is accepted: the real-time iteration."""

    residual: float  # largest constraint violation after the step, solver units
    decrease: float  # predicted decrease of the cost, as a share of the cost


@dataclass(frozen=True)
class SolverOptions:
    """Which solver, and when it stops."""

    name: str = 'riccati'  # or 'fatrop', 'ipopt'
    max_iterations: int = 100
    tolerance: float = 1e-6  # of the optimality conditions, in solver units
    time_limit_s: float | None = None  # wall time of one solve; None: no limit
    compiled: bool = True  # the problem's functions as C; else CasADi's interpreter
    one_step: OneStep | None = None  # None: always converge, as fatrop and IPOPT do


class Solution(NamedTuple):
    """The result of one solve.

    A plan stopped early may be good enough; the residuals tell: the largest constraint violation
    and the largest component of the Lagrangian's gradient, both in solver units. The plan of a
    failure is the last iterate, or the guess where there is none.
    """

    plan: Plan
    cost: float
    status: str  # SOLVED, ONE_STEP, STOPPED_EARLY or FAILED
    message: str  # why, as text
    iterations: int
    primal_residual: float
    dual_residual: float
    solve_s: float  # wall time of the whole call
    cpu_s: float = math.nan  # processor time of the calling thread


class StageSolver(Protocol):
    """Solves one problem repeatedly with other initial states, parameters, bounds and guesses."""

    name: str  # of the solver

    def solve(self, x0: np.ndarray, P: np.ndarray, bounds: Bounds, guess: Plan) -> Solution:
        """Return the solution from state x0 (nx,) with stage parameters P (N + 1, np), SI units.

        A guess with multipliers is a warm start of 'riccati'. Raises ProblemError when an array
        has the wrong shape.
        """

    def set_time_limit(self, seconds: float) -> None:
        """Limit the wall time of later solves, if the options have a limit; IPOPT keeps theirs."""


class Stopwatch:
    """Wall and processor time since its creation."""

    def __init__(self):
        self.start_s = time.perf_counter()
        self._cpu_start_s = time.thread_time()

    def times(self) -> dict[str, float]:
        """Return the elapsed times as fields of a Solution."""
        return {
            'solve_s': time.perf_counter() - self.start_s,
            'cpu_s': time.thread_time() - self._cpu_start_s,
        }
