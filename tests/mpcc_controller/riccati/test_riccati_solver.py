"""The generated interior-point method: right answers, and every way to stop."""

import dataclasses
import threading
import time

import casadi as ca
import numpy as np
import pytest

from mpcc_controller.solvers import riccati_solver, shooting
from mpcc_controller.solvers.backend import INFEASIBLE, ITERATION_LIMIT, TIME_LIMIT
from mpcc_controller.solvers.shooting import Plan, ProblemError
from mpcc_controller.solvers.solution import FAILED, SOLVED, STOPPED_EARLY


def by_hand(matrices, x0, horizon):
    """Solve the linear-quadratic problem by dynamic programming in dense matrices."""
    A, B, Q, R, S = matrices
    gains = []
    for _ in range(horizon):
        K = np.linalg.solve(R + B.T @ S @ B, B.T @ S @ A)
        gains.insert(0, K)
        S = Q + A.T @ S @ (A - B @ K)
    X = [x0]
    for K in gains:
        X.append((A - B @ K) @ X[-1])
    return np.array(X), -np.array([K @ x for K, x in zip(gains, X)]), x0 @ S @ x0


# a vector holds up to 8 stages: horizons below, at and beyond its end
@pytest.mark.parametrize('horizon', [1, 7, 8, 20])
def test_one_newton_step_solves_a_linear_quadratic_problem(linear_quadratic, riccati, horizon):
    case = linear_quadratic(horizon)
    found = riccati(case.problem).solve(*case.numbers)
    X, U, cost = by_hand(matrices_of(case.problem), case.x0, horizon)
    assert found.status == SOLVED
    assert found.iterations == 2  # the step, and one that finds nothing left to do
    assert np.allclose(found.plan.X, X, atol=1e-10)
    assert np.allclose(found.plan.U, U, atol=1e-10)
    assert found.cost == pytest.approx(cost, rel=1e-12)
    assert found.dual_residual < 1e-10


def matrices_of(problem):
    x, u, p = np.zeros(3), np.zeros(2), np.zeros(0)
    sx, su, sp = ca.SX.sym('x', 3), ca.SX.sym('u', 2), ca.SX.sym('p', 0)
    step = problem.dynamics(sx, su, sp)
    cost, end = problem.stage_cost(sx, su, sp), problem.terminal_cost(sx, sp)
    parts = [ca.jacobian(step, sx), ca.jacobian(step, su)]
    parts += [ca.hessian(cost, sx)[0] / 2, ca.hessian(cost, su)[0] / 2, ca.hessian(end, sx)[0] / 2]
    values = ca.Function('m', [sx, su, sp], parts)(x, u, p)
    return [v.full() for v in values]


def start_sides(slalom):
    """Two guesses, one on each side of the disc."""
    X = slalom.guess.X.copy()
    X[:, 1] *= -1.6
    return {'left': slalom.guess, 'right': Plan(X, slalom.guess.U)}


@pytest.mark.parametrize('side', ['left', 'right'])
def test_every_kind_of_limit_is_met_as_ipopt_meets_it(slalom, riccati, ipopt, side):
    numbers = (*slalom.numbers[:3], start_sides(slalom)[side])
    mine = riccati(slalom.problem).solve(*numbers)
    reference = ipopt(slalom.problem, tolerance=1e-10).solve(*numbers)
    assert mine.status == reference.status == SOLVED
    assert mine.cost == pytest.approx(reference.cost, rel=1e-6)
    assert np.allclose(mine.plan.X, reference.plan.X, atol=1e-4)
    assert np.allclose(mine.plan.U, reference.plan.U, atol=2e-4)
    assert mine.primal_residual < 1e-7
    assert mine.dual_residual < 1e-5
    active = [np.abs(part).max() > 1e-3 for part in reference.plan.multipliers]
    assert all(active)  # the speed, a push, the disc or the turn, the line at the end
    for one, other in zip(mine.plan.multipliers, reference.plan.multipliers):
        if other is reference.plan.multipliers.x:
            one, other = one[1:], other[1:]  # the first state is given, not bounded
        assert np.allclose(one, other, atol=2e-3 * (1 + np.abs(other).max()))


