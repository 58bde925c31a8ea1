"""Problems for the generated solver; what it compiles is kept for the session."""

from typing import NamedTuple

import casadi as ca
import numpy as np
import pytest

from mpcc_controller.solvers import riccati_solver, shooting, solver
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


@pytest.fixture(scope='session', autouse=True)
def cache(tmp_path_factory):
    with pytest.MonkeyPatch.context() as patch:
        folder = tmp_path_factory.mktemp('cache')
        patch.setenv('MPCC_CACHE_DIR', str(folder))
        yield folder


@pytest.fixture(scope='session')
def options():
    def make(name='riccati', **changes):
        standard = {'max_iterations': 200, 'tolerance': 1e-8, 'time_limit_s': None}
        return SolverOptions(name, **(standard | {'compiled': False} | changes))

    return make


@pytest.fixture(scope='session')
def riccati(options):
    """Return a solver of a problem; whatever is passed goes to its options."""

    def make(problem, **changes):
        library = riccati_solver.shared_library(problem)
        return riccati_solver.RiccatiSolver(problem, options(**changes), library)

    return make


@pytest.fixture(scope='session')
def ipopt(options):
    def make(problem, **changes):
        return solver.make(problem, options('ipopt', **changes))

    return make


def unbounded(problem):
    N, nx, nu = problem.horizon, problem.nx, problem.nu
    shapes = [(N + 1, nx)] * 2 + [(N, nu)] * 2 + [(N, problem.ng)] * 2 + [(problem.nh,)] * 2
    return Bounds(*(np.full(s, np.inf if i % 2 else -np.inf) for i, s in enumerate(shapes)))


MATRICES = {
    'A': np.array([[1.0, 0.3, 0.0], [-0.2, 0.9, 0.4], [0.1, 0.0, 1.1]]),
    'B': np.array([[0.0, 0.5], [1.0, 0.0], [0.2, -0.3]]),
    'Q': np.diag([1.0, 2.0, 0.5]),
    'R': np.diag([0.3, 0.7]),
    'Q_end': np.diag([4.0, 4.0, 9.0]),
}


@pytest.fixture(scope='session')
def linear_quadratic():
    """x' = A x + B u, cost x'Qx + u'Ru; no parameter, no bound, no constraint."""

    def make(horizon):
        A, B, Q, R, Q_end = map(ca.DM, MATRICES.values())
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
            constraints=ca.Function('g', [x, u, p], [ca.SX(0, 1)]),
            terminal_constraints=ca.Function('h', [x, p], [ca.SX(0, 1)]),
            scale_x=(2.0, 1.0, 0.5),
            scale_u=(1.0, 3.0),
        )
        guess = Plan(np.zeros((horizon + 1, 3)), np.zeros((horizon, 2)))
        x0 = np.array([1.0, -2.0, 0.5])
        return Case(problem, x0, np.zeros((horizon + 1, 0)), unbounded(problem), guess)

    return make


@pytest.fixture(scope='session')
def slalom():
    """A car-like point past a disc, with every kind of limit active somewhere.

    Lateral acceleration v turn is limited, the speed is bounded, the end must lie on a line; the
    disc also repels by a cost that is concave near it.
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
    wanted = Y**2 + psi**2 + 0.2 * (v - v_wanted) ** 2 + 4 * ca.exp(-away)
    problem = StageProblem(
        name='slalom',
        states=('X', 'Y', 'psi', 'v'),
        inputs=('push', 'turn'),
        parameters=('X_disc', 'Y_disc', 'r_disc', 'v_wanted'),
        horizon=30,
        dynamics=ca.Function('F', [x, u, p], [shooting.rk2(rates, 0.1)(x, u, p)]),
        stage_cost=ca.Function('l', [x, u, p], [wanted + 0.1 * push**2 + turn**2]),
        terminal_cost=ca.Function('m', [x, p], [5 * wanted]),
        constraints=ca.Function('g', [x, u, p], [ca.vertcat(away - r_disc**2, v * turn)]),
        terminal_constraints=ca.Function('h', [x, p], [Y]),
        scale_x=(10.0, 1.0, 0.5, 5.0),
        scale_u=(2.0, 1.0),
    )
    bounds = unbounded(problem)._replace(
        x_high=np.tile([np.inf, np.inf, np.inf, 5.6], (31, 1)),
        u_low=np.tile([-3.0, -2.0], (30, 1)),
        u_high=np.tile([0.8, 2.0], (30, 1)),
        g_low=np.tile([0.0, -3.0], (30, 1)),
        g_high=np.tile([np.inf, 3.0], (30, 1)),
        h_low=np.array([0.1]),
        h_high=np.array([0.2]),
    )
    along = 0.5 * np.arange(31)
    beside = 1.5 * np.exp(-(((along - 8.0) / 3) ** 2))  # the guess says on which side to pass
    guess = Plan(
        np.column_stack([along, beside, np.zeros(31), np.full(31, 5.0)]), np.zeros((30, 2))
    )
    P = np.tile([8.0, -0.3, 1.5, 6.0], (31, 1))
    return Case(problem, np.array([0.0, 0.0, 0.0, 5.0]), P, bounds, guess)
