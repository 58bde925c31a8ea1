"""Problems for the generated solver."""

import numpy as np
import pytest
import small_problems

from stage_solver import riccati_solver
from stage_solver.solution import SolverOptions
from stage_solver.solver import make_solver


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
        library = riccati_solver.compile_solver(problem)
        return riccati_solver.RiccatiSolver(problem, options(**changes), library)

    return make


@pytest.fixture(scope='session')
def ipopt(options):
    def make(problem, **changes):
        return make_solver(problem, options('ipopt', **changes))

    return make


MATRICES = {
    'A': np.array([[1.0, 0.3, 0.0], [-0.2, 0.9, 0.4], [0.1, 0.0, 1.1]]),
    'B': np.array([[0.0, 0.5], [1.0, 0.0], [0.2, -0.3]]),
    'Q': np.diag([1.0, 2.0, 0.5]),
    'R': np.diag([0.3, 0.7]),
    'Q_end': np.diag([4.0, 4.0, 9.0]),
}


@pytest.fixture(scope='session')
def linear_quadratic():
    def make(horizon):
        return small_problems.linear_quadratic(MATRICES, horizon, (2.0, 1.0, 0.5), (1.0, 3.0))

    return make


@pytest.fixture(scope='session')
def slalom():
    """The slalom with every kind of limit active somewhere; the disc also repels."""
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
