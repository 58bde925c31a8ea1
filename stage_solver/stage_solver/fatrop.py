"""fatrop (Vanroye et al. 2023): IPOPT's method with a Riccati recursion for the linear systems.

Four of its habits need care:

- It has no time limit. Past the deadline the gradient of the cost, which it asks for once per
  accepted iterate, becomes NaN: it finds no search direction and hands back its last iterate. (The
  Hessian must stay finite: fatrop raises its inertia correction until the factorisation succeeds,
  and would not return. It is not stopped inside its restoration phase either; there the limit of
  iterations holds.)
- In its restoration phase the same may happen with a finite Hessian; it gets none there
  (`nlp_functions`). Outside it the same may happen with a large Jacobian; such a one is withheld
  (`riccati_growth`).
- It never forgets a NaN in its work arrays, where 0 NaN remains NaN.
- When the pattern of the limits changes (which are infinite, which are equal), CasADi makes a new
  fatrop and forgets to give it the options.

After the last two a fresh memory of the same nlpsol starts with a new fatrop that has its options.
"""

import math

import casadi as ca
import numpy as np

from stage_solver import backend
from stage_solver.backend import Call, Ending
from stage_solver.buffered import Buffered
from stage_solver.deadline import Deadline
from stage_solver.solution import SolverOptions
from stage_solver.stage_problem import StageProblem

# fatrop's IpSolverReturnFlag, in its order
REASONS = (
    'solved',
    backend.ITERATION_LIMIT,
    backend.ACCEPTABLE,
    backend.INFEASIBLE,
    'line search failed',
    'no search direction',
    'unknown',
)
# A memory cannot be given back without being used again. So many are kept aside (5 MB each for the
# MPCC) before a new nlpsol, which takes ten times as long to make as a memory, replaces them all.
MOST_SPOILT = 8


class Fatrop:
    """fatrop on the functions of one problem."""

    def __init__(
        self, problem: StageProblem, options: SolverOptions, functions: dict[str, ca.Function]
    ):
        self._problem, self._options = problem, options
        self._limit_s = math.inf if options.time_limit_s is None else options.time_limit_s
        self._deadline = Deadline()
        self._functions = functions
        if options.time_limit_s is not None:
            gradient = self._deadline.limit(functions['nlp_grad_f'])
            self._functions = functions | {'nlp_grad_f': gradient}
        self._function = self._make()
        self._nlpsol = Buffered(self._function)
        self._spoilt: list[Buffered] = []
        self._fresh = True
        self._pattern = None

    def run(self, call: Call, start_s: float) -> tuple[dict[str, np.ndarray], Ending]:
        """Return nlpsol's results and how it ended; start_s is on time.perf_counter's clock."""
        pattern = _pattern(call)
        changed = self._pattern is not None and not np.array_equal(pattern, self._pattern)
        if changed or not self._fresh:
            self._renew()
        self._pattern = pattern
        self._deadline.at_s = start_s + self._limit_s
        results = self._nlpsol(**call._asdict())
        stats = self._nlpsol.stats()
        reason = REASONS[stats['fatrop']['return_flag']]
        solved = stats['success'] and not self._deadline.passed
        if self._deadline.passed:
            reason = backend.TIME_LIMIT
        self._fresh = solved or reason == backend.ITERATION_LIMIT
        return results, Ending(solved, reason, stats['iter_count'])

    def set_time_limit(self, seconds: float) -> None:
        """Stop the runs from now on after so many seconds, where there was a limit before."""
        self._limit_s = seconds

    def _make(self):
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
                # it looks at the limit before it counts the step
                'max_iter': options.max_iterations - 1,
                'tolerance': options.tolerance,
            },
        }
        return backend.nlpsol(problem, 'fatrop', self._functions, settings)

    def _renew(self):
        self._spoilt.append(self._nlpsol)
        if len(self._spoilt) > MOST_SPOILT:
            self._function = self._make()
            self._spoilt.clear()
        self._nlpsol = Buffered(self._function)


def _pattern(call):
    """Return which limits are equal or absent: what fatrop's structure depends on."""
    low, high = np.concatenate([call.lbx, call.lbg]), np.concatenate([call.ubx, call.ubg])
    return np.where(low == high, 1, np.where((low == -np.inf) & (high == np.inf), 2, 0))
