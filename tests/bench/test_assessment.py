"""Costs and residuals from the stage functions, and the assessment of answers."""

import numpy as np
import pytest
from assessment import GOOD, INFEASIBLE, OTHER_MINIMUM, WORSE, Assessor, PlanCost
from problems import Task

from stage_solver.reference_solvers import ReferenceSolver
from stage_solver.solution import SOLVED, SolverOptions
from stage_solver.stage_problem import Plan

IPOPT = SolverOptions(max_iterations=500, tolerance=1e-8)
P = np.ones((5, 1))
AT = 0.1


def straight_to(x):
    """A plan from AT to x in equal steps."""
    X = np.linspace(AT, x, 5)[:, None]
    return Plan(X, np.diff(X, axis=0))


@pytest.fixture(scope='module')
def assessor(wells):
    return Assessor(wells, compiled=False)


def assess(assessor, limits, start, plan):
    task = Task('warm', np.array([AT]), P, limits, start)
    return assessor.assess(task, plan)


def test_the_plan_cost_agrees_with_the_formula(wells, limits):
    plan, plan_cost = straight_to(0.9), PlanCost(wells)
    by_hand = 4 * 0.01 * 0.2**2 + (0.9**2 - 1) ** 2 + 1 - 0.09
    assert plan_cost.cost(plan, P) == pytest.approx(by_hand, rel=1e-12)
    assert plan_cost.residual(plan, np.array([AT]), P, limits) < 1e-15


def test_the_plan_cost_agrees_with_a_solver_on_the_control_problem(problem, recorded):
    fatrop = ReferenceSolver(problem, 'fatrop', SolverOptions())
    plan_cost = PlanCost(problem)
    for k in (0, 8):
        posed = recorded[k]
        numbers = posed.x0, posed.P, posed.bounds
        solution = fatrop.solve(*numbers, posed.cold)
        assert solution.status == SOLVED
        assert plan_cost.cost(solution.plan, numbers[1]) == pytest.approx(solution.cost, rel=1e-9)
        residual = plan_cost.residual(solution.plan, *numbers)
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
def test_every_limit_is_checked(wells, limits, limit, value, expected):
    tight = limits._replace(**{limit: np.full_like(getattr(limits, limit), value)})
    residual = PlanCost(wells).residual(straight_to(0.9), np.array([AT]), P, tight)
    assert residual == pytest.approx(expected)


def test_the_dynamics_and_the_start_are_checked(wells, limits):
    plan_cost, plan = PlanCost(wells), straight_to(0.9)
    assert plan_cost.residual(plan, np.array([AT + 0.3]), P, limits) == pytest.approx(0.3)
    X = plan.X.copy()
    X[-1] += 0.25
    assert plan_cost.residual(plan._replace(X=X), np.array([AT]), P, limits) == pytest.approx(0.25)
    X[-1] = np.nan
    assert plan_cost.residual(plan._replace(X=X), np.array([AT]), P, limits) == np.inf


def test_row_0_of_the_state_bounds_does_not_count(wells, limits):
    low = limits.x_low.copy()
    low[0] = 1.0
    plan_cost = PlanCost(wells)
    assert (
        plan_cost.residual(straight_to(0.9), np.array([AT]), P, limits._replace(x_low=low)) < 1e-15
    )


def minimum(wells, limits, near):
    solution = ReferenceSolver(wells, 'ipopt', IPOPT).solve(
        np.array([AT]), P, limits, straight_to(near)
    )
    assert solution.status == SOLVED
    return solution.plan


def test_the_minimum_next_to_the_start_is_good(assessor, wells, limits):
    given = assess(assessor, limits, straight_to(1.2), minimum(wells, limits, 0.8))
    assert given.kind == GOOD
    assert abs(given.gap) < 1e-7


@pytest.mark.parametrize(('near', 'worse'), [(-1.0, True), (1.0, False)])
def test_the_other_well_is_another_minimum_whether_deeper_or_not(
    assessor, wells, limits, near, worse
):
    given = assess(assessor, limits, straight_to(-near), minimum(wells, limits, near))
    assert given.kind == OTHER_MINIMUM
    assert (given.gap > 0.05) == worse


def test_a_feasible_plan_on_the_slope_is_worse(assessor, limits):
    given = assess(assessor, limits, straight_to(1.0), straight_to(0.8))
    assert given.kind == WORSE
    assert given.gap > 1e-2


def test_a_plan_that_leaps_is_infeasible_however_low_its_cost_is(assessor, wells, limits):
    plan = minimum(wells, limits, 1.0)
    given = assess(assessor, limits, straight_to(1.0), plan._replace(U=0 * plan.U))
    assert given.kind == INFEASIBLE
    assert np.isnan(given.gap)
