"""Solutions against references that share no code with the solvers, and what starts them."""

from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import optimize
from small_problems import (
    double_integrator,
    each_solver,
    growing,
    least_squares,
    limited,
    make,
    random_linear,
    slalom,
)

from stage_solver import FAILED, ONE_STEP, SOLVED, OneStep, Plan, shift

seeds = st.integers(0, 2**32 - 1)
SLALOM = slalom()


# a vector holds up to 8 stages: horizons below, at and beyond its end
@pytest.mark.parametrize('horizon', [1, 7, 8, 20])
@settings(max_examples=20)
@given(seeds)
def test_one_newton_step_solves_a_linear_quadratic_problem(horizon, seed):
    case, matrices = random_linear(horizon, seed)
    solution = case.solve()
    M, b = least_squares(case, matrices)
    U, (cost,), *_ = np.linalg.lstsq(M, b)
    assert solution.status == SOLVED
    assert solution.iterations == 2  # the step, and one that finds nothing left to do
    assert solution.plan.U.ravel() == pytest.approx(U, abs=1e-8)
    assert solution.cost == pytest.approx(cost, rel=1e-9)
    assert solution.dual_residual < 1e-7


@each_solver
def test_inputs_with_limits_are_those_of_bounded_least_squares(name):
    case, matrices = random_linear(20, seed=5)
    bounds = case.bounds._replace(u_low=np.full((20, 2), -0.3), u_high=np.full((20, 2), 0.2))
    solution = case._replace(bounds=bounds).solve(name)
    M, b = least_squares(case, matrices)
    reference = optimize.lsq_linear(M, b, bounds=(-0.3, 0.2), method='bvls', tol=1e-12)
    assert np.sum(reference.active_mask != 0) > 10
    assert solution.status == SOLVED
    assert solution.plan.U.ravel() == pytest.approx(reference.x, abs=1e-5)
    assert solution.cost == pytest.approx(2 * reference.cost, rel=1e-6)


def assert_equal_solutions(solution, reference):
    assert solution.status == reference.status == SOLVED
    assert solution.cost == pytest.approx(reference.cost, rel=1e-6, abs=1e-7)
    assert np.allclose(solution.plan.X, reference.plan.X, atol=1e-4)
    assert np.allclose(solution.plan.U, reference.plan.U, atol=2e-4)
    assert solution.primal_residual < 1e-6
    assert solution.dual_residual < 1e-5


def assert_equal_multipliers(solution, reference):
    pairs = solution.plan.multipliers._asdict(), reference.plan.multipliers._asdict()
    for name, one, other in zip(pairs[0], *(pair.values() for pair in pairs)):
        rows = slice(1, None) if name == 'x' else slice(None)  # the first state has no bounds
        scale = 1 + np.abs(other).max(initial=0)
        assert np.allclose(one[rows], other[rows], atol=2e-3 * scale), name


kept = cache(make)


@settings(max_examples=25)
@given(seeds)
def test_random_limits_of_every_kind_are_met_as_ipopt_meets_them(seed):
    case = limited(random_linear(20, seed)[0], seed)
    solution, reference = (
        kept(solver, case.problem).solve(*case.numbers) for solver in ('riccati', 'ipopt')
    )
    assert_equal_solutions(solution, reference)
    assert_equal_multipliers(solution, reference)


@pytest.mark.parametrize(('name', 'side'), [('riccati', 1.0), ('riccati', -1.6), ('fatrop', 1.0)])
def test_a_way_past_a_disc_is_that_of_ipopt(name, side):
    X = SLALOM.guess.X * [1.0, side, 1.0, 1.0]
    case = SLALOM._replace(guess=SLALOM.guess._replace(X=X))
    solution, reference = case.solve(name), case.solve('ipopt', tolerance=1e-10)
    assert_equal_solutions(solution, reference)
    assert_equal_multipliers(solution, reference)
    assert all(np.abs(part).max() > 1e-3 for part in reference.plan.multipliers)
    assert np.array_equal(solution.plan.X[0], case.x0)


def test_concave_costs_are_climbed_down_from_their_top():
    # straight on, into the middle of the disc's cost, where the Hessian is indefinite
    P = SLALOM.P * [1.0, 0.03, 1.0, 1.0]
    bounds = SLALOM.bounds._replace(g_low=np.tile([-np.inf, -3.0], (30, 1)))
    X = SLALOM.guess.X * [1.0, 0.0, 1.0, 1.0]
    case = SLALOM._replace(P=P, bounds=bounds, guess=SLALOM.guess._replace(X=X))
    solution = case.solve()
    assert solution.status == SOLVED
    assert solution.cost <= case.solve('ipopt').cost * (1 + 1e-6)


def test_an_input_held_by_equal_limits_does_not_move():
    held = SLALOM.bounds._replace(
        u_low=SLALOM.bounds.u_low.copy(), u_high=SLALOM.bounds.u_high.copy()
    )
    held.u_low[:, 0] = held.u_high[:, 0] = 0.25
    solution = SLALOM._replace(bounds=held).solve()
    assert solution.status == SOLVED
    assert np.allclose(solution.plan.U[:, 0], 0.25, atol=4e-6)


