"""Choose and make the solver of a stage problem."""

from stage_solver import casadi_version, riccati_solver
from stage_solver.nlpsol_solver import NlpsolSolver
from stage_solver.shooting import ProblemError, StageProblem
from stage_solver.solution import (
    FAILED,
    ONE_STEP,
    SOLVED,
    STOPPED_EARLY,
    OneStep,
    Solution,
    SolverOptions,
    StageSolver,
)

__all__ = [
    'FAILED',
    'ONE_STEP',
    'SOLVED',
    'STOPPED_EARLY',
    'OneStep',
    'Solution',
    'SolverOptions',
    'StageSolver',
    'make',
]

# what makes a StageSolver of a StageProblem and SolverOptions, by the name in the options
SOLVERS = {'riccati': riccati_solver.make, 'fatrop': NlpsolSolver, 'ipopt': NlpsolSolver}


def make(problem: StageProblem, options: SolverOptions) -> StageSolver:
    """Return a solver; where options say so it first compiles the functions of the problem.

    Raises CasadiTooOldError, and ProblemError for a solver that does not exist.
    """
    casadi_version.check()
    if options.name not in SOLVERS:
        known = ', '.join(SOLVERS)
        raise ProblemError(f'there is no solver {options.name!r}; there are: {known}')
    return SOLVERS[options.name](problem, options)
