"""CasADi's nlpsol on preallocated arrays, and IPOPT through it; `fatrop` is the other backend."""

from typing import NamedTuple

import casadi as ca
import numpy as np

from stage_solver.compiled_functions import BufferedFunction
from stage_solver.solution import SolverOptions
from stage_solver.stage_problem import StageProblem

COMMON_SETTINGS = {
    'print_time': False,
    'show_eval_warnings': False,
    'calc_lam_p': False,
    'inputs_check': False,  # `validation` checks them and names what is wrong
}
ITERATION_LIMIT, TIME_LIMIT = 'iteration limit', 'time limit'
ACCEPTABLE, INFEASIBLE = 'acceptable point', 'locally infeasible'
EARLY_STOPS = (ITERATION_LIMIT, TIME_LIMIT, ACCEPTABLE)
IPOPT_REASONS = {
    'Solved_To_Acceptable_Level': ACCEPTABLE,
    'Search_Direction_Becomes_Too_Small': ACCEPTABLE,
    'Maximum_Iterations_Exceeded': ITERATION_LIMIT,
    'Maximum_WallTime_Exceeded': TIME_LIMIT,
    'Infeasible_Problem_Detected': INFEASIBLE,
}


class NlpsolCall(NamedTuple):
    """The arguments of nlpsol, under its names."""

    x0: np.ndarray
    p: np.ndarray
    lbx: np.ndarray
    ubx: np.ndarray
    lbg: np.ndarray
    ubg: np.ndarray


class Termination(NamedTuple):
    """Why nlpsol returned."""

    solved: bool
    reason: str  # one of the constants above, or the solver's own text
    iterations: int


def make_nlpsol(
    problem: StageProblem, solver: str, functions: dict[str, ca.Function], settings: dict
) -> ca.Function:
    """Return CasADi's nlpsol on the functions of `nlp_functions.build`."""
    # CasADi derives no function that the cache already contains under its name
    settings = COMMON_SETTINGS | settings | {'cache': functions}
    return ca.nlpsol(problem.name, solver, functions['nlp'], settings)


class Ipopt:
    """IPOPT (Waechter & Biegler 2006) on the functions of one problem: the reference solver."""

    def __init__(
        self, problem: StageProblem, options: SolverOptions, functions: dict[str, ca.Function]
    ):
        settings = {
            'print_level': 0,
            'sb': 'yes',  # no banner
            'max_iter': options.max_iterations,
            'tol': options.tolerance,
        }
        if options.time_limit_s is not None:
            settings['max_wall_time'] = options.time_limit_s
        nlpsol = make_nlpsol(problem, 'ipopt', functions, {'ipopt': settings})
        self._nlpsol = BufferedFunction(nlpsol)

    def set_time_limit(self, seconds: float) -> None:
        """Do nothing: IPOPT reads its limit once, from the options."""

    def run(self, call: NlpsolCall, start_s: float) -> tuple[dict[str, np.ndarray], Termination]:
        """Return nlpsol's results and termination; IPOPT measures its time limit itself."""
        results = self._nlpsol(**call._asdict())
        stats = self._nlpsol.stats()
        status = stats['return_status']
        reason = IPOPT_REASONS.get(status, status.replace('_', ' ').lower())
        return results, Termination(stats['success'], reason, stats['iter_count'])
