"""Which rung is taken, when plans are given up, and how the ladder is climbed again."""

import numpy as np
import pytest

from mpcc_controller.driving import ladder as rungs
from mpcc_controller.driving.ladder import BRAKING, SECOND, SHIFTED, Ladder
from mpcc_controller.parameters import Fallback
from stage_solver.solution import FAILED, ONE_STEP, SOLVED, STOPPED_EARLY, Solution
from stage_solver.stage_problem import Plan

RULES = Fallback(
    acceptable_residual=1e-3,
    max_plan_age=5,
    failures_to_cold_start=3,
    max_guide_age=8,
    max_state_age_s=0.2,
)
PLAN = Plan(np.zeros((3, 9)), np.zeros((2, 4)))
OTHER = Plan(np.ones((3, 9)), np.ones((2, 4)))


def outcome(status=SOLVED, residual=1e-9, plan=PLAN):
    return Solution(plan, 1.0, status, 'told', 5, residual, 1e-9, 0.01)


BAD = outcome(FAILED)


@pytest.fixture
def ladder():
    return Ladder(RULES)


def state(ladder):
    return ladder.plan, ladder.age, ladder.failures, ladder.good, ladder.good_age


def test_at_the_start_there_is_no_plan_to_follow_to_steer_along_or_to_start_from(ladder):
    assert state(ladder) == (None, 0, 0, None, 0)
    assert not ladder.is_warm
    assert ladder.guide is None


def test_the_rungs_and_their_reasons_have_the_names_that_are_documented():
    assert (SECOND, SHIFTED, BRAKING) == ('second_solver', 'shifted', 'braking')
    assert rungs.FRESH == {
        'solved': ('solved', 'converged'),
        'one_step': ('solved', 'one_step'),
        'stopped_early': ('stopped_early', 'good_enough'),
    }


def test_a_solved_plan_is_followed(ladder):
    assert ladder.decide(outcome(), None, None) == (SOLVED, 'converged', PLAN)
    assert ladder.is_warm
    assert state(ladder) == (PLAN, 0, 0, PLAN, 0)
    assert ladder.guide is PLAN


def test_the_plan_of_one_step_is_followed_like_a_solved_one(ladder):
    # the solver has judged its residual by a limit of its own
    one_step = outcome(ONE_STEP, residual=1.0)
    assert ladder.decide(one_step, None, None) == (SOLVED, 'one_step', PLAN)
    assert state(ladder) == (PLAN, 0, 0, PLAN, 0)


@pytest.mark.parametrize('residual', [0.0, 1e-4, 1e-3])
def test_a_plan_stopped_early_is_followed_when_it_is_nearly_feasible(ladder, residual):
    taken = ladder.decide(outcome(STOPPED_EARLY, residual), None, OTHER)
    assert taken == (STOPPED_EARLY, 'good_enough', PLAN)
    assert state(ladder) == (PLAN, 0, 0, PLAN, 0)


def test_a_status_is_a_word_not_an_object(ladder):
    assert ladder.decide(outcome('SOLVED'.lower()), None, None).reason == 'converged'
    early = outcome('STOPPED_EARLY'.lower())
    assert ladder.decide(early, None, None).reason == 'good_enough'


FAULTS = [
    (outcome(FAILED), 'solver_failed'),
    (outcome('a word nobody knows'), 'solver_failed'),
    (outcome('what nobody knows'), 'solver_failed'),
    (outcome(STOPPED_EARLY, residual=1.01e-3), 'plan_not_feasible'),
    (outcome(STOPPED_EARLY, residual=np.inf), 'plan_not_feasible'),
    (outcome(STOPPED_EARLY, residual=np.nan), 'plan_not_feasible'),
    (outcome(plan=PLAN._replace(U=PLAN.U * np.nan)), 'plan_not_finite'),
    (outcome(plan=PLAN._replace(X=PLAN.X + np.inf)), 'plan_not_finite'),
    (outcome(FAILED, plan=PLAN._replace(X=PLAN.X * np.nan)), 'plan_not_finite'),
]


@pytest.mark.parametrize(('solution', 'reason'), FAULTS)
def test_a_bad_solution_is_replaced_by_the_last_plan_moved_on(ladder, solution, reason):
    ladder.decide(outcome(), None, None)
    assert ladder.decide(solution, None, OTHER) == (SHIFTED, reason, OTHER)
    assert state(ladder) == (OTHER, 1, 1, PLAN, 1)


