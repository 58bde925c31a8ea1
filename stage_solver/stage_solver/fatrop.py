"""fatrop (Vanroye et al. 2023): IPOPT's method with a Riccati recursion for the linear systems.

Four properties of it need care:

- It has no time limit. Past the deadline the gradient of the cost, which it evaluates once per
  accepted iterate, becomes NaN: it finds no search direction and returns its last iterate. (The
  Hessian must stay finite: fatrop raises its inertia correction until the factorisation succeeds,
  and would not return. Nor does a NaN stop its restoration phase; there the iteration limit holds.)
- In its restoration phase the same may happen with a finite Hessian; it gets a zero Hessian there
  (`nlp_functions`). Outside of it the same may happen with a large Jacobian; such a Jacobian is
  replaced (`fatrop_guard`).
- It never forgets a NaN in its work arrays, where 0 NaN remains NaN.
- When the pattern of the limits changes (which are infinite, which are equal), CasADi creates a new
  fatrop and does not pass the options to it.

After the last two a new memory of the same nlpsol starts with a new fatrop that has its options.
"""

import math
import time
from collections.abc import Sequence
from typing import Any

import casadi as ca
import numpy as np

from stage_solver import nlpsol_backend
from stage_solver.compiled_functions import BufferedFunction
from stage_solver.nlpsol_backend import NlpsolCall, Termination
from stage_solver.solution import SolverOptions
from stage_solver.stage_problem import StageProblem

# fatrop's IpSolverReturnFlag, in its order
REASONS = (
    'solved',
    nlpsol_backend.ITERATION_LIMIT,
    nlpsol_backend.ACCEPTABLE,
    nlpsol_backend.INFEASIBLE,
    'line search failed',
    'no search direction',
    'unknown',
)
# A memory is freed only together with its nlpsol. So many are kept unused (5 MB each for the MPCC)
# before a new nlpsol, which takes ten times as long to create as a memory, replaces them all.
MAX_UNUSED_MEMORIES = 8


class Deadline(ca.Callback):
    """A CasADi function of anything: 0 before an instant, NaN after it."""

    def __init__(self):
        ca.Callback.__init__(self)
        self.reset(math.inf)
        self.construct('deadline', {})

    def reset(self, at_s: float) -> None:
        """Set the instant, in seconds on the clock of time.perf_counter."""
        self._at_s = at_s
        self.passed = False  # it has returned NaN since then

    def eval(self, arg: Sequence[Any]) -> list[float]:
        """Return [0] or [NaN]; called by CasADi."""
        self.passed = self.passed or time.perf_counter() > self._at_s
        return [math.nan if self.passed else 0.0]

    def apply_to(self, function: ca.Function) -> ca.Function:
        """Return `function` with all its results NaN after the deadline."""
        arguments = [function.mx_in(i) for i in range(function.n_in())]
        zero_or_nan = self(ca.MX(0))
        results = [r + zero_or_nan for r in function.call(arguments)]
        names = function.name_in(), function.name_out()
        return ca.Function(function.name(), arguments, results, *names)


class Fatrop:
    """fatrop on the functions of one problem.

    With a time limit it is ready at once, else CasADi builds it at the first run: as the second
    solver of a simulation it is hardly ever needed.
    """

    def __init__(
        self, problem: StageProblem, options: SolverOptions, functions: dict[str, ca.Function]
    ):
        self._problem, self._options = problem, options
        self._limit_s = math.inf if options.time_limit_s is None else options.time_limit_s
        self._deadline = Deadline()
        self._functions = functions
        if options.time_limit_s is not None:
            gradient = self._deadline.apply_to(functions['nlp_grad_f'])
            self._functions = functions | {'nlp_grad_f': gradient}
        self._function: ca.Function | None = None
        self._nlpsol: BufferedFunction | None = None
        self._unused: list[BufferedFunction] = []
        self._reusable = True
        self._pattern = None
        if options.time_limit_s is not None:
            self._renew_memory()

    def run(self, call: NlpsolCall, start_s: float) -> tuple[dict[str, np.ndarray], Termination]:
        """Return nlpsol's results and termination; start_s is on time.perf_counter's clock."""
        pattern = _limit_pattern(call)
        changed = self._pattern is not None and not np.array_equal(pattern, self._pattern)
        if changed or not self._reusable or self._nlpsol is None:
            self._renew_memory()
        self._pattern = pattern
        self._deadline.reset(start_s + self._limit_s)
        results = self._nlpsol(**call._asdict())
        stats = self._nlpsol.stats()
        reason = REASONS[stats['fatrop']['return_flag']]
        solved = stats['success'] and not self._deadline.passed
        if self._deadline.passed:
            reason = nlpsol_backend.TIME_LIMIT
        self._reusable = solved or reason == nlpsol_backend.ITERATION_LIMIT
        return results, Termination(solved, reason, stats['iter_count'])

    def set_time_limit(self, seconds: float) -> None:
        """Limit the wall time of later runs, if the options have a limit."""
        self._limit_s = seconds

    def _make_function(self):
        problem, options = self._problem, self._options
        N = problem.horizon
        settings = {
            'structure_detection': 'manual',
            'N': N,
            'nx': [problem.nx] * (N + 1),
            'nu': [problem.nu] * N + [0],
            'ng': [problem.ng] * N + [problem.nh],
            # The barrier starts at fatrop's own 0.1: 1e-3 saves a third of the steps from a shifted
            # plan, but some solves from a disturbed or cold one then do not converge.
            'fatrop': {
                'print_level': 0,
                # fatrop tests the limit before it counts the step
                'max_iter': options.max_iterations - 1,
                'tolerance': options.tolerance,
            },
        }
        return nlpsol_backend.make_nlpsol(problem, 'fatrop', self._functions, settings)

    def _renew_memory(self):
        if self._nlpsol is not None:
            self._unused.append(self._nlpsol)
        if self._function is None or len(self._unused) > MAX_UNUSED_MEMORIES:
            self._function = self._make_function()
            self._unused.clear()
        self._nlpsol = BufferedFunction(self._function)


def _limit_pattern(call):
    """Return which limits are equal (1) or absent (2): fatrop's structure depends on it."""
    low, high = np.concatenate([call.lbx, call.lbg]), np.concatenate([call.ubx, call.ubg])
    return np.where(low == high, 1, np.where((low == -np.inf) & (high == np.inf), 2, 0))