def test_plan_obeys_dynamics_and_limits_in_si_units(slalom, riccati):
    plan = riccati(slalom.problem).solve(*slalom.numbers).plan
    problem, b = slalom.problem, slalom.bounds
    for k in range(problem.horizon):
        step = problem.dynamics(plan.X[k], plan.U[k], slalom.P[k]).full().ravel()
        assert np.allclose(step, plan.X[k + 1], atol=1e-6)
        g = problem.constraints(plan.X[k], plan.U[k], slalom.P[k]).full().ravel()
        assert np.all((b.g_low[k] - 1e-6 < g) & (g < b.g_high[k] + 1e-6))
    assert np.array_equal(plan.X[0], slalom.x0)
    assert np.all((b.u_low <= plan.U) & (b.u_high >= plan.U))
    assert np.all(plan.X[1:] <= b.x_high[1:])


def test_concave_costs_are_climbed_down_from_their_top(riccati, ipopt, slalom):
    # straight on, into the middle of the disc's cost, where the Hessian is indefinite
    free = slalom.bounds._replace(g_low=np.tile([-np.inf, -3.0], (30, 1)))
    P = slalom.P.copy()
    P[:, 1] = -0.01
    straight = np.column_stack([slalom.guess.X[:, 0], *np.zeros((2, 31)), np.full(31, 5.0)])
    numbers = slalom.x0, P, free, Plan(straight, slalom.guess.U)
    mine = riccati(slalom.problem).solve(*numbers)
    assert mine.status == SOLVED
    assert mine.cost <= ipopt(slalom.problem).solve(*numbers).cost * (1 + 1e-6)


def test_warm_start_at_the_solution_needs_few_steps(slalom, riccati):
    own = riccati(slalom.problem, tolerance=1e-6)
    cold = own.solve(*slalom.numbers)
    warm = own.solve(*slalom.numbers[:3], cold.plan)
    assert warm.status == SOLVED
    assert 2 * warm.iterations < cold.iterations
    assert warm.cost == pytest.approx(cold.cost, rel=1e-7)


def test_primal_warm_start_alone_is_taken_as_a_cold_one(slalom, riccati):
    own = riccati(slalom.problem)
    plan = own.solve(*slalom.numbers).plan
    assert own.solve(*slalom.numbers[:3], plan._replace(multipliers=None)).status == SOLVED


def test_receding_horizon_stays_warm(slalom, riccati):
    own = riccati(slalom.problem, tolerance=1e-6)
    found = own.solve(*slalom.numbers)
    steps = []
    for _ in range(12):
        x0 = found.plan.X[1]
        guess = shooting.shift(found.plan, slalom.problem.dynamics, slalom.P[-1])
        found = own.solve(x0, slalom.P, slalom.bounds, guess)
        assert found.status == SOLVED
        steps.append(found.iterations)
    assert np.median(steps) <= 8


def test_warm_start_on_the_wrong_bounds_is_left_for_a_cold_one(slalom, riccati, ipopt):
    own = riccati(slalom.problem)
    plan = own.solve(*slalom.numbers).plan
    slower = slalom.bounds._replace(x_high=slalom.bounds.x_high - np.array([0, 0, 0, 1.5]))
    x0 = slalom.x0 - np.array([0, 0, 0, 1.2])
    found = own.solve(x0, slalom.P, slower, plan)
    reference = ipopt(slalom.problem).solve(x0, slalom.P, slower, slalom.guess)
    assert found.status == SOLVED
    assert found.cost == pytest.approx(reference.cost, rel=1e-5)


def test_useless_multipliers_do_no_harm(slalom, riccati):
    own = riccati(slalom.problem)
    cold = own.solve(*slalom.numbers)
    for value in (np.nan, 1e12, -1e12):
        broken = type(cold.plan.multipliers)(
            *(np.full_like(part, value) for part in cold.plan.multipliers)
        )
        found = own.solve(*slalom.numbers[:3], slalom.guess._replace(multipliers=broken))
        assert found.status == SOLVED
        assert found.cost == pytest.approx(cold.cost, rel=1e-6)


