"""The riccati solver on infeasible problems and invalid arguments, at limits, in threads."""

import dataclasses
import threading
import time

import casadi as ca
import numpy as np

from stage_solver import solver as solver_module
from stage_solver.solution import FAILED, SOLVED, STOPPED_EARLY
from stage_solver.solver import INFEASIBLE, ITERATION_LIMIT, TIME_LIMIT
from stage_solver.stage_problem import (
    Plan,
    StageProblem,
    no_bounds,
    shift,
    zero_plan,
)


def test_an_infeasible_problem_is_reported_and_changes_no_later_solve(tight_slalom, riccati):
    own = riccati(tight_slalom.problem)
    before = own.solve(*tight_slalom.numbers)
    far = tight_slalom.bounds._replace(h_low=np.array([90.0]), h_high=np.array([91.0]))
    solution = own.solve(tight_slalom.x0, tight_slalom.P, far, tight_slalom.guess)
    assert (solution.status, solution.message) == (FAILED, INFEASIBLE)
    assert solution.primal_residual > 1.0
    assert np.isfinite(solution.plan.X).all()
    after = own.solve(*tight_slalom.numbers)
    assert np.array_equal(after.plan.X, before.plan.X)


def test_function_without_value_at_the_guess_is_a_failure(scaled_linear_quadratic, riccati):
    case = scaled_linear_quadratic(8)
    x, u, p = ca.SX.sym('x', 3), ca.SX.sym('u', 2), ca.SX.sym('p', 0)
    rooted = ca.Function('l', [x, u, p], [ca.sqrt(x[0] - 5) + ca.sumsqr(u)])
    problem = dataclasses.replace(case.problem, name='rooted', stage_cost=rooted)
    solution = riccati(problem).solve(*case.numbers)
    assert solution.status == FAILED
    assert np.array_equal(solution.plan.U, case.guess.U)


def test_iteration_limit_returns_the_best_iterate(tight_slalom, riccati):
    left = [
        riccati(tight_slalom.problem, max_iterations=n).solve(*tight_slalom.numbers).primal_residual
        for n in (1, 3, 6)
    ]
    assert left[0] >= left[1] >= left[2]
    solution = riccati(tight_slalom.problem, max_iterations=3).solve(*tight_slalom.numbers)
    assert (solution.status, solution.message, solution.iterations) == (
        STOPPED_EARLY,
        ITERATION_LIMIT,
        3,
    )


def test_time_limit_ends_a_long_search(tight_slalom, riccati):
    # far outside every limit: dozens of steps from the solution
    guess = Plan(tight_slalom.guess.X + 3.0, tight_slalom.guess.U + 50.0)
    numbers = (*tight_slalom.numbers[:3], guess)
    unlimited = riccati(tight_slalom.problem)
    free = min((unlimited.solve(*numbers) for _ in range(10)), key=lambda one: one.solve_s)
    limited = riccati(tight_slalom.problem, time_limit_s=free.solve_s / 4)
    most = 0
    for _ in range(20):  # what else the machine does may take the whole time of a solve
        began = time.thread_time()
        solution = limited.solve(*numbers)
        assert time.thread_time() - began < 0.05
        assert (solution.status, solution.message) == (STOPPED_EARLY, TIME_LIMIT)
        assert solution.iterations < free.iterations
        assert np.isfinite(solution.plan.X).all()
        assert solution.primal_residual > 0
        most = max(most, solution.iterations)
    assert most > 0


def test_equal_solves_are_equal_bit_by_bit(tight_slalom, riccati):
    one, other = riccati(tight_slalom.problem), riccati(tight_slalom.problem)
    first = one.solve(*tight_slalom.numbers)
    shifted = shift(first.plan, tight_slalom.problem.dynamics, tight_slalom.P[-1])
    one.solve(
        first.plan.X[1], tight_slalom.P, tight_slalom.bounds, shifted
    )  # must leave nothing behind
    again, elsewhere = one.solve(*tight_slalom.numbers), other.solve(*tight_slalom.numbers)
    for solution in (again, elsewhere):
        assert solution.cost == first.cost
        assert np.array_equal(solution.plan.X, first.plan.X)
        assert np.array_equal(solution.plan.U, first.plan.U)
        for a, b in zip(solution.plan.multipliers, first.plan.multipliers):
            assert np.array_equal(a, b)


def test_instances_in_threads_do_not_disturb_each_other(tight_slalom, riccati):
    alone = riccati(tight_slalom.problem).solve(*tight_slalom.numbers)
    solution = []

    def work():
        own = riccati(tight_slalom.problem)
        solution.extend(own.solve(*tight_slalom.numbers).plan.U for _ in range(30))

    threads = [threading.Thread(target=work) for _ in range(3)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(solution) == 90
    assert all(np.array_equal(U, alone.plan.U) for U in solution)


def test_width_of_the_vectors_decides_nothing(tight_slalom, riccati, monkeypatch):
    costs = []
    for width in (2, 4, 8):
        monkeypatch.setattr(solver_module, 'lanes', lambda width=width: width)
        solution = riccati(tight_slalom.problem).solve(*tight_slalom.numbers)
        assert solution.status == SOLVED
        costs.append(solution.cost)
    assert np.ptp(costs) < 1e-7 * costs[0]


def test_other_numbers_are_not_compiled_anew(tight_slalom, riccati, own_cache):
    riccati(tight_slalom.problem)
    before = set(own_cache.iterdir())
    wider = tight_slalom.bounds._replace(g_high=tight_slalom.bounds.g_high + 1)
    P = tight_slalom.P + np.array([1.0, 0.1, 0.2, 0.5])
    assert (
        riccati(tight_slalom.problem).solve(tight_slalom.x0, P, wider, tight_slalom.guess).status
        == SOLVED
    )
    assert set(own_cache.iterdir()) == before


def double_integrator_that_costs(root, name):
    """A double integrator to 1 m, its speed costs `root(v)`; at rest in the guess."""
    x, u, p = ca.SX.sym('x', 2), ca.SX.sym('u', 1), ca.SX.sym('p', 0)
    problem = StageProblem(
        name=name,
        states=('s', 'v'),
        inputs=('a',),
        parameters=(),
        horizon=10,
        dynamics=ca.Function('F', [x, u, p], [ca.vertcat(x[0] + 0.1 * x[1], x[1] + 0.1 * u)]),
        stage_cost=ca.Function('l', [x, u, p], [(x[0] - 1) ** 2 + ca.sumsqr(u) + root(x[1])]),
    )
    return problem, (np.zeros(2), np.zeros((11, 0)), no_bounds(problem), zero_plan(problem))


def test_a_derivative_that_is_not_finite_is_a_failure_that_names_its_stage(riccati):
    problem, numbers = double_integrator_that_costs(ca.sqrt, 'rooted_speed')
    solution = riccati(problem).solve(*numbers)
    assert solution.status == FAILED
    # stage 0 is given: its own derivatives do not matter
    assert solution.message == 'the derivatives of the cost are not finite at stage 1'
    assert np.array_equal(solution.plan.U, numbers[-1].U)


def test_a_guess_from_which_no_step_is_acceptable_is_a_failure(riccati):
    """The derivatives are finite and lie: 1 at rest, where every motion costs."""
    problem, numbers = double_integrator_that_costs(
        lambda v: v + ca.if_else(v == 0, 0, 100), 'jumping_speed'
    )
    solution = riccati(problem).solve(*numbers)
    assert (solution.status, solution.message) == (FAILED, 'no step from the guess is acceptable')
    assert solution.dual_residual > 0.1