@pytest.mark.parametrize(('solution', 'reason'), FAULTS)
def test_a_bad_solution_is_replaced_by_that_of_the_second_solver_first(ladder, solution, reason):
    assert ladder.decide(solution, outcome(plan=OTHER), PLAN) == (SECOND, reason, OTHER)
    assert state(ladder) == (OTHER, 0, 1, OTHER, 0)


@pytest.mark.parametrize('second', [solution for solution, _ in FAULTS])
def test_a_second_solver_that_fails_too_changes_nothing(ladder, second):
    ladder.decide(outcome(), None, None)
    assert ladder.decide(BAD, second, OTHER) == (SHIFTED, 'solver_failed', OTHER)
    assert state(ladder) == (OTHER, 1, 1, PLAN, 1)


def test_the_second_solver_does_not_replace_a_good_plan(ladder):
    assert ladder.decide(outcome(), outcome(plan=OTHER), None).plan is PLAN


def test_without_a_last_plan_a_bad_solution_means_braking(ladder):
    assert ladder.decide(BAD, None, None) == (BRAKING, 'solver_failed', None)
    assert state(ladder) == (None, 0, 1, None, 1)


def test_a_plan_is_followed_for_five_ticks_at_most(ladder):
    ladder.decide(outcome(), None, None)
    taken, ages = [], []
    for _ in range(7):
        taken.append(ladder.decide(BAD, None, ladder.plan).rung)
        ages.append(ladder.age)
    assert taken == [SHIFTED] * 5 + [BRAKING] * 2
    assert ages == [1, 2, 3, 4, 5, 0, 0]
    assert ladder.plan is None


def test_the_second_solver_s_plan_makes_the_plan_young_again(ladder):
    ladder.decide(outcome(), None, None)
    for _ in range(4):
        ladder.decide(BAD, None, ladder.plan)
    ladder.decide(BAD, outcome(), ladder.plan)
    assert (ladder.age, ladder.good_age, ladder.failures) == (0, 0, 5)
    # but the first solver does not start from what it failed to solve five times
    assert ladder.plan is PLAN
    assert not ladder.is_warm


def test_three_failures_drop_the_warm_start_and_one_success_brings_it_back(ladder):
    ladder.decide(outcome(), None, None)
    warm = []
    for _ in range(3):
        ladder.decide(BAD, None, ladder.plan)
        warm.append(ladder.is_warm)
    assert warm == [True, True, False]
    ladder.decide(outcome(), None, ladder.plan)
    assert ladder.is_warm
    assert (ladder.failures, ladder.age, ladder.good_age) == (0, 0, 0)


def test_the_car_steers_along_the_last_good_plan_while_that_is_young(ladder):
    ladder.decide(outcome(), None, None)
    guides = []
    for k in range(10):
        ladder.decide(BAD, None, ladder.plan if k < 2 else None)
        guides.append(ladder.guide)
    assert guides == [PLAN] * 8 + [None] * 2
    assert ladder.good_age == 10


def test_braking_gives_up_the_plan_but_not_the_line_that_it_followed(ladder):
    ladder.decide(outcome(), None, None)
    ladder.without_solution('state_not_finite', OTHER)
    assert ladder.brake('too_slow') == (BRAKING, 'too_slow', None)
    assert state(ladder) == (None, 0, 0, PLAN, 2)
    assert not ladder.is_warm
    assert ladder.guide is PLAN


def test_ticks_without_a_state_count_no_failure_of_the_solver(ladder):
    ladder.decide(outcome(), None, None)
    taken = [ladder.without_solution('state_not_finite', OTHER) for _ in range(6)]
    assert taken[:5] == [(SHIFTED, 'state_not_finite', OTHER)] * 5
    assert taken[5] == (BRAKING, 'state_not_finite', None)
    assert ladder.failures == 0


def test_a_plan_whose_command_was_turned_back_is_neither_followed_nor_steered_along(ladder):
    ladder.decide(outcome(), None, None)
    ladder.decide(BAD, None, OTHER)
    ladder.distrust()
    assert state(ladder) == (None, 0, 1, None, 1)
    assert ladder.guide is None
    assert ladder.decide(outcome(), None, None).rung == SOLVED
    assert ladder.guide is PLAN