def test_guess_that_breaks_dynamics_and_limits_is_repaired(slalom, riccati):
    rng = np.random.default_rng(11)
    X = slalom.guess.X + 0.3 * rng.standard_normal(slalom.guess.X.shape)
    guess = Plan(X, 20 * rng.standard_normal(slalom.guess.U.shape))
    found = riccati(slalom.problem).solve(*slalom.numbers[:3], guess)
    assert found.status == SOLVED


def test_input_held_by_equal_limits_does_not_move(slalom, riccati):
    held = slalom.bounds._replace(
        u_low=slalom.bounds.u_low.copy(), u_high=slalom.bounds.u_high.copy()
    )
    held.u_low[:, 0] = held.u_high[:, 0] = 0.25
    found = riccati(slalom.problem).solve(slalom.x0, slalom.P, held, slalom.guess)
    assert found.status == SOLVED
    assert np.allclose(found.plan.U[:, 0], 0.25, atol=4e-6)


def test_infeasible_problem_is_said_to_be_so_and_leaves_no_trace(slalom, riccati):
    own = riccati(slalom.problem)
    before = own.solve(*slalom.numbers)
    far = slalom.bounds._replace(h_low=np.array([90.0]), h_high=np.array([91.0]))
    found = own.solve(slalom.x0, slalom.P, far, slalom.guess)
    assert (found.status, found.message) == (FAILED, INFEASIBLE)
    assert found.primal_residual > 1.0
    assert np.isfinite(found.plan.X).all()
    after = own.solve(*slalom.numbers)
    assert np.array_equal(after.plan.X, before.plan.X)


@pytest.mark.parametrize('what', ['x0', 'P', 'X', 'U', 'limit'])
def test_numbers_that_are_none_are_refused_by_name(slalom, riccati, what):
    x0, P, bounds, guess = (
        slalom.x0.copy(),
        slalom.P.copy(),
        slalom.bounds._replace(u_low=slalom.bounds.u_low.copy()),
        Plan(slalom.guess.X.copy(), slalom.guess.U.copy()),
    )
    targets = {'x0': x0, 'P': P[3], 'X': guess.X[3], 'U': guess.U[3], 'limit': bounds.u_low[3]}
    targets[what][1] = np.nan
    found = riccati(slalom.problem).solve(x0, P, bounds, guess)
    assert found.status == FAILED
    assert found.iterations == 0
    expected = {'x0': 'initial state', 'P': 'parameters', 'X': 'guess', 'U': 'guess', 'limit': 'no'}
    assert expected[what] in found.message


def test_crossed_limits_are_refused(slalom, riccati):
    crossed = slalom.bounds._replace(u_high=slalom.bounds.u_low - 1)
    found = riccati(slalom.problem).solve(slalom.x0, slalom.P, crossed, slalom.guess)
    assert found.status == FAILED
    assert 'no value of u' in found.message


def test_function_without_value_at_the_guess_is_a_failure(linear_quadratic, riccati):
    case = linear_quadratic(8)
    x, u, p = ca.SX.sym('x', 3), ca.SX.sym('u', 2), ca.SX.sym('p', 0)
    rooted = ca.Function('l', [x, u, p], [ca.sqrt(x[0] - 5) + ca.sumsqr(u)])
    problem = dataclasses.replace(case.problem, name='rooted', stage_cost=rooted)
    found = riccati(problem).solve(*case.numbers)
    assert found.status == FAILED
    assert np.array_equal(found.plan.U, case.guess.U)


def test_shape_that_does_not_fit_is_an_error(slalom, riccati):
    with pytest.raises(ProblemError, match='P has shape'):
        riccati(slalom.problem).solve(slalom.x0, slalom.P[:-1], slalom.bounds, slalom.guess)


def test_iteration_limit_returns_the_best_iterate(slalom, riccati):
    left = [
        riccati(slalom.problem, max_iterations=n).solve(*slalom.numbers).primal_residual
        for n in (1, 3, 6)
    ]
    assert left[0] >= left[1] >= left[2]
    found = riccati(slalom.problem, max_iterations=3).solve(*slalom.numbers)
    assert (found.status, found.message, found.iterations) == (STOPPED_EARLY, ITERATION_LIMIT, 3)


