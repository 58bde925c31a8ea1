"""Small optimal control problems whose solutions are known from elsewhere, and numbers for them."""

from typing import NamedTuple

import casadi as ca
import numpy as np
import pytest

from mpcc_controller.solvers import shooting
from mpcc_controller.solvers.shooting import Bounds, Plan, StageProblem
from mpcc_controller.solvers.solver import SolverOptions


class Case(NamedTuple):
    problem: StageProblem
    x0: np.ndarray
    P: np.ndarray
    bounds: Bounds
    guess: Plan

    @property
    def numbers(self):
        return self.x0, self.P, self.bounds, self.guess


def unbounded(problem):
    N, nx, nu = problem.horizon, problem.nx, problem.nu
    shapes = [(N + 1, nx)] * 2 + [(N, nu)] * 2 + [(N, problem.ng)] * 2 + [(problem.nh,)] * 2
    return Bounds(*(np.full(s, np.inf if i % 2 else -np.inf) for i, s in enumerate(shapes)))


def resting(problem):
    N = problem.horizon
    return Plan(np.zeros((N + 1, problem.nx)), np.zeros((N, problem.nu)))


@pytest.fixture
def options():
    def make(name, **changes):
        standard = {'max_iterations': 200, 'tolerance': 1e-10, 'time_limit_s': None}
        return SolverOptions(name, **(standard | {'compiled': False} | changes))

    return make


@pytest.fixture(autouse=True)
def own_cache(tmp_path, monkeypatch):
    monkeypatch.setenv('MPCC_CACHE_DIR', str(tmp_path / 'cache'))
    return tmp_path / 'cache'


@pytest.fixture
def linear_quadratic():
    """Three states, two inputs, no parameter, no constraint: x' = A x + B u, x'Qx + u'Ru."""

    def make(scale_x=(1.0, 1.0, 1.0), scale_u=(1.0, 1.0)):
        rng = np.random.default_rng(3)
        matrices = {
            'A': np.eye(3) + 0.2 * rng.standard_normal((3, 3)),
            'B': rng.standard_normal((3, 2)),
            'Q': np.diag([1.0, 2.0, 0.5]),
            'R': np.diag([0.3, 0.7]),
            'Q_end': 4 * np.eye(3),
        }
        A, B, Q, R, Q_end = map(ca.DM, matrices.values())
        x, u, p = ca.SX.sym('x', 3), ca.SX.sym('u', 2), ca.SX.sym('p', 0)
        problem = StageProblem(
            name='linear_quadratic',
            states=('a', 'b', 'c'),
            inputs=('d', 'e'),
            parameters=(),
            horizon=20,
            dynamics=ca.Function('F', [x, u, p], [A @ x + B @ u]),
            stage_cost=ca.Function('l', [x, u, p], [ca.bilin(Q, x, x) + ca.bilin(R, u, u)]),
            terminal_cost=ca.Function('m', [x, p], [ca.bilin(Q_end, x, x)]),
            constraints=ca.Function('g', [x, u, p], [ca.SX(0, 1)]),
            terminal_constraints=ca.Function('h', [x, p], [ca.SX(0, 1)]),
            scale_x=scale_x,
            scale_u=scale_u,
        )
        x0 = np.array([1.0, -2.0, 0.5])
        P = np.zeros((21, 0))
        return Case(problem, x0, P, unbounded(problem), resting(problem)), matrices

    return make


@pytest.fixture
def double_integrator():
    """A mass pushed to the origin: position, speed; one bounded force."""
    dt = 0.2
    x, u, p = ca.SX.sym('x', 2), ca.SX.sym('u'), ca.SX.sym('p', 1)
    step = ca.vertcat(x[0] + dt * x[1] + dt**2 / 2 * u, x[1] + dt * u)
    problem = StageProblem(
        name='double_integrator',
        states=('position', 'speed'),
        inputs=('force',),
        parameters=('weight',),
        horizon=15,
        dynamics=ca.Function('F', [x, u, p], [step]),
        stage_cost=ca.Function('l', [x, u, p], [ca.sumsqr(x) + p * u**2]),
        terminal_cost=ca.Function('m', [x, p], [10 * ca.sumsqr(x)]),
        constraints=ca.Function('g', [x, u, p], [ca.SX(0, 1)]),
        terminal_constraints=ca.Function('h', [x, p], [ca.SX(0, 1)]),
        scale_x=(1.0, 2.0),
        scale_u=(5.0,),
    )
    bounds = unbounded(problem)._replace(u_low=np.full((15, 1), -1.0), u_high=np.full((15, 1), 0.7))
    return Case(problem, np.array([3.0, 1.0]), np.full((16, 1), 0.1), bounds, resting(problem))


@pytest.fixture
def slalom():
    """A unicycle on its way along X past a disc; lateral acceleration limited, end on a line."""
    x, u, p = ca.SX.sym('x', 4), ca.SX.sym('u', 2), ca.SX.sym('p', 4)
    X, Y, psi, v = ca.vertsplit(x)
    push, turn = ca.vertsplit(u)
    X_disc, Y_disc, r_disc, v_wanted = ca.vertsplit(p)

    def rates(x, u, p):
        return ca.vertcat(
            x[3] * ca.cos(x[2]), x[3] * ca.sin(x[2]), u[1], u[0] - 0.02 * x[3] * ca.fabs(x[3])
        )

    wanted = Y**2 + ca.sumsqr(psi) + 0.2 * (v - v_wanted) ** 2
    gap = (X - X_disc) ** 2 + (Y - Y_disc) ** 2 - r_disc**2
    problem = StageProblem(
        name='slalom',
        states=('X', 'Y', 'psi', 'v'),
        inputs=('push', 'turn'),
        parameters=('X_disc', 'Y_disc', 'r_disc', 'v_wanted'),
        horizon=30,
        dynamics=ca.Function('F', [x, u, p], [shooting.rk2(rates, 0.1)(x, u, p)]),
        stage_cost=ca.Function('l', [x, u, p], [wanted + 0.1 * push**2 + turn**2]),
        terminal_cost=ca.Function('m', [x, p], [5 * wanted]),
        constraints=ca.Function('g', [x, u, p], [ca.vertcat(gap, v * turn)]),
        terminal_constraints=ca.Function('h', [x, p], [Y]),
        scale_x=(10.0, 1.0, 0.5, 5.0),
        scale_u=(2.0, 1.0),
    )
    bounds = unbounded(problem)._replace(
        u_low=np.tile([-3.0, -2.0], (30, 1)),
        u_high=np.tile([2.0, 2.0], (30, 1)),
        g_low=np.tile([0.0, -4.0], (30, 1)),
        g_high=np.tile([np.inf, 4.0], (30, 1)),
        h_low=np.array([-0.05]),
        h_high=np.array([0.05]),
    )
    P = np.tile([8.0, -0.3, 1.5, 6.0], (31, 1))
    x0 = np.array([0.0, 0.0, 0.0, 5.0])
    along = 0.5 * np.arange(31)
    beside = 1.5 * np.exp(-(((along - 8.0) / 3) ** 2))  # which side is the guess's choice
    guess = np.column_stack([along, beside, np.zeros(31), np.full(31, 5.0)])
    return Case(problem, x0, P, bounds, Plan(guess, np.zeros((30, 2))))
