"""Which candidate is driven: the cheapest good one, without dithering and without waiting."""

import dataclasses

import numpy as np
import pytest

from mpcc_controller.driving import choose
from mpcc_controller.driving.choose import Outcome
from mpcc_controller.driving.ways import BEHIND, LEFT, RIGHT, are_opposed
from stage_solver.solution import SOLVED, Solution
from stage_solver.stage_problem import Plan

PLAN = Plan(np.zeros((3, 9)), np.zeros((2, 4)))
LEFT_OF_1, RIGHT_OF_1, BEHIND_1 = {1: LEFT}, {1: RIGHT}, {1: BEHIND}
NO_SIDES = {}


def outcome(cost, sides=LEFT_OF_1, rejection='', gap=0.3, off_road=0.0, later=0.0):
    solution = Solution(PLAN, cost, SOLVED, '', 5, 0.0, 0.0, 0.0)
    return Outcome('name', None, solution, rejection, sides, gap, off_road, later=later)


@pytest.fixture
def chooser(params):
    return Chooser(dataclasses.replace(params.candidates, hold_ticks=3))


class Chooser:
    """Choices of successive ticks."""

    def __init__(self, params):
        self.params, self.hold = params, 0

    def choose(self, outcomes, path_sides):
        choice, self.hold = choose.choose(outcomes, path_sides, self.hold, self.params)
        return choice


def test_the_cheapest_plan_is_driven_when_it_is_cheaper_by_the_share(chooser):
    enough, too_little = outcome(97.9, RIGHT_OF_1), outcome(98.1, RIGHT_OF_1)
    assert chooser.choose([outcome(100.0), too_little], NO_SIDES).chosen == 0
    assert chooser.choose([outcome(100.0), too_little, enough], NO_SIDES).chosen == 2


def test_a_plan_that_has_to_regain_its_speed_afterwards_is_dearer(chooser):
    waits, passes = outcome(100.0, BEHIND_1, later=20.0), outcome(110.0, later=5.0)
    assert chooser.choose([waits, passes], NO_SIDES).chosen == 1
    assert chooser.choose([outcome(100.0, BEHIND_1), outcome(110.0)], NO_SIDES).chosen == 0


def test_after_a_switch_the_larger_share_counts_for_the_ticks_of_the_parameter(chooser):
    followed, better = outcome(100.0), outcome(90.0, RIGHT_OF_1)
    assert chooser.choose([followed, better], NO_SIDES).switched
    chosen = [chooser.choose([followed, better], NO_SIDES).chosen for _ in range(3)]
    assert chosen == [0, 0, 1]  # two ticks of the three are left after that of the switch
    chooser.hold = 0
    assert chooser.choose([followed, better], NO_SIDES).chosen == 1


def test_a_much_cheaper_plan_is_driven_even_right_after_a_switch(chooser):
    assert chooser.choose([outcome(100.0), outcome(90.0, RIGHT_OF_1)], NO_SIDES).switched
    assert chooser.choose([outcome(100.0), outcome(70.0, RIGHT_OF_1)], NO_SIDES).switched


def test_costs_that_cross_often_do_not_make_the_choice_dither(chooser):
    rng = np.random.default_rng(3)
    sides, switches = [LEFT_OF_1, RIGHT_OF_1], 0
    for _ in range(200):  # noise of 5 %: without memory every other tick
        costs = 100 * (1 + 0.05 * rng.uniform(-1, 1, 2))
        choice = chooser.choose([outcome(c, s) for c, s in zip(costs, sides)], NO_SIDES)
        if choice.switched:
            sides.reverse()
            switches += 1
    assert 0 < switches < 45


@pytest.mark.parametrize(
    'useless',
    [
        outcome(1.0, rejection='plan_not_feasible'),
        outcome(1.0, gap=-0.05),
        outcome(1.0, off_road=0.2),
    ],
    ids=['failed', 'contact', 'off_road'],
)
def test_a_useless_followed_plan_is_left_at_once_whatever_it_costs(chooser, useless):
    good = outcome(1e4, RIGHT_OF_1)
    chooser.choose([outcome(100.0), outcome(50.0, RIGHT_OF_1)], NO_SIDES)  # the share is larger
    assert chooser.choose([useless, good], NO_SIDES).chosen == 1
    assert chooser.choose([good, useless], NO_SIDES).chosen == 0


@pytest.mark.parametrize('gap', [0.001, -0.001, -0.015])
def test_a_millimetre_of_overlap_does_not_bypass_the_hysteresis(chooser, gap):
    followed, other = outcome(100.0, gap=gap), outcome(99.0, RIGHT_OF_1, gap=0.001)
    assert chooser.choose([followed, other], NO_SIDES).chosen == 0
    assert chooser.choose([other, followed], NO_SIDES).chosen == 0


def test_a_plan_that_touches_is_driven_before_one_that_did_not_converge(chooser):
    touches, failed = outcome(1e4, gap=-0.5), outcome(1.0, rejection='solver_failed')
    assert chooser.choose([failed, touches], NO_SIDES).chosen == 1


def test_when_all_plans_touch_the_cheapest_is_driven(chooser):
    plans = [outcome(cost, gap=-0.1) for cost in (50.0, 20.0, 30.0)]
    assert chooser.choose(plans, NO_SIDES).chosen == 1


def test_without_a_usable_plan_the_followed_one_is_chosen(chooser):
    plans = [outcome(np.nan, {}, 'solver_failed'), outcome(np.nan, {}, 'plan_not_finite')]
    choice = chooser.choose(plans, NO_SIDES)
    assert (choice.chosen, choice.switched) == (0, False)


def test_the_side_of_the_coarse_path_wins_unless_the_other_is_cheaper_by_more(chooser):
    left, right = outcome(100.0), outcome(95.0, RIGHT_OF_1)
    assert chooser.choose([left, right], LEFT_OF_1).chosen == 0
    assert chooser.choose([left, outcome(85.0, RIGHT_OF_1)], LEFT_OF_1).chosen == 1
    chooser.hold = 0
    assert chooser.choose([right, left], LEFT_OF_1).chosen == 1  # 104.5 against 100


def test_a_better_plan_on_the_same_side_is_no_switch(chooser):
    assert not chooser.choose([outcome(100.0), outcome(50.0)], NO_SIDES).switched
    assert not chooser.choose([outcome(100.0, BEHIND_1), outcome(50.0)], NO_SIDES).switched


def test_ways_are_opposed_where_one_obstacle_is_passed_on_both_sides():
    assert are_opposed({1: LEFT, 2: LEFT}, {2: RIGHT})
    assert not are_opposed({1: LEFT, 2: BEHIND}, {1: LEFT, 2: RIGHT})
    assert not are_opposed({1: LEFT}, {2: RIGHT})


def test_of_plans_that_run_into_an_obstacle_the_slower_one_is_driven(chooser):
    fast = outcome(10.0, gap=-1.0)._replace(contact_speed=15.0)
    slow = outcome(1e4, gap=-1.0)._replace(contact_speed=7.0)
    assert chooser.choose([fast, slow], NO_SIDES).chosen == 1
    assert chooser.choose([slow, fast], NO_SIDES).chosen == 0
    # a small difference of the speeds does not decide
    same = outcome(9.0, gap=-1.0)._replace(contact_speed=15.5)
    assert chooser.choose([fast, same], NO_SIDES).chosen == 1
