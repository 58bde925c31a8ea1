"""Options, status and result of a solve; a failed solve is a value, not an exception."""

import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

from stage_solver.stage_problem import Plan

SOLVED, STOPPED_EARLY, FAILED = 'solved', 'stopped_early', 'failed'
ONE_STEP = 'one_step'  # not converged, but the first step satisfies `OneStep`


class OneStep(NamedTuple):
    """When one Newton step from a warm start is accepted: the real-time iteration."""

    residual: float  # largest constraint violation after the step, solver units
    decrease: float  # predicted decrease of the cost, as a share of the cost


@dataclass(frozen=True)
class SolverOptions:
    """When a solve stops."""

    max_iterations: int = 100
    tolerance: float = 1e-6  # of the optimality conditions, in solver units
    time_limit_s: float | None = None  # wall time of one solve; None: no limit
    one_step: OneStep | None = None  # None: always converge


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


def stopwatch() -> Callable[[], dict[str, float]]:
    """Return what returns the wall and the processor time since now as fields of a Solution."""
    wall_s, cpu_s = time.perf_counter(), time.thread_time()
    return lambda: {'solve_s': time.perf_counter() - wall_s, 'cpu_s': time.thread_time() - cpu_s}
