"""A structure-exploiting interior-point method, generated for each problem (docs/solver.md)."""

import ctypes
import math
from functools import cache
from pathlib import Path

import casadi as ca
import numpy as np

from stage_solver import compile_cache, riccati_codegen, stage_problem
from stage_solver.solution import (
    FAILED,
    ONE_STEP,
    SOLVED,
    STOPPED_EARLY,
    Solution,
    SolverOptions,
    stopwatch,
)
from stage_solver.stage_problem import Bounds, Multipliers, Plan, StageProblem

OLDEST_CASADI = (3, 7)  # older versions hold Python's lock during a whole solve
ITERATION_LIMIT, TIME_LIMIT, INFEASIBLE = 'iteration limit', 'time limit', 'locally infeasible'
# doubles in a vector of the CPU, by Linux's name of the instruction set
LANES = (('avx512f', 8), ('avx2', 4))
MIN_LANES = 2
WARM_BARRIER = 1e-5  # mu of a warm start, cost units

# status of riccati_c/solve.c -> status and message of a Solution
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
    (FAILED, 'the derivatives of the {part} are not finite at stage {stage}'),
    (FAILED, 'no step from the guess is acceptable'),
)
PARTS = ('dynamics', 'constraints', 'cost')  # as in riccati_c/stages.h
# the fields of Call in riccati_c/workspace.h
ARRAYS = (
    'x0', 'P', 'x_low', 'u_low', 'g_low', 'h_low', 'x_high', 'u_high', 'g_high', 'h_high',
    'X', 'U', 'm_x', 'm_u', 'm_g', 'm_h', 'm_dynamics',
)  # fmt: skip
DOUBLES = ('tolerance', 'time_limit', 'warm_mu', 'step_residual', 'step_decrease')
DOUBLES += ('cost', 'primal_residual', 'dual_residual')
INTEGERS = ('warm', 'max_iterations', 'status', 'iterations', 'stage', 'part')
ALIGNMENT = 64  # bytes of the widest vector


class Call(ctypes.Structure):
    """As in riccati_c/workspace.h."""

    _fields_ = (
        [(name, ctypes.c_void_p) for name in ARRAYS]
        + [(name, ctypes.c_double) for name in DOUBLES]
        + [(name, ctypes.c_longlong) for name in INTEGERS]
    )


class CasadiTooOldError(ImportError):
    """The installed CasADi is older than OLDEST_CASADI."""


def make_solver(problem: StageProblem, options: SolverOptions) -> 'StageSolver':
    """Return the solver of a problem as machine code, from the cache or compiled now.

    Raises CasadiTooOldError, and CompileError without a working C compiler.
    """
    check_casadi()
    flags = (*riccati_codegen.FLAGS, f'-DW={lanes()}')
    source = riccati_codegen.source(problem)
    library = compile_cache.compile_library(source, f'{problem.name}_riccati', flags)
    return StageSolver(problem, options, library)


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


def lanes() -> int:
    """Return how many stages are evaluated at a time: the doubles in a vector of this CPU."""
    try:
        words = set(Path('/proc/cpuinfo').read_text().split())
    except OSError:
        return MIN_LANES
    return next((width for flag, width in LANES if flag in words), MIN_LANES)


class StageSolver:
    """Solves one problem repeatedly: one C call per solve, which releases Python's lock.

    Equal arguments give equal bits on one machine, unless the time limit ends a solve. An instance
    is for one thread at a time; any number of instances work in parallel.
    """

    def __init__(self, problem: StageProblem, options: SolverOptions, library: Path):
        self._problem = problem
        self._solve, size = _load(library)
        self._memory = np.zeros(size + ALIGNMENT, np.uint8)
        address = self._memory.ctypes.data
        self._workspace = address + -address % ALIGNMENT
        self._arrays = {name: np.zeros(problem.shapes[name]) for name in ARRAYS}
        call = self._call = Call(**{name: a.ctypes.data for name, a in self._arrays.items()})
        call.max_iterations = options.max_iterations
        call.tolerance = options.tolerance
        call.time_limit = math.inf if options.time_limit_s is None else options.time_limit_s
        call.warm_mu = WARM_BARRIER
        # never is below 0: at an optimum residual and decrease may be exactly 0
        call.step_residual, call.step_decrease = options.one_step or (-1.0, -1.0)

    def solve(self, x0: np.ndarray, P: np.ndarray, bounds: Bounds, guess: Plan) -> Solution:
        """Return the solution from state x0 (nx,) with stage parameters P (N + 1, np), SI units.

        A guess with multipliers is a warm start. Raises ProblemError when an array has the wrong
        shape.
        """
        times = stopwatch()
        stage_problem.check_shapes(self._problem, x0, P, bounds, guess)
        arrays, call = self._arrays, self._call
        values = {'x0': x0, 'P': P, 'X': guess.X, 'U': guess.U} | bounds._asdict()
        call.warm = guess.multipliers is not None
        if call.warm:
            values |= {f'm_{name}': value for name, value in guess.multipliers._asdict().items()}
        for name, value in values.items():
            arrays[name][...] = value
        self._solve(self._workspace, ctypes.addressof(call))
        status, message = OUTCOMES[call.status]
        if math.isnan(call.cost):  # the arguments or the guess were refused
            plan = Plan(np.vstack([x0, guess.X[1:]]), np.asarray(guess.U))
            error = stage_problem.find_invalid_argument(self._problem, x0, P, bounds, plan)
            message = error or message
        else:
            multipliers = Multipliers(*(arrays[f'm_{n}'].copy() for n in Multipliers._fields))
            plan = Plan(arrays['X'].copy(), arrays['U'].copy(), multipliers)
            if call.stage >= 0:
                message = message.format(part=PARTS[call.part], stage=call.stage)
        return Solution(
            plan=plan,
            cost=call.cost,
            status=status,
            message=message,
            iterations=call.iterations,
            primal_residual=call.primal_residual,
            dual_residual=call.dual_residual,
            **times(),
        )

    def set_time_limit(self, seconds: float) -> None:
        """Limit the wall time of later solves."""
        self._call.time_limit = seconds


@cache
def _load(library):
    loaded = ctypes.CDLL(str(library))
    loaded.riccati_bytes.restype = loaded.riccati_call_bytes.restype = ctypes.c_size_t
    if loaded.riccati_call_bytes() != ctypes.sizeof(Call):
        raise OSError(f'{library} was compiled for another layout of its arguments')
    loaded.riccati_solve.argtypes = [ctypes.c_void_p, ctypes.c_void_p]
    loaded.riccati_solve.restype = None
    return loaded.riccati_solve, loaded.riccati_bytes()
