"""What the two nlpsol solvers have in common: how one is called and how it says how it ended."""

from typing import NamedTuple

import casadi as ca
import numpy as np

from stage_solver.stage_problem import StageProblem

COMMON = {
    'print_time': False,
    'show_eval_warnings': False,
    'calc_lam_p': False,
    'inputs_check': False,  # `sound` has looked at them, and says more
}
ITERATION_LIMIT, TIME_LIMIT = 'iteration limit', 'time limit'
ACCEPTABLE, INFEASIBLE = 'acceptable point', 'locally infeasible'
LIMITS = (ITERATION_LIMIT, TIME_LIMIT, ACCEPTABLE)


class Call(NamedTuple):
    """The arguments of nlpsol, under its names."""

    x0: np.ndarray
    p: np.ndarray
    lbx: np.ndarray
    ubx: np.ndarray
    lbg: np.ndarray
    ubg: np.ndarray


class Ending(NamedTuple):
    """How a call ended."""

    solved: bool
    reason: str  # one of the words above, or the solver's own
    iterations: int


def nlpsol(problem: StageProblem, solver: str, functions: dict, settings: dict) -> ca.Function:
    """Return CasADi's nlpsol made of `functions` (see `nlp_functions`)."""
    # what stands in the cache under its name is not derived again
    settings = COMMON | settings | {'cache': functions}
    return ca.nlpsol(problem.name, solver, functions['nlp'], settings)