def test_time_limit_ends_a_long_search(slalom, riccati):
    # far outside every limit: dozens of steps from the solution
    guess = Plan(slalom.guess.X + 3.0, slalom.guess.U + 50.0)
    numbers = (*slalom.numbers[:3], guess)
    free = riccati(slalom.problem).solve(*numbers)
    limited = riccati(slalom.problem, time_limit_s=free.solve_s / 4)
    began = time.perf_counter()
    found = limited.solve(*numbers)
    assert time.perf_counter() - began < 0.05
    assert (found.status, found.message) == (STOPPED_EARLY, TIME_LIMIT)
    assert 0 < found.iterations < free.iterations
    assert np.isfinite(found.plan.X).all()
    assert found.primal_residual > 0


def test_equal_solves_are_equal_bit_by_bit(slalom, riccati):
    one, other = riccati(slalom.problem), riccati(slalom.problem)
    first = one.solve(*slalom.numbers)
    shifted = shooting.shift(first.plan, slalom.problem.dynamics, slalom.P[-1])
    one.solve(first.plan.X[1], slalom.P, slalom.bounds, shifted)  # must leave nothing behind
    again, elsewhere = one.solve(*slalom.numbers), other.solve(*slalom.numbers)
    for found in (again, elsewhere):
        assert found.cost == first.cost
        assert np.array_equal(found.plan.X, first.plan.X)
        assert np.array_equal(found.plan.U, first.plan.U)
        for a, b in zip(found.plan.multipliers, first.plan.multipliers):
            assert np.array_equal(a, b)


def test_instances_in_threads_do_not_disturb_each_other(slalom, riccati):
    alone = riccati(slalom.problem).solve(*slalom.numbers)
    found = []

    def work():
        own = riccati(slalom.problem)
        found.extend(own.solve(*slalom.numbers).plan.U for _ in range(30))

    threads = [threading.Thread(target=work) for _ in range(3)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(found) == 90
    assert all(np.array_equal(U, alone.plan.U) for U in found)


def test_width_of_the_vectors_decides_nothing(slalom, riccati, monkeypatch):
    costs = []
    for width in (2, 4, 8):
        monkeypatch.setattr(riccati_solver, 'lanes', lambda width=width: width)
        found = riccati(slalom.problem).solve(*slalom.numbers)
        assert found.status == SOLVED
        costs.append(found.cost)
    assert np.ptp(costs) < 1e-7 * costs[0]


def test_other_numbers_are_not_compiled_anew(slalom, riccati, cache):
    riccati(slalom.problem)
    before = set(cache.iterdir())
    wider = slalom.bounds._replace(g_high=slalom.bounds.g_high + 1)
    P = slalom.P + np.array([1.0, 0.1, 0.2, 0.5])
    assert riccati(slalom.problem).solve(slalom.x0, P, wider, slalom.guess).status == SOLVED
    assert set(cache.iterdir()) == before


def test_without_a_compiler_fatrop_takes_over(slalom, options, riccati, monkeypatch):
    expected = riccati(slalom.problem).solve(*slalom.numbers)
    monkeypatch.setenv('CC', 'no-such-compiler')
    replacement = riccati_solver.make(slalom.problem, options())
    assert not isinstance(replacement, riccati_solver.RiccatiSolver)
    assert replacement.solve(*slalom.numbers).cost == pytest.approx(expected.cost, rel=1e-6)


def test_broken_compiler_is_reported_and_done_without(slalom, options, tmp_path, monkeypatch):
    broken = tmp_path / 'broken-cc'
    broken.write_text('#!/bin/sh\n[ "$1" = --version ] && exit 0\necho no headers >&2; exit 1\n')
    broken.chmod(0o755)
    monkeypatch.setenv('CC', str(broken))
    with pytest.warns(RuntimeWarning, match=r'(?s)no headers.*fatrop is used'):
        riccati_solver.make(slalom.problem, options())
