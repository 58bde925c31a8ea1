"""What our solver does with useless tasks and numbers, with limits, threads and compilers."""

import dataclasses
import threading
import time

import casadi as ca
import numpy as np
import pytest

from stage_solver import riccati_solver
from stage_solver.backend import INFEASIBLE, ITERATION_LIMIT, TIME_LIMIT
from stage_solver.solution import FAILED, SOLVED, STOPPED_EARLY
from stage_solver.stage_problem import Plan, ProblemError, shift


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
    unlimited = riccati(slalom.problem)
    free = min((unlimited.solve(*numbers) for _ in range(10)), key=lambda one: one.solve_s)
    limited = riccati(slalom.problem, time_limit_s=free.solve_s / 4)
    most = 0
    for _ in range(20):  # what else the machine does may take the whole time of a solve
        began = time.thread_time()
        found = limited.solve(*numbers)
        assert time.thread_time() - began < 0.05
        assert (found.status, found.message) == (STOPPED_EARLY, TIME_LIMIT)
        assert found.iterations < free.iterations
        assert np.isfinite(found.plan.X).all()
        assert found.primal_residual > 0
        most = max(most, found.iterations)
    assert most > 0


def test_equal_solves_are_equal_bit_by_bit(slalom, riccati):
    one, other = riccati(slalom.problem), riccati(slalom.problem)
    first = one.solve(*slalom.numbers)
    shifted = shift(first.plan, slalom.problem.dynamics, slalom.P[-1])
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


def test_other_numbers_are_not_compiled_anew(slalom, riccati, own_cache):
    riccati(slalom.problem)
    before = set(own_cache.iterdir())
    wider = slalom.bounds._replace(g_high=slalom.bounds.g_high + 1)
    P = slalom.P + np.array([1.0, 0.1, 0.2, 0.5])
    assert riccati(slalom.problem).solve(slalom.x0, P, wider, slalom.guess).status == SOLVED
    assert set(own_cache.iterdir()) == before


def test_without_a_compiler_fatrop_takes_over(slalom, options, riccati, monkeypatch):
    expected = riccati(slalom.problem).solve(*slalom.numbers)
    monkeypatch.setenv('CC', 'no-such-compiler')
    replacement = riccati_solver.make_solver(slalom.problem, options())
    assert not isinstance(replacement, riccati_solver.RiccatiSolver)
    assert replacement.solve(*slalom.numbers).cost == pytest.approx(expected.cost, rel=1e-6)


def test_broken_compiler_is_reported_and_done_without(slalom, options, tmp_path, monkeypatch):
    broken = tmp_path / 'broken-cc'
    broken.write_text('#!/bin/sh\n[ "$1" = --version ] && exit 0\necho no headers >&2; exit 1\n')
    broken.chmod(0o755)
    monkeypatch.setenv('CC', str(broken))
    with pytest.warns(RuntimeWarning, match=r'(?s)no headers.*fatrop is used'):
        riccati_solver.make_solver(slalom.problem, options())
