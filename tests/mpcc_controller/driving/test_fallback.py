"""Which fallback level is chosen, when a plan is discarded, and how the logic recovers."""

import dataclasses

import numpy as np
import pytest

from mpcc_controller.driving import fallback
from mpcc_controller.driving.fallback import (
    BRAKING,
    RECOVERY,
    SHIFTED,
    Plans,
)
from stage_solver.solution import FAILED, ONE_STEP, SOLVED, STOPPED_EARLY, Solution
from stage_solver.stage_problem import Plan

PLAN = Plan(np.zeros((3, 9)), np.zeros((2, 4)))
OTHER = Plan(np.ones((3, 9)), np.ones((2, 4)))


def outcome(status=SOLVED, residual=1e-9, plan=PLAN):
    return Solution(plan, 1.0, status, 'message', 5, residual, 1e-9, 0.01)


BAD = outcome(FAILED)


class Logic:
    """The plans of successive ticks."""

    def __init__(self, params):
        self.params, self.plans = params, Plans()

    def decide(self, *arguments, **options):
        self.plans, decision = self.plans.decide(self.params, *arguments, **options)
        return decision

    def follow_shifted(self, *arguments):
        self.plans, decision = self.plans.follow_shifted(self.params, *arguments)
        return decision

    def brake(self, *arguments):
        self.plans, decision = self.plans.brake(*arguments)
        return decision

    @property
    def plan(self):
        return self.plans.plan

    @property
    def is_warm(self):
        return self.plans.is_warm(self.params)

    @property
    def guiding_plan(self):
        return self.plans.guide(self.params)


@pytest.fixture
def logic(params):
    return Logic(dataclasses.replace(params.fallback, max_guide_age=8))


def state(logic):
    return tuple(logic.plans)


def test_initially_there_is_no_plan_to_follow_no_guiding_plan_and_no_warm_start(logic):
    assert state(logic) == (None, 0, 0, None, 0)
    assert not logic.is_warm
    assert logic.guiding_plan is None


def test_levels_and_reasons_have_their_documented_names():
    assert (SHIFTED, BRAKING) == ('shifted', 'braking')
    assert fallback.USABLE == {
        'solved': ('solved', 'converged'),
        'one_step': ('solved', 'one_step'),
        'stopped_early': ('stopped_early', 'good_enough'),
    }


def test_a_solved_plan_is_followed(logic):
    assert logic.decide(outcome(), None) == (SOLVED, 'converged', PLAN)
    assert logic.is_warm
    assert state(logic) == (PLAN, 0, 0, PLAN, 0)
    assert logic.guiding_plan is PLAN


def test_the_plan_of_one_step_is_followed_like_a_solved_one(logic):
    # the solver has checked the residual against its own limit
    one_step = outcome(ONE_STEP, residual=1.0)
    assert logic.decide(one_step, None) == (SOLVED, 'one_step', PLAN)
    assert state(logic) == (PLAN, 0, 0, PLAN, 0)


@pytest.mark.parametrize('residual', [0.0, 1e-4, 1e-3])
def test_a_plan_stopped_early_is_followed_when_it_is_nearly_feasible(logic, residual):
    decision = logic.decide(outcome(STOPPED_EARLY, residual), OTHER)
    assert decision == (STOPPED_EARLY, 'good_enough', PLAN)
    assert state(logic) == (PLAN, 0, 0, PLAN, 0)


def test_a_status_is_compared_by_value_not_by_identity(logic):
    assert logic.decide(outcome('SOLVED'.lower()), None).reason == 'converged'
    early = outcome('STOPPED_EARLY'.lower())
    assert logic.decide(early, None, None).reason == 'good_enough'


FAULTS = [
    (outcome(FAILED), 'solver_failed'),
    (outcome('aborted'), 'solver_failed'),
    (outcome('unknown'), 'solver_failed'),
    (outcome(STOPPED_EARLY, residual=1.01e-3), 'plan_not_feasible'),
    (outcome(STOPPED_EARLY, residual=np.inf), 'plan_not_feasible'),
    (outcome(STOPPED_EARLY, residual=np.nan), 'plan_not_feasible'),
    (outcome(plan=PLAN._replace(U=PLAN.U * np.nan)), 'plan_not_finite'),
    (outcome(plan=PLAN._replace(X=PLAN.X + np.inf)), 'plan_not_finite'),
    (outcome(FAILED, plan=PLAN._replace(X=PLAN.X * np.nan)), 'plan_not_finite'),
]


