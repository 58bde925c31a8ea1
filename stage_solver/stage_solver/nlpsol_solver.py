"""A StageSolver out of fatrop or IPOPT: pack, look, solve, judge by our own residuals."""

import math

import numpy as np

from stage_solver import backend, compiled_functions, nlp_functions, sound, stopwatch
from stage_solver.backend import Call
from stage_solver.buffered import Buffered
from stage_solver.fatrop import Fatrop
from stage_solver.ipopt import Ipopt
from stage_solver.layout import Layout
from stage_solver.solution import FAILED, SOLVED, STOPPED_EARLY, Solution, SolverOptions
from stage_solver.stage_problem import Bounds, Plan, StageProblem

BACKENDS = {'fatrop': Fatrop, 'ipopt': Ipopt}


class NlpsolSolver:
    """A StageSolver (see `solution`); `options.name` is a key of BACKENDS.

    `flags` are those of the C compiler, where the options ask for it.
    """

    def __init__(
        self,
        problem: StageProblem,
        options: SolverOptions,
        flags: tuple[str, ...] = compiled_functions.FLAGS,
    ):
        self.name = options.name
        self._problem = problem
        self._layout = Layout(problem)
        functions = nlp_functions.build(problem, options.name)
        if options.compiled:
            functions = compiled_functions.compile_functions(
                functions, f'{problem.name}_{options.name}', flags
            )
        self._lagrangian = Buffered(functions['nlp_grad'])
        self._backend = BACKENDS[options.name](problem, options, functions)

    def solve(self, x0: np.ndarray, P: np.ndarray, bounds: Bounds, guess: Plan) -> Solution:
        """See `solution.StageSolver`."""
        watch = stopwatch.started()
        self._layout.check(x0, P, bounds, guess)
        guess = Plan(np.vstack([x0, guess.X[1:]]), np.asarray(guess.U))
        wrong = sound.complaint(self._problem, x0, P, bounds, guess)
        if wrong:
            return _refusal(guess, wrong, watch)
        v_low, v_high, g_low, g_high = self._layout.pack_bounds(x0, bounds)
        v0 = self._layout.pack(guess.X, guess.U)
        call = Call(v0, P.ravel(), v_low, v_high, g_low, g_high)
        at = self._lagrangian(x=v0, p=call.p, lam_f=1, lam_g=0)
        wrong = sound.blow_up(self._problem, at['f'][0], at['g'], at['grad_gamma_x'])
        if wrong:
            return _refusal(guess, wrong, watch)
        results, ending = self._backend.run(call, watch.wall_s)
        return self._judge(guess, call, results, ending, watch)

    def set_time_limit(self, seconds: float) -> None:
        """See `solution.StageSolver`; IPOPT keeps the limit of its options."""
        self._backend.set_time_limit(seconds)

    def _judge(self, guess, call, results, ending, watch):
        v, lam_v, lam_g = results['x'], results['lam_x'], results['lam_g']
        at = self._lagrangian(x=v, lam_g=lam_g)
        primal = _violation(call, v, at['g'])
        status, reason = FAILED, ending.reason
        if ending.solved:
            status = SOLVED
        elif reason in backend.LIMITS:
            status = STOPPED_EARLY
        plan = Plan(*self._layout.unpack(v), self._layout.unpack_multipliers(lam_v, lam_g))
        if not (np.isfinite(v).all() and math.isfinite(primal)):
            plan, status, reason = guess, FAILED, f'{reason}; the last iterate is not finite'
        # the first state is nobody's choice, so the slope along it means nothing
        slope = (at['grad_gamma_x'] + lam_v)[self._problem.nx :]
        return Solution(
            plan=plan,
            cost=float(at['f'][0]),
            status=status,
            message=reason,
            iterations=ending.iterations,
            primal_residual=primal,
            dual_residual=float(np.abs(slope).max()),
            **watch.took(),
        )


def _violation(call: Call, v, g) -> float:
    """Return the largest violation of a bound, a constraint or the dynamics, in solver units."""
    beyond = np.concatenate([call.lbx - v, v - call.ubx, call.lbg - g, g - call.ubg])
    return float(np.maximum(beyond.max(), 0.0))  # not max(): it would take NaN for 0


def _refusal(guess, message, watch):
    return Solution(
        plan=guess,
        cost=math.nan,
        status=FAILED,
        message=message,
        iterations=0,
        primal_residual=math.inf,
        dual_residual=math.inf,
        **watch.took(),
    )