def test_one_step_is_accepted_where_its_residuals_are_small_enough():
    cold = SLALOM.solve(tolerance=1e-6)
    guess = shift(cold.plan, SLALOM.problem.dynamics, SLALOM.P[-1])
    case = SLALOM._replace(x0=cold.plan.X[1], guess=guess)
    assert case.solve(one_step=OneStep(1e-12, 1e-12)).status == SOLVED
    solution = case.solve(one_step=OneStep(1.0, 1.0))
    assert solution.status == ONE_STEP
    assert solution.iterations < case.solve().iterations


def test_a_warm_start_at_the_solution_converges_where_one_step_is_not_asked_for():
    case = double_integrator(lambda x: 0)
    case.guess.X[:, 0] = 1.0
    bounds = case.bounds._replace(u_low=np.full((10, 1), -1.0), u_high=np.full((10, 1), 1.0))
    case = case._replace(x0=np.array([1.0, 0.0]), bounds=bounds)
    assert case._replace(guess=case.solve().plan).solve().status == SOLVED


def multiplied(value):
    parts = SLALOM.solve().plan.multipliers
    return SLALOM.guess._replace(multipliers=type(parts)(*(np.full_like(p, value) for p in parts)))


def disturbed():
    rng = np.random.default_rng(11)
    X = SLALOM.guess.X + 0.3 * rng.standard_normal(SLALOM.guess.X.shape)
    return Plan(X, 20 * rng.standard_normal(SLALOM.guess.U.shape))


@pytest.mark.parametrize(
    'guess',
    [
        pytest.param(lambda: SLALOM.solve().plan._replace(multipliers=None), id='only a plan'),
        pytest.param(lambda: multiplied(np.nan), id='multipliers that are not finite'),
        pytest.param(lambda: multiplied(1e12), id='large multipliers'),
        pytest.param(lambda: multiplied(-1e12), id='large negative multipliers'),
        pytest.param(disturbed, id='dynamics and limits are broken'),
    ],
)
def test_a_bad_guess_leads_to_the_same_solution(guess):
    solution = SLALOM._replace(guess=guess()).solve()
    assert solution.status == SOLVED
    assert solution.cost == pytest.approx(SLALOM.solve().cost, rel=1e-6)


def test_a_warm_start_on_the_wrong_bounds_is_left_for_a_cold_one():
    slower = SLALOM.bounds._replace(x_high=SLALOM.bounds.x_high - [0, 0, 0, 1.5])
    case = SLALOM._replace(x0=SLALOM.x0 - [0, 0, 0, 1.2], bounds=slower)
    solution = case._replace(guess=SLALOM.solve().plan).solve()
    assert solution.status == SOLVED
    assert solution.cost == pytest.approx(case.solve('ipopt').cost, rel=1e-5)


@each_solver
def test_equal_arguments_give_equal_bits_whatever_was_solved_before(name):
    free = SLALOM.bounds._replace(g_low=SLALOM.bounds.g_low - 100, h_low=np.array([-np.inf]))
    other = SLALOM._replace(P=np.add(SLALOM.P, [-2.0, 0.1, 0.3, 1.0]), bounds=free)
    used = make(name, SLALOM.problem, tolerance=1e-3)
    for case in (SLALOM, other, SLALOM, other):
        solution, alone = used.solve(*case.numbers), case.solve(name, tolerance=1e-3)
        assert (solution.status, solution.cost) == (SOLVED, alone.cost)
        assert solution.iterations == alone.iterations
        for one, another in zip(
            (solution.plan.X, solution.plan.U, *solution.plan.multipliers),
            (alone.plan.X, alone.plan.U, *alone.plan.multipliers),
        ):
            assert np.array_equal(one, another)


def test_a_fresh_start_that_overflows_leaves_the_result_of_the_first_one():
    assert growing(0.5).solve().status == SOLVED
    # the first state is not allowed, and the inputs of the guess lead from it to infinity
    solution = growing(1.5).solve()
    assert (solution.status, solution.message) == (FAILED, 'locally infeasible')
    assert 0.4 < solution.primal_residual < 5  # at first 1.5 + 1.5**3 = 4.9
    assert np.isfinite(solution.cost)
    assert np.abs(solution.plan.X[1:]).max() > 0.01  # an iterate, not the guess


@each_solver
def test_an_infeasible_problem_is_a_failure_that_changes_no_later_solve(name, capfd):
    case, _ = random_linear(20, seed=5)
    x_low = case.bounds.x_low.copy()
    x_low[-1, 0] = 1e3
    limits = case.bounds._replace(u_low=np.full((20, 2), -0.6), u_high=np.full((20, 2), 0.4))
    case = case._replace(bounds=limits)
    solver = make(name, case.problem)
    solution = solver.solve(*case._replace(bounds=limits._replace(x_low=x_low)).numbers)
    assert solution.status == FAILED
    assert name != 'riccati' or solution.message == 'locally infeasible'
    assert solution.primal_residual > 1.0
    assert np.isfinite(solution.plan.X).all()
    after, alone = solver.solve(*case.numbers), case.solve(name)
    assert after.status == SOLVED
    assert np.array_equal(after.plan.X, alone.plan.X)
    assert capfd.readouterr() == ('', '')
