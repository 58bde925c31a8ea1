"""Optimal control problems in stages, solved by a primal-dual interior-point method.

    StageProblem    the problem: dynamics, costs and constraints of a stage as CasADi functions
    Bounds          limits of states, inputs and constraints; `no_bounds(problem)` has none
    Plan            states and inputs over the horizon; `zero_plan(problem)` is all zeros
    SolverOptions   which solver ('riccati', 'fatrop', 'ipopt'), and when it stops
    make_solver     (StageProblem, SolverOptions) -> a solver with `solve(x0, P, bounds, guess)`
    Solution        plan, cost, status (SOLVED, ONE_STEP, STOPPED_EARLY, FAILED), residuals, times
    shift           the plan one stage later: the guess of the next solve
    rk2             explicit midpoint steps of a differential equation
    ProblemError    a problem, or the numbers given for it, do not fit together

It needs CasADi and numpy; with a C compiler a problem is compiled once per machine (`compiled`).
"""

from importlib import import_module
from typing import Any

_STAGE_PROBLEM = ('Bounds', 'Plan', 'ProblemError', 'StageProblem')
_STAGE_PROBLEM += ('no_bounds', 'rk2', 'shift', 'zero_plan')
_SOLUTION = ('FAILED', 'ONE_STEP', 'SOLVED', 'STOPPED_EARLY', 'OneStep', 'Solution')
_SOLUTION += ('SolverOptions',)
_MODULE_OF = {
    **dict.fromkeys(_STAGE_PROBLEM, 'stage_problem'),
    **dict.fromkeys(_SOLUTION, 'solution'),
    'make_solver': 'solver',
}
__all__ = sorted(_MODULE_OF)


def __getattr__(name: str) -> Any:
    """Return a public name; its module is loaded then, so the compile cache costs no CasADi."""
    if name not in _MODULE_OF:
        raise AttributeError(f'module {__name__!r} has no attribute {name!r}')
    return getattr(import_module(f'{__name__}.{_MODULE_OF[name]}'), name)
