"""The solvers that the parameters select, and the time that each may take."""

from dataclasses import replace

from mpcc_controller.parameters import ControllerParams, Solver
from node_runtime.parameters import ParameterError
from stage_solver.solution import OneStep, SolverOptions, StageSolver
from stage_solver.solver import make_solver
from stage_solver.stage_problem import StageProblem

CONVERGED = 'converged'
HAS_ONE_STEP = 'riccati'
SLIDING_FACTOR = 3  # of `max_iterations` while a car slides; in realtime the time limit holds


def first_solver_options(params: ControllerParams, limit_time: bool) -> SolverOptions:
    """Return the options of the first solver; ParameterError for a mode that it does not have."""
    chosen = params.solver
    return SolverOptions(
        name=chosen.name,
        max_iterations=chosen.max_iterations,
        tolerance=chosen.tolerance,
        time_limit_s=chosen.time_limit_s if limit_time else None,
        compiled=chosen.compiled,
        one_step=_one_step(chosen),
    )


def sliding_options(params: ControllerParams, limit_time: bool) -> SolverOptions:
    """Return the options for a car that slides: those of the first solver, with more iterations.

    From the guess of the recovery law 44 % of 100 random slides had a plan that may be driven
    within 100 iterations, 86 % within 300 (mpcc, sideslip to 60 deg, yaw rate to 2 rad/s). The
    planner gets on with a relaxed problem where they are not enough.
    """
    options = first_solver_options(params, limit_time)
    most = SLIDING_FACTOR * options.max_iterations
    return replace(options, max_iterations=most, one_step=None)


def candidate_options(params: ControllerParams, limit_time: bool) -> SolverOptions:
    """Return the options for candidates: those of the first solver, with their own iterations."""
    options = first_solver_options(params, limit_time)
    return replace(options, max_iterations=params.candidates.max_iterations, one_step=None)


def make_second_solver(
    params: ControllerParams, problem: StageProblem, limit_time: bool, first: StageSolver
) -> StageSolver | None:
    """Return the solver to use after a failure of the first, None if that would be the same."""
    options = second_solver_options(params, limit_time)
    same = options is None or options.name == first.name
    return None if same else make_solver(problem, options)


def second_solver_options(params: ControllerParams, limit_time: bool) -> SolverOptions | None:
    """Return the options of the second solver, None without one.

    Its time limit is what the first solver leaves of `fallback_limit_s`.
    """
    chosen = params.solver
    if chosen.fallback in ('none', chosen.name):
        return None
    remaining_s = chosen.fallback_limit_s - chosen.time_limit_s
    changes = {
        'name': chosen.fallback,
        'time_limit_s': remaining_s if limit_time else None,
        'one_step': None,
    }
    return SolverOptions(**vars(first_solver_options(params, limit_time)) | changes)


def _one_step(chosen: Solver) -> OneStep | None:
    if chosen.mode == CONVERGED:
        return None
    if chosen.name != HAS_ONE_STEP:
        raise ParameterError(
            f'solver.mode: {chosen.mode} needs solver.name {HAS_ONE_STEP}; '
            f'allowed with {chosen.name}: {CONVERGED}'
        )
    return OneStep(chosen.one_step_residual, chosen.one_step_decrease)
