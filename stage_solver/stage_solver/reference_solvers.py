"""fatrop and IPOPT through CasADi: the references of tests and benchmarks, never part of a drive.

They solve the NLP of the whole horizon: the variables v = [x_0; u_0; x_1; ...; x_N] and constraints
[x_1 - F_0; g_0; x_2 - F_1; ...; h] are in the order of fatrop (Vanroye et al. 2023,
https://arxiv.org/abs/2303.16746); IPOPT is by Waechter & Biegler (2006). Neither has a time limit
here, and fatrop may raise its inertia correction without end where derivatives are extreme.
"""

import gc
import itertools
import math
import time
from collections.abc import Mapping, Sequence

import casadi as ca
import numpy as np

from stage_solver import riccati_codegen, stage_problem
from stage_solver.compiled_functions import FLAGS, BufferedFunction, compile_functions
from stage_solver.solution import FAILED, SOLVED, STOPPED_EARLY, Solution, SolverOptions, stopwatch
from stage_solver.stage_problem import Bounds, Multipliers, Plan, StageProblem

NAMES = ('fatrop', 'ipopt')
LIMITED = ('Maximum_Iterations_Exceeded', 1)  # the iteration limit, as IPOPT and fatrop call it


class ReferenceSolver:
    """Solves as `solver.StageSolver` does, cold: it uses no multipliers of a guess."""

    def __init__(
        self,
        problem: StageProblem,
        name: str,
        options: SolverOptions,
        compiled: bool = False,
        flags: tuple[str, ...] = FLAGS,
    ):
        """`name` is one of NAMES; `flags` are those of the C compiler for functions `compiled`."""
        self.name, self._problem = name, problem
        self._scales = np.array(problem.scale_x), np.array(problem.scale_u)
        nlp, gradient, kkt = _nlp(problem)
        N, limit = problem.horizon, options.max_iterations
        settings = {'print_time': False, 'show_eval_warnings': False, 'calc_lam_p': False}
        if name == 'ipopt':
            settings['ipopt'] = {'print_level': 0, 'sb': 'yes', 'max_iter': limit}
            settings['ipopt']['tol'] = options.tolerance
        else:
            # fatrop tests the limit before it counts the step
            settings['fatrop'] = {'print_level': 0, 'max_iter': limit - 1}
            settings['fatrop']['tolerance'] = options.tolerance
            nx, nu, ng = [problem.nx] * (N + 1), [problem.nu] * N + [0], [problem.ng] * N
            sizes = {'N': N, 'nx': nx, 'nu': nu, 'ng': [*ng, problem.nh]}
            settings |= {'structure_detection': 'manual', **sizes, 'cache': gradient}
        self._nlpsol = ca.nlpsol('nlp', name, nlp, settings)
        if compiled:
            # CasADi derives no function that its cache has under the same name
            derived = {key: self._nlpsol.get_function(key) for key in self._nlpsol.get_function()}
            derived = compile_functions(derived, f'{problem.name}_{name}', flags)
            self._nlpsol = ca.nlpsol('nlp', name, nlp, settings | {'cache': derived})
        self._kkt, self._pattern = kkt, None

    def solve(self, x0: np.ndarray, P: np.ndarray, bounds: Bounds, guess: Plan) -> Solution:
        """Return the solution; the arguments are those of `StageSolver.solve`."""
        times = stopwatch()
        stage_problem.check_shapes(self._problem, x0, P, bounds, guess)
        guess = Plan(np.vstack([x0, guess.X[1:]]), np.asarray(guess.U))
        message = stage_problem.find_invalid_argument(self._problem, x0, P, bounds, guess)
        start = self._pack(guess.X, guess.U)
        f, g, _ = self._kkt(start, P.ravel(), np.zeros(self._kkt.numel_in(2)))
        if not message and not (np.isfinite(float(f)) and np.isfinite(g.full()).all()):
            message = 'a function of the problem is not finite at the guess'
        if message:
            return Solution(guess, math.nan, FAILED, message, 0, math.inf, math.inf, **times())
        fixed = np.zeros((self._problem.horizon, self._problem.nx))
        lbg, ubg = (
            np.concatenate([np.hstack([fixed, limits]).ravel(), last])
            for limits, last in ((bounds.g_low, bounds.h_low), (bounds.g_high, bounds.h_high))
        )
        lbx = self._pack(np.vstack([x0, bounds.x_low[1:]]), bounds.u_low)
        ubx = self._pack(np.vstack([x0, bounds.x_high[1:]]), bounds.u_high)
        # with other limits CasADi makes a new fatrop, without its options: a new memory has them
        low, high = np.append(lbx, lbg), np.append(ubx, ubg)
        pattern = np.array([low == high, np.isinf(low), np.isinf(high)])
        if not np.array_equal(pattern, self._pattern):
            self._call = BufferedFunction(self._nlpsol)
        self._pattern = pattern
        results = self._call(x0=start, p=P.ravel(), lbx=lbx, ubx=ubx, lbg=lbg, ubg=ubg)
        stats = self._call.stats()
        reason = stats['return_status'] if self.name == 'ipopt' else stats['fatrop']['return_flag']
        v, lam_v, lam_g = results['x'].copy(), results['lam_x'].copy(), results['lam_g'].copy()
        f, g, slope = (value.full().ravel() for value in self._kkt(v, P.ravel(), lam_g))
        violation = np.concatenate([lbx - v, v - ubx, lbg - g, g - ubg]).max()
        status = STOPPED_EARLY if reason in LIMITED else FAILED
        return Solution(
            plan=Plan(*self._unpack(v, *self._scales), self._multipliers(lam_v, lam_g)),
            cost=float(f[0]),
            status=SOLVED if stats['success'] else status,
            message='iteration limit' if reason in LIMITED else str(reason),
            iterations=stats['iter_count'],
            primal_residual=float(np.maximum(violation, 0.0)),  # not max(): it takes NaN for 0
            # the first state is fixed: the gradient with respect to it has no meaning
            dual_residual=float(np.max(np.abs((slope + lam_v)[self._problem.nx :]))),
            **times(),
        )

    def _pack(self, X, U):
        scale_x, scale_u = self._scales
        return np.append(np.hstack([X[:-1] / scale_x, U / scale_u]).ravel(), X[-1] / scale_x)

    def _unpack(self, v, scale_x, scale_u):
        nx = self._problem.nx
        W = v[:-nx].reshape(self._problem.horizon, -1)
        return np.vstack([W[:, :nx], v[-nx:]]) * scale_x, W[:, nx:] * scale_u

    def _multipliers(self, lam_v, lam_g):
        nx, end = self._problem.nx, len(lam_g) - self._problem.nh
        dynamics, g = np.hsplit(lam_g[:end].reshape(self._problem.horizon, -1), [nx])
        scale_x, scale_u = self._scales
        x, u = self._unpack(lam_v, 1 / scale_x, 1 / scale_u)
        return Multipliers(x, u, dynamics / scale_x, g, lam_g[end:])


