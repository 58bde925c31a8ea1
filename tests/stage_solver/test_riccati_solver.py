"""The generated interior-point method: right answers, and every way to stop."""

import casadi as ca
import numpy as np
import pytest

from stage_solver.solution import SOLVED
from stage_solver.stage_problem import Plan, shift


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
def test_one_newton_step_solves_a_linear_quadratic_problem(
    scaled_linear_quadratic, riccati, horizon
):
    case = scaled_linear_quadratic(horizon)
    solution = riccati(case.problem).solve(*case.numbers)
    X, U, cost = by_hand(matrices_of(case.problem), case.x0, horizon)
    assert solution.status == SOLVED
    assert solution.iterations == 2  # the step, and one that finds nothing left to do
    assert np.allclose(solution.plan.X, X, atol=1e-10)
    assert np.allclose(solution.plan.U, U, atol=1e-10)
    assert solution.cost == pytest.approx(cost, rel=1e-12)
    assert solution.dual_residual < 1e-10


def matrices_of(problem):
    x, u, p = np.zeros(3), np.zeros(2), np.zeros(0)
    sx, su, sp = ca.SX.sym('x', 3), ca.SX.sym('u', 2), ca.SX.sym('p', 0)
    step = problem.dynamics(sx, su, sp)
    cost, end = problem.stage_cost(sx, su, sp), problem.terminal_cost(sx, sp)
    parts = [ca.jacobian(step, sx), ca.jacobian(step, su)]
    parts += [ca.hessian(cost, sx)[0] / 2, ca.hessian(cost, su)[0] / 2, ca.hessian(end, sx)[0] / 2]
    values = ca.Function('m', [sx, su, sp], parts)(x, u, p)
    return [v.full() for v in values]


def start_sides(tight_slalom):
    """Two guesses, one on each side of the disc."""
    X = tight_slalom.guess.X.copy()
    X[:, 1] *= -1.6
    return {'left': tight_slalom.guess, 'right': Plan(X, tight_slalom.guess.U)}


@pytest.mark.parametrize('side', ['left', 'right'])
def test_every_kind_of_limit_is_met_as_ipopt_meets_it(tight_slalom, riccati, ipopt, side):
    numbers = (*tight_slalom.numbers[:3], start_sides(tight_slalom)[side])
    mine = riccati(tight_slalom.problem).solve(*numbers)
    reference = ipopt(tight_slalom.problem, tolerance=1e-10).solve(*numbers)
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


def test_plan_obeys_dynamics_and_limits_in_si_units(tight_slalom, riccati):
    plan = riccati(tight_slalom.problem).solve(*tight_slalom.numbers).plan
    problem, b = tight_slalom.problem, tight_slalom.bounds
    for k in range(problem.horizon):
        step = problem.dynamics(plan.X[k], plan.U[k], tight_slalom.P[k]).full().ravel()
        assert np.allclose(step, plan.X[k + 1], atol=1e-6)
        g = problem.constraints(plan.X[k], plan.U[k], tight_slalom.P[k]).full().ravel()
        assert np.all((b.g_low[k] - 1e-6 < g) & (g < b.g_high[k] + 1e-6))
    assert np.array_equal(plan.X[0], tight_slalom.x0)
    assert np.all((b.u_low <= plan.U) & (b.u_high >= plan.U))
    assert np.all(plan.X[1:] <= b.x_high[1:])


def test_concave_costs_are_climbed_down_from_their_top(riccati, ipopt, tight_slalom):
    # straight on, into the middle of the disc's cost, where the Hessian is indefinite
    free = tight_slalom.bounds._replace(g_low=np.tile([-np.inf, -3.0], (30, 1)))
    P = tight_slalom.P.copy()
    P[:, 1] = -0.01
    straight = np.column_stack([tight_slalom.guess.X[:, 0], *np.zeros((2, 31)), np.full(31, 5.0)])
    numbers = tight_slalom.x0, P, free, Plan(straight, tight_slalom.guess.U)
    mine = riccati(tight_slalom.problem).solve(*numbers)
    assert mine.status == SOLVED
    assert mine.cost <= ipopt(tight_slalom.problem).solve(*numbers).cost * (1 + 1e-6)


