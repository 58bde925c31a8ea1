"""The ladder of fallbacks: which level is driven for which reason, alone and in the controller."""

from types import SimpleNamespace

import numpy as np
import pytest

from mpcc_controller.driving.fallback import BRAKING, RECOVERY, SHIFTED, Plans
from mpcc_controller.driving.gate import Gate
from mpcc_controller.driving.records import unknown_state
from mpcc_controller.parameters import Fallback
from msgs_yaml import conformance, encode
from stage_solver.solution import FAILED, ONE_STEP, SOLVED, STOPPED_EARLY, Solution
from stage_solver.stage_problem import Plan

TICK = 50_000_000
RULES = Fallback(
    acceptable_residual=1e-3,
    max_plan_age=3,
    failures_to_cold_start=2,
    max_guide_age=5,
    max_state_age_s=0.2,
    recovery=None,
)


def solution(status=SOLVED, residual=1e-9, **plan):
    values = {'X': np.zeros((3, 9)), 'U': np.zeros((2, 4))} | plan
    return Solution(Plan(**values), 1.0, status, '', 5, residual, 1e-9, 0.01)


GOOD = [
    (solution(), (SOLVED, 'converged')),
    (solution(ONE_STEP, 1.0), (SOLVED, 'one_step')),  # by the limit of the solver
    (solution(STOPPED_EARLY, 0.0), (STOPPED_EARLY, 'good_enough')),
    (solution(STOPPED_EARLY, 1e-3), (STOPPED_EARLY, 'good_enough')),
]
BAD = [
    (solution(FAILED), 'solver_failed'),
    (solution('aborted'), 'solver_failed'),
    (solution(STOPPED_EARLY, 1.01e-3), 'plan_not_feasible'),
    (solution(STOPPED_EARLY, np.inf), 'plan_not_feasible'),
    (solution(STOPPED_EARLY, np.nan), 'plan_not_feasible'),
    (solution(U=np.full((2, 4), np.nan)), 'plan_not_finite'),
    (solution(X=np.full((3, 9), np.inf)), 'plan_not_finite'),
    (solution(FAILED, X=np.full((3, 9), np.nan)), 'plan_not_finite'),
]


SHIFTED_PLAN = solution().plan
FOLLOWED = Plans(solution().plan, age=1, failures=1, good=solution().plan, good_age=1)
OLD = FOLLOWED._replace(age=RULES.max_plan_age)


def touches(plan):
    """Return an objection to one plan, and another one to all others."""
    return lambda other: 'plan_touches' if other is plan else 'not this one'


@pytest.mark.parametrize(('solved', 'expected'), GOOD)
def test_a_usable_solution_is_followed_unless_there_is_an_objection(solved, expected):
    plans, decision = FOLLOWED.decide(RULES, solved, SHIFTED_PLAN, sliding=True)
    assert decision == (*expected, solved.plan)
    assert plans == Plans(solved.plan, good=solved.plan)
    plans, decision = FOLLOWED.decide(RULES, solved, SHIFTED_PLAN, False, touches(solved.plan))
    assert decision == (BRAKING, 'plan_touches', None)
    assert plans == Plans(good=FOLLOWED.good, good_age=2)


@pytest.mark.parametrize(('bad', 'reason'), BAD)
def test_without_one_the_last_plan_is_followed_while_it_may_be(bad, reason):
    plans, decision = FOLLOWED.decide(RULES, bad, SHIFTED_PLAN)
    assert decision == (SHIFTED, reason, SHIFTED_PLAN)
    assert plans == Plans(SHIFTED_PLAN, 2, 2, FOLLOWED.good, 2)
    for before, shifted, sliding, objection, expected in (
        (FOLLOWED, SHIFTED_PLAN, False, touches(SHIFTED_PLAN), (BRAKING, 'plan_touches', None)),
        (FOLLOWED, SHIFTED_PLAN, True, touches(SHIFTED_PLAN), (RECOVERY, reason, None)),
        (OLD, SHIFTED_PLAN, False, touches(SHIFTED_PLAN), (BRAKING, reason, None)),
        (
            Plans(good=FOLLOWED.good, good_age=1, failures=1),
            None,
            False,
            None,
            (BRAKING, reason, None),
        ),
    ):
        plans, decision = before.decide(RULES, bad, shifted, sliding, objection)
        assert decision == expected
        assert plans == Plans(None, 0, 2, FOLLOWED.good, 2)


def test_a_lost_state_is_no_failure_of_the_solver_and_braking_may_be_recovery():
    plans, decision = FOLLOWED.follow_shifted(RULES, 'state_stale', SHIFTED_PLAN)
    assert decision == (SHIFTED, 'state_stale', SHIFTED_PLAN)
    assert plans == Plans(SHIFTED_PLAN, 2, 1, FOLLOWED.good, 2)
    for sliding, level in ((False, BRAKING), (True, RECOVERY)):
        plans, decision = FOLLOWED.brake('too_slow', sliding)
        assert decision == (level, 'too_slow', None)
        assert plans == Plans(None, 0, 1, FOLLOWED.good, 2)


