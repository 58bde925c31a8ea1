"""The solvers that the parameters name, and how long each may take."""

from mpcc_controller.parameters import ControllerParams, Solver
from node_runtime.parameters import ParameterError
from stage_solver.solution import OneStep, SolverOptions, StageSolver
from stage_solver.solver import make_solver
from stage_solver.stage_problem import StageProblem

CONVERGED = 'converged'
HAS_ONE_STEP = 'riccati'


def options(params: ControllerParams, limit_time: bool) -> SolverOptions:
    """Return the options of the first solver; raises ParameterError for a mode that it has not."""
    rules = params.solver
    return SolverOptions(
        name=rules.name,
        max_iterations=rules.max_iterations,
        tolerance=rules.tolerance,
        time_limit_s=rules.time_limit_s if limit_time else None,
        compiled=rules.compiled,
        one_step=_one_step(rules),
    )


def second(
    params: ControllerParams, problem: StageProblem, limit_time: bool, first: StageSolver
) -> StageSolver | None:
    """Return the solver to ask after a failure of the first; the same again would only fail again.

    It is made for the time that a first one which used up its own leaves. What counts is which one
    was made: without a C compiler that is fatrop where riccati is named.
    """
    rules = params.solver
    if rules.fallback in ('none', first.name):
        return None
    rest_s = rules.fallback_limit_s - rules.time_limit_s
    others = {
        'name': rules.fallback,
        'time_limit_s': rest_s if limit_time else None,
        'one_step': None,
    }
    return make_solver(problem, SolverOptions(**vars(options(params, limit_time)) | others))


def _one_step(rules: Solver) -> OneStep | None:
    if rules.mode == CONVERGED:
        return None
    if rules.name != HAS_ONE_STEP:
        raise ParameterError(
            f'solver.mode: {rules.mode} needs solver.name {HAS_ONE_STEP}; '
            f'allowed with {rules.name}: {CONVERGED}'
        )
    return OneStep(rules.one_step_residual, rules.one_step_decrease)