def test_warm_start_at_the_solution_needs_few_steps(tight_slalom, riccati):
    own = riccati(tight_slalom.problem, tolerance=1e-6)
    cold = own.solve(*tight_slalom.numbers)
    warm = own.solve(*tight_slalom.numbers[:3], cold.plan)
    assert warm.status == SOLVED
    assert 2 * warm.iterations < cold.iterations
    assert warm.cost == pytest.approx(cold.cost, rel=1e-7)


def test_primal_warm_start_alone_is_taken_as_a_cold_one(tight_slalom, riccati):
    own = riccati(tight_slalom.problem)
    plan = own.solve(*tight_slalom.numbers).plan
    assert own.solve(*tight_slalom.numbers[:3], plan._replace(multipliers=None)).status == SOLVED


def test_receding_horizon_stays_warm(tight_slalom, riccati):
    own = riccati(tight_slalom.problem, tolerance=1e-6)
    solution = own.solve(*tight_slalom.numbers)
    steps = []
    for _ in range(12):
        x0 = solution.plan.X[1]
        guess = shift(solution.plan, tight_slalom.problem.dynamics, tight_slalom.P[-1])
        solution = own.solve(x0, tight_slalom.P, tight_slalom.bounds, guess)
        assert solution.status == SOLVED
        steps.append(solution.iterations)
    assert np.median(steps) <= 8


def test_warm_start_on_the_wrong_bounds_is_left_for_a_cold_one(tight_slalom, riccati, ipopt):
    own = riccati(tight_slalom.problem)
    plan = own.solve(*tight_slalom.numbers).plan
    slower = tight_slalom.bounds._replace(
        x_high=tight_slalom.bounds.x_high - np.array([0, 0, 0, 1.5])
    )
    x0 = tight_slalom.x0 - np.array([0, 0, 0, 1.2])
    solution = own.solve(x0, tight_slalom.P, slower, plan)
    reference = ipopt(tight_slalom.problem).solve(x0, tight_slalom.P, slower, tight_slalom.guess)
    assert solution.status == SOLVED
    assert solution.cost == pytest.approx(reference.cost, rel=1e-5)


def test_useless_multipliers_do_no_harm(tight_slalom, riccati):
    own = riccati(tight_slalom.problem)
    cold = own.solve(*tight_slalom.numbers)
    for value in (np.nan, 1e12, -1e12):
        broken = type(cold.plan.multipliers)(
            *(np.full_like(part, value) for part in cold.plan.multipliers)
        )
        solution = own.solve(
            *tight_slalom.numbers[:3], tight_slalom.guess._replace(multipliers=broken)
        )
        assert solution.status == SOLVED
        assert solution.cost == pytest.approx(cold.cost, rel=1e-6)


def test_guess_that_breaks_dynamics_and_limits_is_repaired(tight_slalom, riccati):
    rng = np.random.default_rng(11)
    X = tight_slalom.guess.X + 0.3 * rng.standard_normal(tight_slalom.guess.X.shape)
    guess = Plan(X, 20 * rng.standard_normal(tight_slalom.guess.U.shape))
    solution = riccati(tight_slalom.problem).solve(*tight_slalom.numbers[:3], guess)
    assert solution.status == SOLVED


def test_input_held_by_equal_limits_does_not_move(tight_slalom, riccati):
    held = tight_slalom.bounds._replace(
        u_low=tight_slalom.bounds.u_low.copy(), u_high=tight_slalom.bounds.u_high.copy()
    )
    held.u_low[:, 0] = held.u_high[:, 0] = 0.25
    solution = riccati(tight_slalom.problem).solve(
        tight_slalom.x0, tight_slalom.P, held, tight_slalom.guess
    )
    assert solution.status == SOLVED
    assert np.allclose(solution.plan.U[:, 0], 0.25, atol=4e-6)
