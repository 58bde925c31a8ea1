"""Select and build the solver of a stage problem."""

from collections.abc import Iterable

import casadi as ca

from stage_solver import compile_cache, nlpsol_solver, riccati_solver
from stage_solver.nlpsol_solver import NlpsolSolver
from stage_solver.solution import SolverOptions, StageSolver
from stage_solver.stage_problem import ProblemError, StageProblem

OLDEST_CASADI = (3, 7)  # older versions hold Python's lock during a whole solve

# factories (StageProblem, SolverOptions) -> StageSolver, by the name in the options
SOLVERS = {'riccati': riccati_solver.make_solver, 'fatrop': NlpsolSolver, 'ipopt': NlpsolSolver}


class CasadiTooOldError(ImportError):
    """The installed CasADi is older than OLDEST_CASADI."""


def make_solver(problem: StageProblem, options: SolverOptions) -> StageSolver:
    """Return a solver of `problem`; compiles its functions where the options ask for it.

    Raises CasadiTooOldError, and ProblemError for an unknown solver name.
    """
    check_casadi()
    if options.name not in SOLVERS:
        known = ', '.join(SOLVERS)
        raise ProblemError(f'there is no solver {options.name!r}; there are: {known}')
    return SOLVERS[options.name](problem, options)


def compile_solvers(problem: StageProblem, chosen: Iterable[SolverOptions]) -> None:
    """Compile what several solvers of a problem need at the same time, for `make_solver` to load.

    Raises CasadiTooOldError, and CompileError as `compile_library`.
    """
    check_casadi()
    # CasADi is not for several threads: the sources are written in this one
    sources = [
        riccati_solver.c_source(problem)
        if options.name == 'riccati'
        else nlpsol_solver.c_source(problem, options)
        for options in chosen
        if options.name == 'riccati' or options.compiled
    ]
    compile_cache.compile_libraries(sources)


def check_casadi(version: str = ca.__version__) -> None:
    """Raise CasadiTooOldError, with the command that upgrades, for a version that is too old."""
    major, minor, *_ = version.split('.')
    if (int(major), int(minor)) < OLDEST_CASADI:
        oldest = '.'.join(map(str, OLDEST_CASADI))
        raise CasadiTooOldError(
            f'CasADi {version} is too old: {oldest} or newer is needed, because older ones keep '
            f"Python's lock during a solve and stall every other thread of the node. "
            f"Upgrade with: pip install --upgrade 'casadi>={oldest}'"
        )
