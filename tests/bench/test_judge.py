"""The judge: costs and residuals from the stage functions, minima told apart."""

import numpy as np
import pytest
import verdict
from judge import Judge
from race import Answer, Task
from verdict import DEARER, GOOD, INFEASIBLE, OTHER_MINIMUM, Court, Verdict

from stage_solver.solution import SOLVED, SolverOptions
from stage_solver.solver import make_solver
from stage_solver.stage_problem import Plan

IPOPT = SolverOptions('ipopt', 500, 1e-8, None, compiled=False)
P = np.ones((5, 1))
AT = 0.1


def straight_to(x):
    """A plan from AT to x in equal steps."""
    X = np.linspace(AT, x, 5)[:, None]
    return Plan(X, np.diff(X, axis=0))


@pytest.fixture(scope='module')
def court(wells):
    return Court(wells, IPOPT)


def judged(court, limits, start, plan):
    task = Task('warm', np.array([AT]), P, limits, start)
    return court.verdict(task, Answer(plan, 1, ''))


def test_the_judge_agrees_with_the_formula(wells, limits):
    plan, judge = straight_to(0.9), Judge(wells)
    by_hand = 4 * 0.01 * 0.2**2 + (0.9**2 - 1) ** 2 + 1 - 0.09
    assert judge.cost(plan, P) == pytest.approx(by_hand, rel=1e-12)
    assert judge.residual(plan, np.array([AT]), P, limits) < 1e-15


def test_the_judge_agrees_with_a_solver_on_the_control_problem(problem, recorded, params):
    rules = params.solver
    fatrop = make_solver(problem, SolverOptions('fatrop', 100, rules.tolerance, None, False))
    judge = Judge(problem)
    for k in (0, 8):
        numbers = recorded.x0[k], recorded.P[k], recorded.bounds_of(k)
        solution = fatrop.solve(*numbers, recorded.cold_start(k))
        assert solution.status == SOLVED
        assert judge.cost(solution.plan, numbers[1]) == pytest.approx(solution.cost, rel=1e-9)
        residual = judge.residual(solution.plan, *numbers)
        assert residual == pytest.approx(solution.primal_residual, abs=1e-9)


@pytest.mark.parametrize(
    ('limit', 'value', 'expected'),
    [
        ('x_high', 0.4, 0.5),
        ('x_low', 0.4, 0.1),
        ('u_high', 0.1, 0.05),
        ('u_low', 0.3, 0.05),
        ('g_high', 0.05, 0.05),
        ('g_low', 0.3, 0.8),
        ('h_high', 0.7, 0.2),
        ('h_low', 1.0, 0.1),
    ],
)
def test_every_limit_is_looked_at(wells, limits, limit, value, expected):
    tight = limits._replace(**{limit: np.full_like(getattr(limits, limit), value)})
    residual = Judge(wells).residual(straight_to(0.9), np.array([AT]), P, tight)
    assert residual == pytest.approx(expected)


def test_the_dynamics_and_the_start_are_looked_at(wells, limits):
    judge, plan = Judge(wells), straight_to(0.9)
    assert judge.residual(plan, np.array([AT + 0.3]), P, limits) == pytest.approx(0.3)
    X = plan.X.copy()
    X[-1] += 0.25
    assert judge.residual(plan._replace(X=X), np.array([AT]), P, limits) == pytest.approx(0.25)
    X[-1] = np.nan
    assert judge.residual(plan._replace(X=X), np.array([AT]), P, limits) == np.inf


def test_row_0_of_the_state_bounds_does_not_count(wells, limits):
    low = limits.x_low.copy()
    low[0] = 1.0
    judge = Judge(wells)
    assert judge.residual(straight_to(0.9), np.array([AT]), P, limits._replace(x_low=low)) < 1e-15


def minimum(wells, limits, near):
    solution = make_solver(wells, IPOPT).solve(np.array([AT]), P, limits, straight_to(near))
    assert solution.status == SOLVED
    return solution.plan


def test_the_minimum_next_to_the_start_is_good(court, wells, limits):
    given = judged(court, limits, straight_to(1.2), minimum(wells, limits, 0.8))
    assert given.kind == GOOD
    assert abs(given.gap) < 1e-7


@pytest.mark.parametrize(('near', 'dearer'), [(-1.0, True), (1.0, False)])
def test_the_other_well_stands_apart_whether_deeper_or_not(court, wells, limits, near, dearer):
    given = judged(court, limits, straight_to(-near), minimum(wells, limits, near))
    assert given.kind == OTHER_MINIMUM
    assert (given.gap > 0.05) == dearer


def test_a_feasible_plan_on_the_slope_is_dearer(court, limits):
    given = judged(court, limits, straight_to(1.0), straight_to(0.8))
    assert given.kind == DEARER
    assert given.gap > 1e-2


def test_a_plan_that_leaps_is_infeasible_however_cheap(court, wells, limits):
    plan = minimum(wells, limits, 1.0)
    given = judged(court, limits, straight_to(1.0), plan._replace(U=0 * plan.U))
    assert given.kind == INFEASIBLE
    assert np.isnan(given.gap)


def test_other_minima_count_neither_as_success_nor_as_failure():
    kinds = [GOOD, GOOD, GOOD, OTHER_MINIMUM, DEARER]
    verdicts = [Verdict(kind, gap, 0.0) for kind, gap in zip(kinds, (0, 0, 1e-5, 9.0, 0.5))]
    assert verdict.success_rate(verdicts) == 0.75
    assert verdict.max_gap(verdicts) == 0.5
    assert verdict.success_rate([Verdict(INFEASIBLE, np.nan, 1.0)]) == 0
    assert verdict.max_gap([Verdict(INFEASIBLE, np.nan, 1.0)]) == 0