def test_what_is_left_of_plans_depends_on_failures_and_age():
    assert FOLLOWED.is_warm(RULES)
    assert not FOLLOWED._replace(failures=RULES.failures_to_cold_start).is_warm(RULES)
    assert not Plans().is_warm(RULES)
    oldest = FOLLOWED._replace(good_age=RULES.max_guide_age)
    assert oldest.guide(RULES) is FOLLOWED.good
    assert oldest._replace(good_age=RULES.max_guide_age + 1).guide(RULES) is None
    assert FOLLOWED.discard() == Plans(failures=1, good_age=1)


# in the controller: each row forces a level by what the solver does or what the tick is given


def fail(solution):
    return solution._replace(status=FAILED)


def early(solution):
    return solution._replace(status=STOPPED_EARLY, primal_residual=1e-5)


def explode(solution):
    raise RuntimeError('nobody expected this')


def jump(solution):
    """Return a solution whose first set-point no actuator can reach."""
    X = solution.plan.X.copy()
    X[1, 7] += 0.3
    return solution._replace(plan=solution.plan._replace(X=X))


def decision(why):
    """Return level, reason and the line that the car brakes along."""
    return why.values['rung'], why.values['reason'], why.values.get('guide')


@pytest.fixture
def step(controller, world, modify_solver):
    """Return a function that answers the state of a tick; every report obeys the contract."""

    def answer(k, X=None, modify=lambda solution: solution, known=True, fault='', **changes):
        modify_solver(modify)
        x = world.rolling(X=25.0 + k if X is None else X, stamp_ns=(k + 1) * TICK)._replace(
            **changes
        )
        x = x if known else unknown_state(x.stamp_ns)
        command, prediction, why = world.tick(controller, x, fault=fault)
        assert not conformance.check('/controller/why', encode.why(why))
        return SimpleNamespace(
            command=command,
            force=command.Fxf + command.Fxr,
            prediction=prediction,
            why=why,
            decision=decision(why),
        )

    return answer


@pytest.mark.parametrize(
    ('tick', 'expected'),
    [
        ({}, (SOLVED, 'converged', None)),
        ({'modify': early}, (STOPPED_EARLY, 'good_enough', None)),
        ({'modify': fail}, (BRAKING, 'solver_failed', 'path')),
        ({'known': False, 'fault': 'state_stale'}, (BRAKING, 'state_stale', 'none')),
    ],
)
def test_the_level_of_a_first_tick(step, tick, expected):
    answer = step(0, X=45.0, Y=-0.5, **tick)
    assert answer.decision == expected
    if expected[0] == BRAKING:
        assert answer.force < 0
        assert len(answer.prediction.X) == bool(tick.get('known', True))
        back_to_the_path = answer.command.delta > 0.005  # which bends to the left
        assert back_to_the_path if tick.get('known', True) else answer.command.delta == 0.0


@pytest.mark.parametrize('missing', ['path', 'road', 'obstacles'])
def test_the_reason_names_an_input_that_is_missing(controller, step, missing):
    controller.scene = controller.scene._replace(**{missing: None})
    answer = step(0)
    assert answer.decision == (BRAKING, f'no_{missing}', 'none' if missing == 'path' else 'path')
    assert answer.command.Fxf < 0


@pytest.mark.parametrize(
    ('tick', 'reason'),
    [
        ({'modify': fail}, 'solver_failed'),
        ({'modify': explode}, 'solver_failed'),
        ({'known': False}, 'state_not_finite'),
        ({'known': False, 'fault': 'state_stale'}, 'state_stale'),
    ],
)
def test_the_last_plan_goes_on_for_five_ticks_then_the_car_brakes_along_it(
    controller, step, tick, reason
):
    step(0, X=40.0)
    planned = controller.memory.plans.plan.X[:, 7]
    answers = [step(k, X=40.0 + 0.2 * k, **tick) for k in range(1, 8)]
    assert [a.decision for a in answers[:5]] == [(SHIFTED, reason, None)] * 5
    assert [a.decision for a in answers[5:]] == [(BRAKING, reason, 'plan')] * 2
    assert [a.command.delta for a in answers[:5]] == pytest.approx(planned[2:7], abs=1e-9)
    assert [len(a.prediction.X) for a in answers] == [51] * 5 + [1] * 2
    assert answers[6].force < answers[5].force < 0
    if 'modify' in tick:
        assert [a.why.values['plan.age'] for a in answers] == [1, 2, 3, 4, 5, 0, 0]
    if tick.get('modify') is explode:
        assert answers[0].why.values['solver.message'] == 'nobody expected this'
    assert not controller.memory.rejections
    assert step(8, X=42.0).decision[0] == SOLVED