def solve_in_turn(
    solvers: Mapping[str, object], arguments: Mapping[str, Sequence[tuple]], passes: int
) -> tuple[dict[str, list[Solution]], dict[str, np.ndarray]]:
    """Solve the n tasks of every solver `passes` times, all by their labels.

    Returns the solutions of the last pass and the wall times [s], (passes, n), around the calls.
    The solvers take turns, task by task: a busy machine slows all of them alike, and none always
    follows the same one, with the processor's caches of that.
    """
    count, order = len(next(iter(arguments.values()))), list(solvers)
    seconds = {label: np.zeros((passes, count)) for label in solvers}
    solutions = {label: [None] * count for label in solvers}
    gc.collect()
    gc.disable()  # no collection within a measured call
    try:
        for a_pass, i in itertools.product(range(passes), range(count)):
            order = order[1:] + order[:1]
            for label in order:
                began = time.perf_counter()
                solutions[label][i] = solvers[label].solve(*arguments[label][i])
                seconds[label][a_pass, i] = time.perf_counter() - began
    finally:
        gc.enable()
    return solutions, seconds


def _nlp(problem):
    """Return the NLP, its gradient for fatrop, and (v, p, lam_g) -> f, g, slope of f + lam_g' g."""
    N, nx, nw = problem.horizon, problem.nx, problem.nx + problem.nu
    w, q = ca.SX.sym('w', nw), ca.SX.sym('p', problem.np)
    stage = riccati_codegen.evaluate_stage(problem, w[:nx], w[nx:], q)
    end = riccati_codegen.evaluate_last_stage(problem, w[:nx], q)
    v, p = ca.MX.sym('v', N * nw + nx), ca.MX.sym('p', (N + 1) * problem.np)
    W, P = ca.reshape(v[: N * nw], nw, N), ca.reshape(p, problem.np, N + 1)
    X_next, costs, G = ca.Function('stage', [w, q], stage).map(N)(W, P[:, :N])
    cost, h = ca.Function('end', [w[:nx], q], end)(v[N * nw :], P[:, N])
    gaps = ca.horzcat(W[:nx, 1:], v[N * nw :]) - X_next
    f, g = ca.sum2(costs) + cost, ca.vertcat(ca.vec(ca.vertcat(gaps, G)), h)
    lam_g = ca.MX.sym('lam_g', g.numel())
    # nlpsol leaves entries that the gradient does not have uninitialised
    dense = ca.Function(
        'nlp_grad_f', [v, p], [ca.densify(ca.gradient(f, v))], ['x', 'p'], ['grad_f_x']
    )
    kkt = ca.Function('kkt', [v, p, lam_g], [f, g, ca.gradient(f + ca.dot(lam_g, g), v)])
    return {'x': v, 'p': p, 'f': f, 'g': g}, {'nlp_grad_f': dense}, kkt
