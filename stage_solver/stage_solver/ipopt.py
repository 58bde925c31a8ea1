"""IPOPT (Waechter & Biegler 2006) as CasADi calls it: the reference, and a second opinion."""

import casadi as ca
import numpy as np

from stage_solver import backend
from stage_solver.backend import Call, Ending
from stage_solver.buffered import Buffered
from stage_solver.solution import SolverOptions
from stage_solver.stage_problem import StageProblem

REASONS = {
    'Solved_To_Acceptable_Level': backend.ACCEPTABLE,
    'Search_Direction_Becomes_Too_Small': backend.ACCEPTABLE,
    'Maximum_Iterations_Exceeded': backend.ITERATION_LIMIT,
    'Maximum_WallTime_Exceeded': backend.TIME_LIMIT,
    'Infeasible_Problem_Detected': backend.INFEASIBLE,
}


class Ipopt:
    """IPOPT on the functions of one problem."""

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
        nlpsol = backend.nlpsol(problem, 'ipopt', functions, {'ipopt': settings})
        self._nlpsol = Buffered(nlpsol)

    def set_time_limit(self, seconds: float) -> None:
        """Keep the limit of the options: IPOPT is told once."""

    def run(self, call: Call, start_s: float) -> tuple[dict[str, np.ndarray], Ending]:
        """Return nlpsol's results and how it ended; its own clock keeps the time limit."""
        results = self._nlpsol(**call._asdict())
        stats = self._nlpsol.stats()
        status = stats['return_status']
        reason = REASONS.get(status, status.replace('_', ' ').lower())
        return results, Ending(stats['success'], reason, stats['iter_count'])