def test_the_least_speed_has_a_hysteresis_and_the_braking_car_steers_and_reports(controller, step):
    decisions = []
    for k, v in enumerate((7.2, 6.9, 7.5, 7.9, 8.1)):
        answer = step(k, X=60.0 + 0.3 * k, Y=2.0, psi=0.1, vx=v)
        decisions.append(answer.decision)
        if k == 1:
            assert answer.command.delta != 0
            gap = np.hypot(60.3 - 72.0, 2.0 - 1.5) - 1.0 - 1.1
            assert answer.why.values['v2o.1'] == pytest.approx(gap, abs=1e-5)
            begin = controller.memory.ramp.begin.delta
            assert answer.why.values['set_point.delta'] == begin
    assert [d[0] for d in decisions] == [SOLVED, BRAKING, BRAKING, BRAKING, SOLVED]
    assert decisions[1] == (BRAKING, 'too_slow', 'plan')


def test_past_the_end_of_the_path_the_car_brakes_straight_ahead(controller, step):
    X, Y = (column[-1] for column in controller.scene.path.arcs[:2])
    assert step(0, X=X - 1.0, Y=Y).decision[0] == SOLVED
    answer = step(1, X=X + 1.0, Y=Y)
    assert answer.decision[:2] == (BRAKING, 'path_ended')
    assert answer.force < 0
    assert abs(answer.command.delta) < 0.01


def test_with_stale_surroundings_it_brakes_along_the_last_plan_and_starts_cold(step):
    step(0)
    braking = step(1, fault='edges_stale')
    assert braking.decision == (BRAKING, 'edges_stale', 'plan')
    assert 'time.solve_ms' not in braking.why.values
    again = step(2)
    assert again.decision[:2] == (SOLVED, 'converged')
    assert not again.why.values['solver.warm']


def test_a_stale_state_that_is_noticed_late_is_answered_with_the_plan_of_now(controller, step):
    for k in range(8):
        step(k, X=40.0 + k)
    steering = controller.memory.plans.plan.X[:, 7]
    answer = step(9, known=False, fault='state_stale')
    assert answer.decision == (SHIFTED, 'state_stale', None)
    assert answer.command.delta == pytest.approx(steering[3], abs=1e-9)


# a command that the gate turns back


def test_a_command_that_the_gate_rejects_is_replaced_by_braking_along_the_path(controller, step):
    before = step(0, X=45.0, Y=-0.5)
    answer = step(1, X=46.0, Y=-0.5, modify=jump)
    values = answer.why.values
    assert answer.decision == (BRAKING, 'command_turned_back', 'path')
    assert (values['gate'], values['gate.rejections'], values['gate.too_fast']) == (
        'too_fast',
        1,
        1,
    )
    assert (answer.why.level, len(answer.prediction.X)) == (2, 1)
    assert answer.force < before.force
    assert answer.command.delta > before.command.delta  # back to the path
    assert controller.memory.last == answer.command


def test_after_a_second_rejection_the_last_command_is_held(step, monkeypatch):
    before = step(0, X=45.0, Y=-0.5).command
    monkeypatch.setattr(Gate, '_in_rate', lambda self, command, last: False)
    answer = step(1, X=46.0, Y=-0.5, modify=jump)
    assert (answer.why.values['gate'], answer.why.values['gate.rejections']) == ('too_fast', 2)
    assert (answer.command.delta, answer.command.d_delta) == (before.delta, 0.0)


def test_a_command_out_of_time_neither_releases_the_brakes_nor_costs_the_plan(
    controller, world, step
):
    before = step(0, fault='obstacles_stale')
    x = world.rolling(X=26.0, stamp_ns=2 * TICK)
    late, _, why = world.tick(controller, x, fault='obstacles_stale', age_s=0.3)
    assert why.values['gate'] == 'too_old'
    assert late.Fxf + late.Fxr == before.force < 0
    step(2)
    assert step(2, X=28.0).why.values['gate'] == 'not_newer'  # the same stamp again
    assert controller.memory.rejections == {'too_old': 1, 'not_newer': 1}
    held = controller.memory.last
    after = step(4)
    assert after.why.values['set_point.delta'] == held.delta  # the plan begins at the substitute
    assert (after.decision[0], after.why.values['solver.warm']) == (SOLVED, True)


# the guess of the next solve


def test_failures_drop_first_the_dual_and_after_three_the_primal_warm_start(
    controller, world, modify_solver
):
    world.tick(controller, world.rolling(X=25.0))
    solves = modify_solver(fail)
    ticks = [world.rolling(X=25.0 + k, stamp_ns=k * TICK) for k in range(1, 5)]
    warm = [world.tick(controller, x)[2].values['solver.warm'] for x in ticks]
    assert warm == [True, True, True, False]
    assert [g.multipliers is None for g in solves.guesses] == [False, True, True, True]
    # the guess along the path has no side slip; a shifted plan has
    vy = [np.abs(g.X[1:, 4]).max() for g in solves.guesses]
    assert min(vy[:3]) > 0
    assert vy[3] == 0
