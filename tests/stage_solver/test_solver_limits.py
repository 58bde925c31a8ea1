"""Solves that are stopped by a limit or cannot succeed: status, residuals, no output."""

import numpy as np
import pytest
from small_problems import each_solver
from wait_until import wait_until

from stage_solver import fatrop
from stage_solver.solution import FAILED, SOLVED, STOPPED_EARLY
from stage_solver.solver import make_solver


@each_solver
def test_the_iteration_limit_returns_the_iterate_with_its_residuals(name, slalom, options):
    early = make_solver(slalom.problem, options(name, max_iterations=3)).solve(*slalom.numbers)
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


def stopped_in_the_middle(name, problem, numbers, options):
    """Return a solve that its time limit ended in the first half, and its limit; or None.

    The limit is a quarter of what the whole solve has just taken. It comes too late on a machine
    that is faster meanwhile.
    """
    whole = make_solver(problem, options(name)).solve(*numbers)
    limit_s = whole.solve_s / 4
    solution = make_solver(problem, options(name, time_limit_s=limit_s)).solve(*numbers)
    return (solution, limit_s) if solution.iterations < whole.iterations / 2 else None


def stopped_by_time(*case):
    """Return the solve and its limit, from the first try that is stopped in the middle."""
    return wait_until(lambda: stopped_in_the_middle(*case), 60.0, 'none ended in the middle')


@each_solver
def test_time_limit_ends_a_solve_in_the_middle(name, slalom, options):
    solution, limit_s = stopped_by_time(name, slalom.problem, slalom.numbers, options)
    assert (solution.status, solution.message) == (STOPPED_EARLY, 'time limit')
    assert solution.solve_s > limit_s
    assert np.isfinite(solution.plan.X).all()
    assert solution.dual_residual > 1e-6


def test_fatrop_is_as_good_as_new_after_every_missed_deadline(slalom, options):
    new = make_solver(slalom.problem, options('fatrop')).solve(*slalom.numbers)
    own = make_solver(slalom.problem, options('fatrop', time_limit_s=60.0))
    for _ in range(2 * fatrop.MAX_UNUSED_MEMORIES + 1):
        own._backend._limit_s = 0.0
        nothing = own.solve(*slalom.numbers)
        assert (nothing.message, nothing.iterations) == ('time limit', 0)
        assert np.allclose(nothing.plan.U, slalom.guess.U)
        own._backend._limit_s = 60.0
        again = own.solve(*slalom.numbers)
        assert np.array_equal(again.plan.U, new.plan.U)
        assert np.array_equal(again.plan.X, new.plan.X)


@each_solver
def test_options_survive_limits_that_come_and_go(name, slalom, options):
    rough = options(name, tolerance=1e-3)
    free = slalom.bounds._replace(h_low=np.array([-np.inf]), h_high=np.array([np.inf]))
    for bounds in (free, slalom.bounds):
        used = make_solver(slalom.problem, rough)
        for earlier in (slalom.bounds, free):
            early = used.solve(slalom.x0, slalom.P, earlier, slalom.guess)
            assert early.status == SOLVED
        late = used.solve(slalom.x0, slalom.P, bounds, slalom.guess)
        new = make_solver(slalom.problem, rough).solve(slalom.x0, slalom.P, bounds, slalom.guess)
        assert late.iterations == new.iterations
        assert np.array_equal(late.plan.X, new.plan.X)


@each_solver
def test_time_limit_that_is_kept_changes_nothing(name, slalom, options):
    free = make_solver(slalom.problem, options(name)).solve(*slalom.numbers)
    timed = make_solver(slalom.problem, options(name, time_limit_s=60.0)).solve(*slalom.numbers)
    assert timed.status == SOLVED
    assert np.array_equal(free.plan.U, timed.plan.U)


def unreachable(case):
    """Return bounds with a final position that the force cannot reach."""
    x_low = case.bounds.x_low.copy()
    x_low[-1, 0] = 100.0
    return case.bounds._replace(x_low=x_low)


@each_solver
def test_an_infeasible_problem_is_a_failure_not_an_exception(name, double_integrator, options):
    case = double_integrator
    own = make_solver(case.problem, options(name, tolerance=1e-8))
    solution = own.solve(case.x0, case.P, unreachable(case), case.guess)
    assert solution.status == FAILED
    assert solution.message in ('locally infeasible', 'line search failed')
    assert solution.primal_residual > 1.0
    assert own.solve(*case.numbers).status == SOLVED


@each_solver
def test_the_time_limit_ends_an_infeasible_problem_too(name, double_integrator, options):
    case = double_integrator
    numbers = case.x0, case.P, unreachable(case), case.guess
    solution, _ = stopped_by_time(name, case.problem, numbers, options)
    assert (solution.status, solution.message) == (STOPPED_EARLY, 'time limit')
    assert solution.primal_residual > 1.0


@each_solver
def test_solvers_print_nothing(name, slalom, double_integrator, options, capfd):
    make_solver(slalom.problem, options(name, time_limit_s=60.0)).solve(*slalom.numbers)
    make_solver(slalom.problem, options(name, time_limit_s=0.001)).solve(*slalom.numbers)
    case = double_integrator
    failing = make_solver(case.problem, options(name))
    failing.solve(case.x0, case.P, unreachable(case), case.guess)
    assert capfd.readouterr() == ('', '')
