"""Optimal control problems in stages, solved by a primal-dual interior-point method.

Problem (module stage_problem):
    StageProblem    dynamics, costs and constraints of a stage as CasADi functions
    Bounds          limits of states, inputs and constraints; `no_bounds(problem)` has none
    Plan            states, inputs and Multipliers over the horizon; `zero_plan(problem)`
    ProblemError    a problem contradicts itself, or its arrays have the wrong shape
    rk2             explicit midpoint steps of a differential equation
    shift           the plan one stage later: the initial guess of the next solve

Solver (modules solver, solution):
    make_solver     (StageProblem, SolverOptions) -> StageSolver
    SolverOptions   limits of iterations and time, tolerance; OneStep
    StageSolver     solve(x0, P, bounds, guess) -> Solution, set_time_limit(seconds)
    Solution        plan, cost, status (SOLVED, ONE_STEP, STOPPED_EARLY, FAILED), residuals, times

Modules to import on their own:
    compile_cache       C source -> shared library, compiled once per machine (needs no CasADi)
    reference_solvers   fatrop and IPOPT on the same problems, for tests and benchmarks

Inside:
    riccati_codegen      writes the C source of a solver, with vector_codegen for the functions of
                         the stages and their derivatives
    compiled_functions   CasADi functions as machine code, and calls without copies

CasADi, numpy and a C compiler are needed; each problem is compiled once per machine.
"""

from importlib import import_module
from typing import Any

_NAMES = {
    'stage_problem': (
        *('Bounds', 'Multipliers', 'Plan', 'ProblemError', 'StageProblem'),
        *('no_bounds', 'rk2', 'shift', 'zero_plan'),
    ),
    'solution': (
        *('FAILED', 'ONE_STEP', 'SOLVED', 'STOPPED_EARLY'),
        *('OneStep', 'Solution', 'SolverOptions'),
    ),
    'solver': ('StageSolver', 'make_solver'),
}
_MODULES = {name: module for module, names in _NAMES.items() for name in names}
__all__ = sorted(_MODULES)


def __getattr__(name: str) -> Any:
    """Return a public name; its module is imported on first use, so compile_cache needs no CasADi.

    Raises AttributeError for an unknown name.
    """
    if name not in _MODULES:
        raise AttributeError(f'module {__name__!r} has no attribute {name!r}')
    return getattr(import_module(f'{__name__}.{_MODULES[name]}'), name)
