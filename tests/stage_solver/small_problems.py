"""Small optimal control problems, the numbers they are solved for, and solvers of them."""

from functools import cache
from typing import NamedTuple

import casadi as ca
import numpy as np
import pytest

from stage_solver import (
    Bounds,
    Plan,
    SolverOptions,
    StageProblem,
    make_solver,
    no_bounds,
    rk2,
    zero_plan,
)
from stage_solver.reference_solvers import ReferenceSolver

each_solver = pytest.mark.parametrize('name', ['riccati', 'fatrop', 'ipopt'])


class Case(NamedTuple):
    """A problem with the arguments of one solve."""

    problem: StageProblem
    x0: np.ndarray
    P: np.ndarray
    bounds: Bounds
    guess: Plan

    def solve(self, name='riccati', **options):
        """Return the solution by a new solver of that name, see `make`."""
        return make(name, self.problem, **options).solve(*self.numbers)

    @property
    def numbers(self):
        return self.x0, self.P, self.bounds, self.guess


def make(name, problem, **options):
    """Return a new solver: ours, 'riccati', or a reference; options as in SolverOptions."""
    options = SolverOptions(**({'max_iterations': 200, 'tolerance': 1e-8} | options))
    if name == 'riccati':
        return make_solver(problem, options)
    return ReferenceSolver(problem, name, options)


# of the parameters of a linear stage: dynamics, costs, constraints
SIZES = {'A': (3, 3), 'B': (3, 2), 'c': (3, 1), 'Q': (3, 1), 'R': (2, 1), 'G': (2, 5)}


@cache
def linear(horizon):
    """x' = A x + B u + c, cost x'Qx + u'Ru, constraints G [x; u]; all numbers are parameters."""
    x, u = ca.SX.sym('x', 3), ca.SX.sym('u', 2)
    matrices = {name: ca.SX.sym(name, *size) for name, size in SIZES.items()}
    A, B, c, Q, R, G = matrices.values()
    p = ca.vertcat(*map(ca.vec, matrices.values()))
    return StageProblem(
        name='linear',
        states=('a', 'b', 'c'),
        inputs=('d', 'e'),
        parameters=tuple(map(str, ca.vertsplit(p))),
        horizon=horizon,
        dynamics=ca.Function('F', [x, u, p], [A @ x + B @ u + c]),
        stage_cost=ca.Function('l', [x, u, p], [ca.dot(Q, x**2) + ca.dot(R, u**2)]),
        terminal_cost=ca.Function('m', [x, p], [10 * ca.dot(Q, x**2)]),
        constraints=ca.Function('g', [x, u, p], [G @ ca.vertcat(x, u)]),
        terminal_constraints=ca.Function('h', [x, p], [x[0] - x[1]]),
        scale_x=(2.0, 1.0, 0.5),
        scale_u=(1.0, 3.0),
    )


def random_linear(horizon, seed):
    """Return a linear case without limits, and its matrices (N + 1, rows, columns) by name."""
    rng = np.random.default_rng(seed)
    m = {name: rng.normal(0.0, 0.4, (horizon + 1, *size)) for name, size in SIZES.items()}
    m['A'] += 0.7 * np.eye(3)
    m |= {name: rng.uniform(0.2, 2.0, m[name].shape) for name in 'QR'}
    P = np.hstack([matrix.transpose(0, 2, 1).reshape(horizon + 1, -1) for matrix in m.values()])
    problem = linear(horizon)
    x0 = rng.normal(0.0, 2.0, 3)
    return Case(problem, x0, P, no_bounds(problem), zero_plan(problem)), m


def least_squares(case, matrices):
    """Return M and b of the cost |M u - b|^2 of all inputs; the dynamics are eliminated."""
    A, B, c, Q, R, _ = matrices.values()

    def residuals(u):
        x, parts = case.x0, []
        for k, u_k in enumerate(u.reshape(-1, 2)):
            parts += [np.sqrt(Q[k, :, 0]) * x, np.sqrt(R[k, :, 0]) * u_k]
            x = A[k] @ x + B[k] @ u_k + c[k, :, 0]
        return np.concatenate([*parts, np.sqrt(10 * Q[-1, :, 0]) * x])

    n = 2 * case.problem.horizon
    at_zero = residuals(np.zeros(n))
    return np.column_stack([residuals(e) - at_zero for e in np.eye(n)]), -at_zero


def limited(case, seed):
    """Return the case with random limits of every kind around a drive that obeys all of them."""
    rng, N = np.random.default_rng(seed), case.problem.horizon
    U, X = rng.normal(0.0, 0.5, (N, 2)), [case.x0]
    for u, p in zip(U, case.P):
        X.append(case.problem.dynamics(X[-1], u, p).full().ravel())
    X = np.array(X)
    g = case.problem.constraints.map(N)(X[:-1].T, U.T, case.P[:-1].T).full().T
    h = case.problem.terminal_constraints(X[-1], case.P[-1]).full().ravel()
    limits = {}
    for name, values in {'x': X, 'u': U, 'g': g, 'h': h}.items():
        for end, sign in (('low', -1), ('high', 1)):
            room = rng.exponential(1.0, values.shape) + 0.05
            room[rng.random(values.shape) < 0.3] = np.inf
            limits[f'{name}_{end}'] = values + sign * room
    return case._replace(bounds=Bounds(**limits))


