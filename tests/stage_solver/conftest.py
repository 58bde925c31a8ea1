"""Fixtures of small optimal control problems, solver options, and an empty compile cache."""

import casadi as ca
import numpy as np
import pytest
import small_problems
from small_problems import Case

from stage_solver import SolverOptions, StageProblem, make_solver, no_bounds, zero_plan
from stage_solver.reference_solvers import ReferenceSolver

SCALED_MATRICES = {
    'A': np.array([[1.0, 0.3, 0.0], [-0.2, 0.9, 0.4], [0.1, 0.0, 1.1]]),
    'B': np.array([[0.0, 0.5], [1.0, 0.0], [0.2, -0.3]]),
    'Q': np.diag([1.0, 2.0, 0.5]),
    'R': np.diag([0.3, 0.7]),
    'Q_end': np.diag([4.0, 4.0, 9.0]),
}


@pytest.fixture
def own_cache(tmp_path, monkeypatch):
    """Return an empty compile cache, for tests of what is compiled and when."""
    monkeypatch.setenv('MPCC_CACHE_DIR', str(tmp_path / 'cache'))
    return tmp_path / 'cache'


@pytest.fixture(scope='session')
def solver():
    """Return make(name, problem, **changes of the options): ours, 'riccati', or a reference."""

    def make(name, problem, **changes):
        options = SolverOptions(**({'max_iterations': 200, 'tolerance': 1e-10} | changes))
        if name == 'riccati':
            return make_solver(problem, options)
        return ReferenceSolver(problem, name, options)

    return make


@pytest.fixture
def linear_quadratic():
    """Return make(scale_x, scale_u) -> (case, its matrices)."""

    def make(scale_x=(1.0, 1.0, 1.0), scale_u=(1.0, 1.0)):
        rng = np.random.default_rng(3)
        matrices = {
            'A': np.eye(3) + 0.2 * rng.standard_normal((3, 3)),
            'B': rng.standard_normal((3, 2)),
            'Q': np.diag([1.0, 2.0, 0.5]),
            'R': np.diag([0.3, 0.7]),
            'Q_end': 4 * np.eye(3),
        }
        return small_problems.linear_quadratic(matrices, 20, scale_x, scale_u), matrices

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
        scale_x=(1.0, 2.0),
        scale_u=(5.0,),
    )
    bounds = no_bounds(problem)._replace(u_low=np.full((15, 1), -1.0), u_high=np.full((15, 1), 0.7))
    return Case(problem, np.array([3.0, 1.0]), np.full((16, 1), 0.1), bounds, zero_plan(problem))


@pytest.fixture
def slalom():
    return small_problems.slalom(
        u_low=np.tile([-3.0, -2.0], (30, 1)),
        u_high=np.tile([2.0, 2.0], (30, 1)),
        g_low=np.tile([0.0, -4.0], (30, 1)),
        g_high=np.tile([np.inf, 4.0], (30, 1)),
        h_low=np.array([-0.05]),
        h_high=np.array([0.05]),
    )


@pytest.fixture(scope='session')
def riccati(solver):
    """Return make(problem, **changes of the options) -> our solver, with a tolerance of 1e-8."""
    return lambda problem, **changes: solver('riccati', problem, **{'tolerance': 1e-8} | changes)


@pytest.fixture(scope='session')
def ipopt(solver):
    """Return make(problem, **changes of the options) -> IPOPT, with a tolerance of 1e-8."""
    return lambda problem, **changes: solver('ipopt', problem, **{'tolerance': 1e-8} | changes)


@pytest.fixture(scope='session')
def scaled_linear_quadratic():
    """Return make(horizon) -> a linear-quadratic case with scales other than 1."""

    def make(horizon):
        scales = (2.0, 1.0, 0.5), (1.0, 3.0)
        return small_problems.linear_quadratic(SCALED_MATRICES, horizon, *scales)

    return make


@pytest.fixture(scope='session')
def tight_slalom():
    """The slalom with every kind of limit active somewhere; the cost repels from the disc."""
    return small_problems.slalom(
        repulsion=4.0,
        x_high=np.tile([np.inf, np.inf, np.inf, 5.6], (31, 1)),
        u_low=np.tile([-3.0, -2.0], (30, 1)),
        u_high=np.tile([0.8, 2.0], (30, 1)),
        g_low=np.tile([0.0, -3.0], (30, 1)),
        g_high=np.tile([np.inf, 3.0], (30, 1)),
        h_low=np.array([0.1]),
        h_high=np.array([0.2]),
    )
