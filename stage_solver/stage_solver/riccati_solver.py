"""A structure-exploiting interior-point method, generated for each problem (docs/solver.md)."""

import math
import warnings
from pathlib import Path

import numpy as np

from stage_solver import compile_cache, riccati_library, riccati_source, sound, stopwatch
from stage_solver.backend import INFEASIBLE, ITERATION_LIMIT, TIME_LIMIT
from stage_solver.layout import Layout
from stage_solver.nlpsol_solver import NlpsolSolver
from stage_solver.solution import (
    FAILED,
    ONE_STEP,
    SOLVED,
    STOPPED_EARLY,
    Solution,
    SolverOptions,
    StageSolver,
)
from stage_solver.stage_problem import Bounds, Multipliers, Plan, StageProblem

FALLBACK = 'fatrop'
# Doubles in a vector of the CPU, widest first, by the name that Linux gives the instruction set
LANES = (('avx512f', 8), ('avx2', 4))
FEWEST_LANES = 2
WARM_BARRIER = 1e-5  # mu of a warm start, cost units

# status of riccati_c/solve.c -> status of a Solution, and why
OUTCOMES = (
    (SOLVED, 'converged'),
    (STOPPED_EARLY, ITERATION_LIMIT),
    (STOPPED_EARLY, TIME_LIMIT),
    (STOPPED_EARLY, 'no further progress'),
    (STOPPED_EARLY, 'no acceptable step'),
    (FAILED, INFEASIBLE),
    (FAILED, 'a function of the problem is not finite at the guess'),
    (FAILED, 'an argument is not finite'),
    (ONE_STEP, 'one step is enough'),
)


def make_solver(problem: StageProblem, options: SolverOptions) -> StageSolver:
    """Return the solver, or fatrop with one warning where there is no working C compiler."""
    try:
        library = compile_solver(problem)
    except compile_cache.CompileError as error:
        warnings.warn(f'{error}\n{FALLBACK} is used instead', RuntimeWarning, stacklevel=2)
    else:
        if library is not None:
            return RiccatiSolver(problem, options, library)
        compile_cache.warn_no_compiler(f'{FALLBACK} replaces the riccati solver, many times slower')
    given = {'name': FALLBACK, 'compiled': False}
    return NlpsolSolver(problem, SolverOptions(**vars(options) | given))


def compile_solver(problem: StageProblem) -> Path | None:
    """Return the solver of a problem as machine code, from the cache or compiled now.

    None without a C compiler; raises CompileError when it fails.
    """
    flags = (*riccati_source.FLAGS, f'-DW={lanes()}')
    return compile_cache.compile_library(
        riccati_source.source(problem), f'{problem.name}_riccati', flags
    )


def lanes() -> int:
    """Return how many stages are evaluated at a time: the doubles in a vector of this CPU."""
    try:
        words = set(Path('/proc/cpuinfo').read_text().split())
    except OSError:
        return FEWEST_LANES
    return next((width for flag, width in LANES if flag in words), FEWEST_LANES)


class RiccatiSolver:
    """A StageSolver (see `solution`): one call of C per solve, without Python's lock.

    Equal arguments give equal bits on one machine, unless the time limit cuts a solve short. An
    instance works for one thread at a time; any number of instances work side by side.
    """

    name = 'riccati'

    def __init__(self, problem: StageProblem, options: SolverOptions, library: Path):
        self._problem = problem
        self._layout = Layout(problem)
        self._instance = riccati_library.Instance(library, _shapes(problem))
        call = self._instance.call
        call.max_iterations = options.max_iterations
        call.tolerance = options.tolerance
        call.time_limit = math.inf if options.time_limit_s is None else options.time_limit_s
        call.warm_mu = WARM_BARRIER
        if options.one_step is not None:
            call.step_residual = options.one_step.residual
            call.step_decrease = options.one_step.decrease

    def solve(self, x0: np.ndarray, P: np.ndarray, bounds: Bounds, guess: Plan) -> Solution:
        """See `solution.StageSolver`; a guess with multipliers is a warm start."""
        watch = stopwatch.started()
        self._layout.check(x0, P, bounds, guess)
        arrays, call = self._instance.arrays, self._instance.call
        given = {'x0': x0, 'P': P, 'X': guess.X, 'U': guess.U} | bounds._asdict()
        call.warm = guess.multipliers is not None
        if call.warm:
            given |= {f'm_{name}': value for name, value in guess.multipliers._asdict().items()}
        for name, value in given.items():
            arrays[name][...] = value
        self._instance.solve()
        status, message = OUTCOMES[call.status]
        if math.isnan(call.cost):  # it did not begin
            plan = Plan(np.vstack([x0, guess.X[1:]]), np.asarray(guess.U))
            message = sound.complaint(self._problem, x0, P, bounds, plan) or message
        else:
            plan = self._plan()
        return Solution(
            plan=plan,
            cost=call.cost,
            status=status,
            message=message,
            iterations=call.iterations,
            primal_residual=call.primal_residual,
            dual_residual=call.dual_residual,
            **watch.took(),
        )

    def set_time_limit(self, seconds: float) -> None:
        """See `solution.StageSolver`."""
        self._instance.call.time_limit = seconds

    def _plan(self):
        arrays = self._instance.arrays
        multipliers = Multipliers(*(arrays[f'm_{name}'].copy() for name in Multipliers._fields))
        return Plan(arrays['X'].copy(), arrays['U'].copy(), multipliers)


def _shapes(problem):
    """Return the shape of each array of the call."""
    N, nx, nu = problem.horizon, problem.nx, problem.nu
    of_states = dict.fromkeys(('X', 'x_low', 'x_high', 'm_x'), (N + 1, nx))
    of_inputs = dict.fromkeys(('U', 'u_low', 'u_high', 'm_u'), (N, nu))
    of_g = dict.fromkeys(('g_low', 'g_high', 'm_g'), (N, problem.ng))
    of_h = dict.fromkeys(('h_low', 'h_high', 'm_h'), (problem.nh,))
    others = {'x0': (nx,), 'P': (N + 1, problem.np), 'm_dynamics': (N, nx)}
    return of_states | of_inputs | of_g | of_h | others