@cache
def slalom():
    """A unicycle on its way along X past a disc, with every kind of limit active somewhere.

    The cost repels from the disc and is not convex there; the guess says on which side to pass.
    """
    x, u, p = ca.SX.sym('x', 4), ca.SX.sym('u', 2), ca.SX.sym('p', 4)
    X, Y, psi, v = ca.vertsplit(x)
    push, turn = ca.vertsplit(u)
    X_disc, Y_disc, r_disc, v_wanted = ca.vertsplit(p)

    def rates(x, u, p):
        return ca.vertcat(
            x[3] * ca.cos(x[2]), x[3] * ca.sin(x[2]), u[1], u[0] - 0.02 * x[3] * ca.fabs(x[3])
        )

    away = (X - X_disc) ** 2 + (Y - Y_disc) ** 2
    wanted = Y**2 + psi**2 + 0.2 * (v - v_wanted) ** 2 + 4.0 * ca.exp(-away)
    problem = StageProblem(
        name='slalom',
        states=('X', 'Y', 'psi', 'v'),
        inputs=('push', 'turn'),
        parameters=('X_disc', 'Y_disc', 'r_disc', 'v_wanted'),
        horizon=30,
        dynamics=ca.Function('F', [x, u, p], [rk2(rates, 0.1)(x, u, p)]),
        stage_cost=ca.Function('l', [x, u, p], [wanted + 0.1 * push**2 + turn**2]),
        terminal_cost=ca.Function('m', [x, p], [5 * wanted]),
        constraints=ca.Function('g', [x, u, p], [ca.vertcat(away - r_disc**2, v * turn)]),
        terminal_constraints=ca.Function('h', [x, p], [Y]),
        scale_x=(10.0, 1.0, 0.5, 5.0),
        scale_u=(2.0, 1.0),
    )
    bounds = no_bounds(problem)._replace(
        x_high=np.tile([np.inf, np.inf, np.inf, 5.6], (31, 1)),
        u_low=np.tile([-3.0, -2.0], (30, 1)),
        u_high=np.tile([0.8, 2.0], (30, 1)),
        g_low=np.tile([0.0, -3.0], (30, 1)),
        g_high=np.tile([np.inf, 3.0], (30, 1)),
        h_low=np.array([0.1]),
        h_high=np.array([0.2]),
    )
    along = 0.5 * np.arange(31)
    beside = 1.5 * np.exp(-(((along - 8.0) / 3) ** 2))
    guess = np.column_stack([along, beside, np.zeros(31), np.full(31, 5.0)])
    return Case(
        problem,
        x0=np.array([0.0, 0.0, 0.0, 5.0]),
        P=np.tile([8.0, -0.3, 1.5, 6.0], (31, 1)),
        bounds=bounds,
        guess=Plan(guess, np.zeros((30, 2))),
    )


def double_integrator(cost, name='double_integrator'):
    """Return a mass to be pushed to 1 m, with an added cost of its state; no limit or parameter."""
    x, u, p = ca.SX.sym('x', 2), ca.SX.sym('u', 1), ca.SX.sym('p', 0)
    problem = StageProblem(
        name=name,
        states=('s', 'v'),
        inputs=('a',),
        parameters=(),
        horizon=10,
        dynamics=ca.Function('F', [x, u, p], [ca.vertcat(x[0] + 0.1 * x[1], x[1] + 0.1 * u)]),
        stage_cost=ca.Function('l', [x, u, p], [(x[0] - 1) ** 2 + ca.sumsqr(u) + cost(x)]),
    )
    return Case(problem, np.zeros(2), np.zeros((11, 0)), no_bounds(problem), zero_plan(problem))


def growing(x0):
    """Return one state, to be kept within 1, whose cube drives it away; no terminal constraint."""
    x, u, p = (ca.SX.sym(*size) for size in (('x', 1), ('u', 1), ('p', 0)))
    problem = StageProblem(
        name='growing',
        states=('x',),
        inputs=('u',),
        parameters=(),
        horizon=12,
        dynamics=ca.Function('F', [x, u, p], [x + x**3 + u]),
        stage_cost=ca.Function('l', [x, u, p], [x**2 + u**2]),
        constraints=ca.Function('g', [x, u, p], [x]),
    )
    ones = np.ones((12, 1))
    bounds = no_bounds(problem)._replace(g_low=-ones, g_high=ones)
    return Case(problem, np.array([x0]), np.zeros((13, 0)), bounds, zero_plan(problem))


def aligned(*shape):
    """Return an array of 0.5 that begins where the widest vector may."""
    memory = np.full(np.prod(shape) + 8, 0.5)
    start = (-memory.ctypes.data % 64) // 8
    return memory[start : start + np.prod(shape)].reshape(shape)
