"""What ends a solve before it has a solution: limits, functions without a value, bad arguments."""

import threading
import time

import casadi as ca
import numpy as np
import pytest
from small_problems import double_integrator, each_solver, make, slalom

from stage_solver import FAILED, SOLVED, STOPPED_EARLY, ProblemError, no_bounds
from stage_solver import solver as solver_module
from stage_solver.solver import CasadiTooOldError, check_casadi

SLALOM = slalom()


def violation(case, plan):
    """Return the largest violation of dynamics and limits, in solver units."""
    problem, b, (X, U) = case.problem, case.bounds, plan[:2]
    columns = X[:-1].T, U.T, case.P[:-1].T
    x_next, g = (
        f.map(problem.horizon)(*columns).full().T for f in (problem.dynamics, problem.constraints)
    )
    h = problem.terminal_constraints(X[-1], case.P[-1]).full().ravel()
    return max(
        np.max(np.abs(x_next - X[1:]) / problem.scale_x),
        np.max(np.maximum(b.x_low - X, X - b.x_high)[1:] / problem.scale_x),
        np.max(np.maximum(b.u_low - U, U - b.u_high) / problem.scale_u),
        np.max(np.maximum(b.g_low - g, g - b.g_high)),
        np.max(np.maximum(b.h_low - h, h - b.h_high)),
    )


@each_solver
def test_the_iteration_limit_returns_the_iterate_with_its_residuals(name):
    case = SLALOM
    if name == 'riccati':  # counts how far slacks are from their constraints, too
        unlimited = no_bounds(case.problem)._asdict()
        free = {key: unlimited[key] for key in ('g_low', 'g_high', 'h_low', 'h_high')}
        case = case._replace(bounds=case.bounds._replace(**free))
    solution = case.solve(name, max_iterations=3)
    assert (solution.status, solution.message) == (STOPPED_EARLY, 'iteration limit')
    assert solution.iterations == 3
    assert solution.primal_residual == pytest.approx(violation(case, solution.plan), abs=1e-9)
    assert solution.dual_residual > 1e-3


def test_a_time_limit_ends_a_long_search():
    # far outside every limit: dozens of steps from the solution
    guess = SLALOM.guess._replace(X=SLALOM.guess.X + 3.0, U=SLALOM.guess.U + 50.0)
    numbers = SLALOM._replace(guess=guess).numbers
    unlimited, limited = (make('riccati', SLALOM.problem) for _ in range(2))
    free = min((unlimited.solve(*numbers) for _ in range(10)), key=lambda each: each.solve_s)
    limited.set_time_limit(free.solve_s / 4)
    most = 0
    for _ in range(20):  # what else the machine does may take the whole time of a solve
        began = time.thread_time()
        solution = limited.solve(*numbers)
        assert time.thread_time() - began < 0.05
        assert (solution.status, solution.message) == (STOPPED_EARLY, 'time limit')
        assert solution.iterations < free.iterations
        assert np.isfinite(solution.plan.X).all()
        assert solution.primal_residual > 0
        most = max(most, solution.iterations)
    assert most > 0


@pytest.mark.parametrize(
    ('cost', 'message'),
    [
        pytest.param(
            lambda x: ca.sqrt(x[0] - 5),
            'a function of the problem is not finite at the guess',
            id='no value',
        ),
        pytest.param(
            lambda x: ca.sqrt(x[1]),
            # stage 0 is given: its own derivatives do not matter
            'the derivatives of the cost are not finite at stage 1',
            id='no derivative',
        ),
        pytest.param(
            # the derivatives are finite and lie: 1 at rest, where every motion costs
            lambda x: x[1] + ca.if_else(x[1] == 0, 0, 100),
            'no step from the guess is acceptable',
            id='a jump',
        ),
    ],
)
def test_a_cost_that_no_step_can_use_is_a_failure_that_says_why(cost, message):
    case = double_integrator(cost)
    solution = case.solve()
    assert (solution.status, solution.message) == (FAILED, message)
    assert np.array_equal(solution.plan.U, case.guess.U)
    assert solution.dual_residual > 0.1


def test_instances_in_threads_do_not_disturb_each_other():
    alone, plans = SLALOM.solve().plan, []

    def work():
        own = make('riccati', SLALOM.problem)
        plans.extend(own.solve(*SLALOM.numbers).plan for _ in range(30))

    threads = [threading.Thread(target=work) for _ in range(3)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(plans) == 90
    assert all(np.array_equal(plan.U, alone.U) for plan in plans)


def test_the_width_of_the_vectors_decides_nothing(monkeypatch):
    costs = []
    for width in (2, 4, 8):
        monkeypatch.setattr(solver_module, 'lanes', lambda width=width: width)
        solution = SLALOM.solve()
        assert solution.status == SOLVED
        costs.append(solution.cost)
    assert np.ptp(costs) < 1e-7 * costs[0]


def test_other_numbers_need_no_compiler(monkeypatch):
    make('riccati', SLALOM.problem)
    monkeypatch.setenv('CC', 'no-such-compiler')
    wider = SLALOM.bounds._replace(g_high=SLALOM.bounds.g_high + 1)
    other = SLALOM._replace(P=np.add(SLALOM.P, [1.0, 0.1, 0.2, 0.5]), bounds=wider)
    assert other.solve().status == SOLVED


def changed(field, at, value):
    """Return the slalom with one element of an argument changed; `field` as in Case.numbers."""
    group, _, name = field.partition('.')
    owner = getattr(SLALOM, group)
    array = (getattr(owner, name) if name else owner).copy()
    array[at] = value
    return SLALOM._replace(**{group: owner._replace(**{name: array}) if name else array})


@each_solver
@pytest.mark.parametrize(
    ('case', 'message'),
    [
        (changed('x0', 0, np.nan), 'the initial state is not finite: X = nan, row 0'),
        (changed('P', (4, 2), np.nan), 'the parameters is not finite: r_disc = nan, row 4'),
        (changed('guess.X', (7, 1), np.inf), 'the guess is not finite: Y = inf, row 6'),
        (changed('guess.U', (2, 0), np.nan), 'the guess is not finite: push = nan, row 2'),
        (changed('bounds.u_low', (5, 0), 3.0), 'no value of u[5, 0] lies in [3.0, 0.8]'),
        (changed('bounds.u_low', (5, 0), np.nan), 'no value of u[5, 0] lies in [nan, 0.8]'),
        (changed('bounds.h_high', 0, 0.0), 'no value of h[0] lies in [0.1, 0.0]'),
        (changed('bounds.x_high', (1, 3), -np.inf), 'no value of x[0, 3] lies in [-inf, -inf]'),
    ],
)
def test_invalid_values_are_refused_by_name(name, case, message):
    solution = case.solve(name)
    assert (solution.status, solution.message) == (FAILED, message)
    assert solution.iterations == 0
    assert not np.isfinite(solution.primal_residual)


@each_solver
def test_a_wrong_shape_raises_with_its_name(name):
    with pytest.raises(ProblemError, match=r'P has shape \(30, 4\); \(31, 4\) is needed'):
        SLALOM._replace(P=SLALOM.P[:-1]).solve(name)


def test_a_casadi_that_keeps_the_lock_is_refused_with_the_upgrade_command():
    for version in ('3.7.0', '3.8.2', '3.10.0', '4.0.0+custom'):
        check_casadi(version)
    for version in ('3.6.7', '3.6.0', '2.9.1'):
        with pytest.raises(CasadiTooOldError, match=rf"{version}.*pip install .*'casadi>=3.7'"):
            check_casadi(version)
