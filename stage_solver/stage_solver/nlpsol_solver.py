"""A StageSolver on fatrop or IPOPT: validate, pack, solve, compute the residuals of the result."""

import math

import numpy as np

from stage_solver import compiled_functions, nlp_functions, nlpsol_backend, validation
from stage_solver.compiled_functions import BufferedFunction
from stage_solver.fatrop import Fatrop
from stage_solver.nlpsol_backend import Ipopt, NlpsolCall
from stage_solver.solution import (
    FAILED,
    SOLVED,
    STOPPED_EARLY,
    Solution,
    SolverOptions,
    Stopwatch,
)
from stage_solver.stage_problem import Bounds, Multipliers, Plan, StageProblem

BACKENDS = {'fatrop': Fatrop, 'ipopt': Ipopt}


class NlpLayout:
    """Converts arrays per stage in SI units to the vectors of `nlp_functions`, and back."""

    def __init__(self, problem: StageProblem):
        self.problem = problem
        self.scale_x = np.array(problem.scale_x)
        self.scale_u = np.array(problem.scale_u)

    def pack(self, X: np.ndarray, U: np.ndarray) -> np.ndarray:
        """Return v of states (N + 1, nx) and inputs (N, nu)."""
        X, U = X / self.scale_x, U / self.scale_u
        return np.concatenate([np.hstack([X[:-1], U]).ravel(), X[-1]])

    def unpack(self, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return states (N + 1, nx) and inputs (N, nu) of v."""
        X, U = self._split(v)
        return X * self.scale_x, U * self.scale_u

    def pack_call(self, P: np.ndarray, bounds: Bounds, guess: Plan) -> NlpsolCall:
        """Return the arguments of nlpsol; both limits of the first state are that of the guess."""
        first = guess.X[:1]
        defect = np.zeros((self.problem.horizon, self.problem.nx))
        return NlpsolCall(
            x0=self.pack(guess.X, guess.U),
            p=P.ravel(),
            lbx=self.pack(np.vstack([first, bounds.x_low[1:]]), bounds.u_low),
            ubx=self.pack(np.vstack([first, bounds.x_high[1:]]), bounds.u_high),
            lbg=np.concatenate([np.hstack([defect, bounds.g_low]).ravel(), bounds.h_low]),
            ubg=np.concatenate([np.hstack([defect, bounds.g_high]).ravel(), bounds.h_high]),
        )

    def unpack_multipliers(self, lam_v: np.ndarray, lam_g: np.ndarray) -> Multipliers:
        """Return the multipliers per SI unit."""
        lam_x, lam_u = self._split(lam_v)
        rows = self.problem.nx + self.problem.ng
        end = self.problem.horizon * rows
        lam_dynamics, g = np.hsplit(lam_g[:end].reshape(-1, rows), [self.problem.nx])
        return Multipliers(
            x=lam_x / self.scale_x,
            u=lam_u / self.scale_u,
            dynamics=lam_dynamics / self.scale_x,
            g=g.copy(),
            h=lam_g[end:].copy(),
        )

    def _split(self, v):
        nx, width = self.problem.nx, self.problem.nx + self.problem.nu
        W = v[: self.problem.horizon * width].reshape(-1, width)
        return np.vstack([W[:, :nx], v[None, -nx:]]), W[:, nx:].copy()


def c_source(problem: StageProblem, options: SolverOptions) -> tuple[str, str, tuple[str, ...]]:
    """Return the arguments of `compile_library` for the functions of a solver."""
    functions = tuple(nlp_functions.build(problem, options.name).values())
    name = _library(problem, options)
    return compiled_functions.c_source(functions, name), name, compiled_functions.FLAGS


def _library(problem, options):
    return f'{problem.name}_{options.name}'


class NlpsolSolver:
    """A StageSolver (see `solution`); `options.name` is a key of BACKENDS.

    `flags` are those of the C compiler, where the options ask for compiled functions.
    """

    def __init__(
        self,
        problem: StageProblem,
        options: SolverOptions,
        flags: tuple[str, ...] = compiled_functions.FLAGS,
    ):
        self.name = options.name
        self._problem = problem
        self._layout = NlpLayout(problem)
        functions = nlp_functions.build(problem, options.name)
        if options.compiled:
            library = _library(problem, options)
            functions = compiled_functions.compile_functions(functions, library, flags)
        self._lagrangian = BufferedFunction(functions['nlp_grad'])
        self._backend = BACKENDS[options.name](problem, options, functions)

    def solve(self, x0: np.ndarray, P: np.ndarray, bounds: Bounds, guess: Plan) -> Solution:
        """See `solution.StageSolver`."""
        stopwatch = Stopwatch()
        validation.check_shapes(self._problem, x0, P, bounds, guess)
        guess = Plan(np.vstack([x0, guess.X[1:]]), np.asarray(guess.U))
        error = validation.find_invalid_argument(self._problem, x0, P, bounds, guess)
        if error:
            return _refusal(guess, error, stopwatch)
        call = self._layout.pack_call(P, bounds, guess)
        at = self._lagrangian(x=call.x0, p=call.p, lam_f=1, lam_g=0)
        error = validation.find_non_finite_value(
            self._problem, at['f'][0], at['g'], at['grad_gamma_x']
        )
        if error:
            return _refusal(guess, error, stopwatch)
        results, termination = self._backend.run(call, stopwatch.start_s)
        return self._solution(guess, call, results, termination, stopwatch)

    def set_time_limit(self, seconds: float) -> None:
        """See `solution.StageSolver`."""
        self._backend.set_time_limit(seconds)

    def _solution(self, guess, call, results, termination, stopwatch):
        v, lam_v, lam_g = results['x'], results['lam_x'], results['lam_g']
        at = self._lagrangian(x=v, lam_g=lam_g)
        primal = _max_violation(call, v, at['g'])
        status, reason = FAILED, termination.reason
        if termination.solved:
            status = SOLVED
        elif reason in nlpsol_backend.EARLY_STOPS:
            status = STOPPED_EARLY
        plan = Plan(*self._layout.unpack(v), self._layout.unpack_multipliers(lam_v, lam_g))
        if not (np.isfinite(v).all() and math.isfinite(primal)):
            plan, status, reason = guess, FAILED, f'{reason}; the last iterate is not finite'
        # the first state is fixed, so the gradient with respect to it has no meaning
        gradient = (at['grad_gamma_x'] + lam_v)[self._problem.nx :]
        return Solution(
            plan=plan,
            cost=float(at['f'][0]),
            status=status,
            message=reason,
            iterations=termination.iterations,
            primal_residual=primal,
            dual_residual=float(np.abs(gradient).max()),
            **stopwatch.times(),
        )


def _max_violation(call: NlpsolCall, v, g) -> float:
    """Return the largest violation of a bound, a constraint or the dynamics, in solver units."""
    violation = np.concatenate([call.lbx - v, v - call.ubx, call.lbg - g, g - call.ubg])
    return float(np.maximum(violation.max(), 0.0))  # not max(): it would take NaN for 0


def _refusal(guess, message, stopwatch):
    return Solution(
        plan=guess,
        cost=math.nan,
        status=FAILED,
        message=message,
        iterations=0,
        primal_residual=math.inf,
        dual_residual=math.inf,
        **stopwatch.times(),
    )
