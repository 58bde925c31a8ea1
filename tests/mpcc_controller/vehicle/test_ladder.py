"""Which rung is taken, and when the last plan is given up."""

import numpy as np
import pytest

from mpcc_controller.ladder import BRAKING, SHIFTED, Ladder
from mpcc_controller.shooting import Plan
from mpcc_controller.solver import FAILED, SOLVED, STOPPED_EARLY, Solution

PLAN = Plan(np.zeros((3, 9)), np.zeros((2, 4)))


def outcome(status=SOLVED, residual=1e-9, plan=PLAN):
    return Solution(plan, 1.0, status, 'told', 5, residual, 1e-9, 0.01)


@pytest.fixture
def ladder(params):
    return Ladder(params.fallback)


def test_a_solved_plan_is_followed(ladder):
    assert ladder.decide(outcome(), None) == (SOLVED, 'converged', PLAN)
    assert ladder.is_warm


def test_a_plan_stopped_early_is_followed_when_it_is_nearly_feasible(ladder):
    taken = ladder.decide(outcome(STOPPED_EARLY, residual=1e-4), None)
    assert taken == (STOPPED_EARLY, 'good_enough', PLAN)


@pytest.mark.parametrize(
    ('solution', 'reason'),
    [
        (outcome(FAILED), 'solver_failed'),
        (outcome(STOPPED_EARLY, residual=0.1), 'plan_not_feasible'),
        (outcome(STOPPED_EARLY, residual=np.nan), 'plan_not_feasible'),
        (outcome(plan=PLAN._replace(U=PLAN.U * np.nan)), 'plan_not_finite'),
    ],
)
def test_a_bad_solution_is_replaced_by_the_last_plan_moved_on(ladder, solution, reason):
    ladder.decide(outcome(), None)
    moved = Plan(PLAN.X + 1, PLAN.U)
    assert ladder.decide(solution, moved) == (SHIFTED, reason, moved)
    assert ladder.plan is moved


def test_without_a_last_plan_a_bad_solution_means_braking(ladder):
    assert ladder.decide(outcome(FAILED), None) == (BRAKING, 'solver_failed', None)


def test_a_plan_is_followed_for_five_ticks_at_most(ladder):
    ladder.decide(outcome(), None)
    rungs = [ladder.decide(outcome(FAILED), ladder.plan).rung for _ in range(7)]
    assert rungs == [SHIFTED] * 5 + [BRAKING] * 2


def test_three_failures_drop_the_warm_start_and_one_success_brings_it_back(ladder):
    ladder.decide(outcome(), None)
    warm = []
    for _ in range(3):
        ladder.decide(outcome(FAILED), ladder.plan)
        warm.append(ladder.is_warm)
    assert warm == [True, True, False]
    ladder.decide(outcome(), ladder.plan)
    assert ladder.is_warm
    assert (ladder.failures, ladder.age) == (0, 0)
