"""Solves that are stopped by a limit or cannot succeed: status, residuals, no output."""

import numpy as np
import pytest
from small_problems import each_solver

from stage_solver.solution import FAILED, SOLVED, STOPPED_EARLY


@each_solver
def test_the_iteration_limit_returns_the_iterate_with_its_residuals(name, slalom, solver):
    early = solver(name, slalom.problem, max_iterations=3).solve(*slalom.numbers)
    assert (early.status, early.message) == (STOPPED_EARLY, 'iteration limit')
    assert early.iterations == 3
    X, U = early.plan.X, early.plan.U
    scale = np.array(slalom.problem.scale_x)
    dynamics = slalom.problem.dynamics.map(30)
    defects = np.abs(dynamics(X[:-1].T, U.T, slalom.P[:-1].T).full().T - X[1:]) / scale
    g = slalom.problem.constraints.map(30)(X[:-1].T, U.T, slalom.P[:-1].T).full().T
    beyond_g = max((slalom.bounds.g_low - g).max(), (g - slalom.bounds.g_high).max())
    beyond_u = max((slalom.bounds.u_low - U).max(), (U - slalom.bounds.u_high).max())
    worst = max(defects.max(), beyond_g, beyond_u, abs(X[-1, 1]) - 0.05)
    assert early.primal_residual == pytest.approx(worst, abs=1e-9)
    assert early.dual_residual > 1e-3


@each_solver
def test_options_survive_limits_that_come_and_go(name, slalom, solver):
    free = slalom.bounds._replace(h_low=np.array([-np.inf]), h_high=np.array([np.inf]))
    for bounds in (free, slalom.bounds):
        used = solver(name, slalom.problem, tolerance=1e-3)
        for earlier in (slalom.bounds, free):
            early = used.solve(slalom.x0, slalom.P, earlier, slalom.guess)
            assert early.status == SOLVED
        late = used.solve(slalom.x0, slalom.P, bounds, slalom.guess)
        new = solver(name, slalom.problem, tolerance=1e-3).solve(
            slalom.x0, slalom.P, bounds, slalom.guess
        )
        assert late.iterations == new.iterations
        assert np.array_equal(late.plan.X, new.plan.X)


def unreachable(case):
    """Return bounds with a final position that the force cannot reach."""
    x_low = case.bounds.x_low.copy()
    x_low[-1, 0] = 100.0
    return case.bounds._replace(x_low=x_low)


@each_solver
def test_an_infeasible_problem_is_a_failure_not_an_exception(name, double_integrator, solver):
    case = double_integrator
    own = solver(name, case.problem, tolerance=1e-8)
    solution = own.solve(case.x0, case.P, unreachable(case), case.guess)
    assert solution.status == FAILED
    assert solution.primal_residual > 1.0
    assert own.solve(*case.numbers).status == SOLVED


@each_solver
def test_solvers_print_nothing(name, slalom, double_integrator, solver, capfd):
    solver(name, slalom.problem).solve(*slalom.numbers)
    case = double_integrator
    solver(name, case.problem).solve(case.x0, case.P, unreachable(case), case.guess)
    assert capfd.readouterr() == ('', '')
