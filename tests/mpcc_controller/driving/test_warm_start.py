"""The warm start of a tick: plan and multipliers of the last tick, or neither after failures."""

from collections import Counter

import numpy as np

from stage_solver.solution import FAILED, SOLVED
from stage_solver.stage_problem import Multipliers

TICK = 50_000_000


def fail(solution):
    return solution._replace(status=FAILED)


def test_primal_and_dual_are_shifted_by_one_stage(controller, world, modify_solver):
    solves = modify_solver(lambda s: s)
    world.tick(controller, world.rolling(X=25.0))
    old = solves.solutions[-1].plan
    world.tick(controller, world.rolling(X=26.0, stamp_ns=TICK))
    guess = solves.guesses[-1]
    assert np.array_equal(guess.X[1:-1, :6], old.X[2:, :6])
    assert np.array_equal(guess.U[:-1], old.U[1:])
    for name in set(Multipliers._fields) - {'h'}:
        moved, before = getattr(guess.multipliers, name), getattr(old.multipliers, name)
        assert np.array_equal(moved[:-1], before[1:]), name
        assert np.array_equal(moved[-1], before[-1]), name
    assert np.array_equal(guess.multipliers.h, old.multipliers.h)


def test_failures_drop_first_the_dual_and_after_three_the_primal_warm_start(
    controller, world, modify_solver
):
    world.tick(controller, world.rolling(X=25.0))
    solves = modify_solver(fail)
    warm = []
    for k in range(1, 5):
        *_, why = world.tick(controller, world.rolling(X=25.0 + k, stamp_ns=k * TICK))
        warm.append(why.values['solver.warm'])
    assert warm == [True, True, True, False]
    assert [g.multipliers is None for g in solves.guesses] == [False, True, True, True]
    # the guess along the path has no side slip; a shifted plan has
    vy = [np.abs(g.X[1:, 4]).max() for g in solves.guesses]
    assert min(vy[:3]) > 0
    assert vy[3] == 0
    modify_solver(lambda s: s)
    *_, why = world.tick(controller, world.rolling(X=30.0, stamp_ns=5 * TICK))
    assert why.values['rung'] == SOLVED
    *_, why = world.tick(controller, world.rolling(X=31.0, stamp_ns=6 * TICK))
    assert why.values['solver.warm']


def test_a_command_out_of_time_is_counted_and_reported_and_its_plan_kept(controller, world):
    world.tick(controller, world.rolling(X=25.0, stamp_ns=TICK))
    command, _, why = world.tick(controller, world.rolling(X=26.0, stamp_ns=TICK))
    v = why.values
    assert (v['gate'], v['gate.rejections'], v['gate.not_newer']) == ('not_newer', 1, 1)
    assert why.level == 2
    assert controller.memory.rejections == Counter(not_newer=1)
    assert controller.memory.plans.plan is not None
    assert command.d_delta == 0
    # the next plan begins at the substitute
    *_, why = world.tick(controller, world.rolling(X=27.0, stamp_ns=2 * TICK))
    assert why.values['set_point.delta'] == command.delta
    assert why.values['rung'] == SOLVED
