"""Solutions against references that share no code with the solvers."""

import numpy as np
import pytest
from scipy import optimize
from small_problems import each_solver

from stage_solver.solution import SOLVED
from stage_solver.solver import CasadiTooOldError, check_casadi


def riccati(matrices, x0, horizon):
    """Inputs and states of the unconstrained linear-quadratic problem by dynamic programming."""
    A, B, Q, R, S = matrices.values()
    gains = []
    for _ in range(horizon):
        K = np.linalg.solve(R + B.T @ S @ B, B.T @ S @ A)
        gains.insert(0, K)
        S = Q + A.T @ S @ (A - B @ K)
    X, U = [x0], []
    for K in gains:
        U.append(-K @ X[-1])
        X.append(A @ X[-1] + B @ U[-1])
    return np.array(X), np.array(U), x0 @ S @ x0


def condensed(case):
    """The double integrator as least squares in the forces alone: min |M u - b|^2."""
    dt, N = 0.2, case.problem.horizon
    A, B = np.array([[1, dt], [0, 1]]), np.array([dt**2 / 2, dt])
    from_x0, from_u = case.x0, np.zeros((2, N))
    rows, b = [], []
    for k in range(1, N + 1):
        from_x0, from_u = A @ from_x0, A @ from_u
        from_u[:, k - 1] = B
        weight = np.sqrt(10) if k == N else 1.0
        rows.append(weight * from_u)
        b.append(-weight * from_x0)
    rows.append(np.sqrt(case.P[0, 0]) * np.eye(N))
    return np.vstack(rows), np.concatenate([*b, np.zeros(N)])


@each_solver
def test_linear_quadratic_problem_gets_the_riccati_solution(name, linear_quadratic, solver):
    case, matrices = linear_quadratic()
    solution = solver(name, case.problem).solve(*case.numbers)
    X, U, cost = riccati(matrices, case.x0, case.problem.horizon)
    assert solution.status == SOLVED
    assert np.allclose(solution.plan.X, X, atol=1e-8)
    assert np.allclose(solution.plan.U, U, atol=1e-8)
    assert solution.cost == pytest.approx(cost, abs=1e-9)
    assert solution.primal_residual < 1e-9
    assert solution.dual_residual < 1e-8


@each_solver
def test_scaling_changes_nothing_but_the_units_inside(name, linear_quadratic, solver):
    plain, _ = linear_quadratic()
    scaled, _ = linear_quadratic(scale_x=(100.0, 0.1, 3.0), scale_u=(20.0, 0.5))
    a = solver(name, plain.problem).solve(*plain.numbers)
    b = solver(name, scaled.problem).solve(*scaled.numbers)
    assert np.allclose(a.plan.U, b.plan.U, atol=1e-7)
    assert np.allclose(a.plan.multipliers.dynamics, b.plan.multipliers.dynamics, atol=1e-6)
    assert a.cost == pytest.approx(b.cost, rel=1e-9)


@each_solver
def test_bounded_forces_match_bounded_least_squares(name, double_integrator, solver):
    case = double_integrator
    solution = solver(name, case.problem).solve(*case.numbers)
    M, b = condensed(case)
    reference = optimize.lsq_linear(M, b, bounds=(-1.0, 0.7), method='bvls', tol=1e-12)
    assert reference.active_mask.any()
    assert solution.status == SOLVED
    assert np.allclose(solution.plan.U[:, 0], reference.x, atol=1e-6)
    # the first state is fixed and has a cost too
    assert solution.cost == pytest.approx(2 * reference.cost + case.x0 @ case.x0, rel=1e-7)


@each_solver
def test_bounded_speed_matches_a_general_optimiser(name, double_integrator, solver):
    case = double_integrator
    x_low = case.bounds.x_low.copy()
    x_low[:, 1] = -0.8
    bounds = case.bounds._replace(x_low=x_low)
    solution = solver(name, case.problem).solve(case.x0, case.P, bounds, case.guess)
    M, b = condensed(case)
    speed = optimize.LinearConstraint(np.tril(np.full((15, 15), 0.2)), -0.8 - case.x0[1])
    reference = optimize.minimize(
        lambda u: (M @ u - b) @ (M @ u - b),
        np.zeros(15),
        jac=lambda u: 2 * M.T @ (M @ u - b),
        bounds=[(-1.0, 0.7)] * 15,
        constraints=speed,
        method='SLSQP',
        options={'ftol': 1e-12, 'maxiter': 500},
    )
    assert solution.plan.X[:, 1].min() == pytest.approx(-0.8, abs=1e-6)
    assert np.allclose(solution.plan.U[:, 0], reference.x, atol=1e-4)
    assert solution.cost == pytest.approx(reference.fun + case.x0 @ case.x0, rel=1e-7)


@pytest.mark.parametrize('name', ['riccati', 'fatrop'])
def test_every_solver_finds_the_plan_of_ipopt_past_the_disc(name, slalom, solver):
    a, b = (solver(n, slalom.problem).solve(*slalom.numbers) for n in (name, 'ipopt'))
    assert a.status == b.status == SOLVED
    assert np.allclose(a.plan.X, b.plan.X, atol=1e-6)
    assert np.allclose(a.plan.U, b.plan.U, atol=1e-6)
    for mine, other in zip(a.plan.multipliers, b.plan.multipliers):
        assert np.allclose(mine[1:], other[1:], atol=1e-5)
    X, Y = a.plan.X[:-1, 0], a.plan.X[:-1, 1]
    assert np.hypot(X - 8.0, Y + 0.3).min() == pytest.approx(1.5, abs=1e-6)
    assert abs(a.plan.X[-1, 1]) <= 0.05 + 1e-6


@each_solver
def test_same_numbers_give_the_same_bits_whatever_was_solved_before(name, slalom, solver):
    own = solver(name, slalom.problem)
    first = own.solve(*slalom.numbers)
    closer = slalom.P + np.array([-2.0, 0.1, 0.3, 1.0])
    free = slalom.bounds._replace(g_low=slalom.bounds.g_low - 100, h_low=np.array([-np.inf]))
    between = own.solve(slalom.x0, closer, free, slalom.guess)
    again = own.solve(*slalom.numbers)
    assert not np.array_equal(between.plan.U, first.plan.U)
    assert np.array_equal(first.plan.X, again.plan.X)
    assert np.array_equal(first.plan.U, again.plan.U)
    assert first.iterations == again.iterations


@each_solver
def test_other_limits_are_obeyed_without_a_new_solver(name, slalom, solver):
    gentle = slalom.bounds._replace(u_high=slalom.bounds.u_high * 0.5)
    used = solver(name, slalom.problem)
    used.solve(*slalom.numbers)
    reused = used.solve(slalom.x0, slalom.P, gentle, slalom.guess)
    fresh = solver(name, slalom.problem)
    assert np.array_equal(
        reused.plan.U, fresh.solve(slalom.x0, slalom.P, gentle, slalom.guess).plan.U
    )
    assert (gentle.u_high + 1e-6 >= reused.plan.U).all()


@pytest.mark.parametrize('version', ['3.7.0', '3.8.2', '3.10.0', '4.0.0+custom'])
def test_supported_casadi_versions_pass(version):
    check_casadi(version)


@pytest.mark.parametrize('version', ['3.6.7', '3.6.0', '2.9.1'])
def test_old_casadi_is_refused_with_the_upgrade_command(version):
    with pytest.raises(CasadiTooOldError, match=rf"CasADi {version}.*pip install .*'casadi>=3.7'"):
        check_casadi(version)