@pytest.mark.parametrize(('solution', 'reason'), FAULTS)
def test_a_bad_solution_is_replaced_by_the_shifted_last_plan(logic, solution, reason):
    logic.decide(outcome(), None)
    assert logic.decide(solution, OTHER) == (SHIFTED, reason, OTHER)
    assert state(logic) == (OTHER, 1, 1, PLAN, 1)


def test_without_a_last_plan_a_bad_solution_means_braking(logic):
    assert logic.decide(BAD, None) == (BRAKING, 'solver_failed', None)
    assert state(logic) == (None, 0, 1, None, 1)


def test_a_plan_is_followed_for_five_ticks_at_most(logic):
    logic.decide(outcome(), None)
    levels, ages = [], []
    for _ in range(7):
        levels.append(logic.decide(BAD, logic.plan).level)
        ages.append(logic.plans.age)
    assert levels == [SHIFTED] * 5 + [BRAKING] * 2
    assert ages == [1, 2, 3, 4, 5, 0, 0]
    assert logic.plan is None


def test_three_failures_disable_the_warm_start_and_one_success_restores_it(logic):
    logic.decide(outcome(), None)
    warm = []
    for _ in range(3):
        logic.decide(BAD, logic.plan)
        warm.append(logic.is_warm)
    assert warm == [True, True, False]
    logic.decide(outcome(), logic.plan)
    assert logic.is_warm
    assert (logic.plans.failures, logic.plans.age, logic.plans.good_age) == (0, 0, 0)


def test_the_last_good_plan_guides_the_steering_until_its_maximum_age(logic):
    logic.decide(outcome(), None)
    guiding_plans = []
    for k in range(10):
        logic.decide(BAD, logic.plan if k < 2 else None)
        guiding_plans.append(logic.guiding_plan)
    assert guiding_plans == [PLAN] * 8 + [None] * 2
    assert logic.plans.good_age == 10


def test_braking_discards_the_plan_but_keeps_the_guiding_plan(logic):
    logic.decide(outcome(), None)
    logic.follow_shifted('state_not_finite', OTHER)
    assert logic.brake('too_slow') == (BRAKING, 'too_slow', None)
    assert state(logic) == (None, 0, 0, PLAN, 2)
    assert not logic.is_warm
    assert logic.guiding_plan is PLAN


def test_ticks_without_a_state_count_no_failure_of_the_solver(logic):
    logic.decide(outcome(), None)
    decisions = [logic.follow_shifted('state_not_finite', OTHER) for _ in range(6)]
    assert decisions[:5] == [(SHIFTED, 'state_not_finite', OTHER)] * 5
    assert decisions[5] == (BRAKING, 'state_not_finite', None)
    assert logic.plans.failures == 0


def test_a_plan_whose_command_was_rejected_neither_is_followed_nor_guides_the_steering(logic):
    logic.decide(outcome(), None)
    logic.decide(BAD, OTHER)
    logic.plans = logic.plans.discard()
    assert state(logic) == (None, 0, 1, None, 1)
    assert logic.guiding_plan is None
    assert logic.decide(outcome(), None).level == SOLVED
    assert logic.guiding_plan is PLAN


@pytest.mark.parametrize(
    ('solution', 'objected'), [(outcome(), PLAN), (BAD, OTHER)], ids=['solved', 'shifted']
)
def test_a_plan_with_an_objection_is_not_followed_whatever_level_it_is_from(
    logic, solution, objected
):
    logic.decide(outcome(), None)

    def objection(plan):
        return 'plan_touches' if plan is objected else ''

    decision = logic.decide(solution, OTHER, objection=objection)
    assert decision == (BRAKING, 'plan_touches', None)
    assert logic.plan is None
    assert logic.guiding_plan is PLAN  # to steer along while braking


def test_without_objection_the_same_plans_are_followed(logic):
    logic.decide(outcome(), None)
    decision = logic.decide(BAD, OTHER, objection=lambda plan: '')
    assert decision == (SHIFTED, 'solver_failed', OTHER)


def test_a_sliding_car_without_a_solution_is_recovered_and_follows_no_old_plan(logic):
    logic.decide(outcome(), None)
    assert logic.decide(BAD, OTHER, sliding=True) == (RECOVERY, 'solver_failed', None)
    assert logic.plan is None
