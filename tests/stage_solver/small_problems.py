"""Small optimal control problems, and the numbers they are solved for."""

from typing import NamedTuple

import casadi as ca
import numpy as np
import pytest

from stage_solver import Bounds, Plan, StageProblem, no_bounds, rk2, zero_plan

each_solver = pytest.mark.parametrize('name', ['riccati', 'fatrop', 'ipopt'])


class Case(NamedTuple):
    """A problem with the arguments of one solve."""

    problem: StageProblem
    x0: np.ndarray
    P: np.ndarray
    bounds: Bounds
    guess: Plan

    @property
    def numbers(self):
        return self.x0, self.P, self.bounds, self.guess


def linear_quadratic(matrices, horizon, scale_x, scale_u):
    """x' = A x + B u, cost x'Qx + u'Ru; three states, two inputs, no parameter, no constraint.

    `matrices` are A, B, Q, R and the Q of the end, in this order.
    """
    A, B, Q, R, Q_end = map(ca.DM, matrices.values())
    x, u, p = ca.SX.sym('x', 3), ca.SX.sym('u', 2), ca.SX.sym('p', 0)
    problem = StageProblem(
        name='linear_quadratic',
        states=('a', 'b', 'c'),
        inputs=('d', 'e'),
        parameters=(),
        horizon=horizon,
        dynamics=ca.Function('F', [x, u, p], [A @ x + B @ u]),
        stage_cost=ca.Function('l', [x, u, p], [ca.bilin(Q, x, x) + ca.bilin(R, u, u)]),
        terminal_cost=ca.Function('m', [x, p], [ca.bilin(Q_end, x, x)]),
        scale_x=scale_x,
        scale_u=scale_u,
    )
    x0 = np.array([1.0, -2.0, 0.5])
    return Case(problem, x0, np.zeros((horizon + 1, 0)), no_bounds(problem), zero_plan(problem))


def slalom(repulsion=0.0, **limits):
    """A unicycle on its way along X past a disc; lateral acceleration limited, end on a line.

    With a repulsion the cost is not convex near the disc. `limits` are fields of Bounds.
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
    wanted = Y**2 + psi**2 + 0.2 * (v - v_wanted) ** 2 + repulsion * ca.exp(-away)
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
    along = 0.5 * np.arange(31)
    beside = 1.5 * np.exp(-(((along - 8.0) / 3) ** 2))  # the guess says on which side to pass
    guess = np.column_stack([along, beside, np.zeros(31), np.full(31, 5.0)])
    return Case(
        problem,
        x0=np.array([0.0, 0.0, 0.0, 5.0]),
        P=np.tile([8.0, -0.3, 1.5, 6.0], (31, 1)),
        bounds=no_bounds(problem)._replace(**limits),
        guess=Plan(guess, np.zeros((30, 2))),
    )


def without_parameters():
    """Return a double integrator that has no parameters, no constraints and no terminal cost."""
    x, u, p = ca.SX.sym('x', 2), ca.SX.sym('u', 1), ca.SX.sym('p', 0)
    return StageProblem(
        name='double_integrator',
        states=('position', 'speed'),
        inputs=('force',),
        parameters=(),
        horizon=5,
        dynamics=ca.Function('F', [x, u, p], [ca.vertcat(x[0] + x[1], x[1] + u[0])]),
        stage_cost=ca.Function('l', [x, u, p], [u[0] ** 2]),
    )
