"""Every fallback level, forced in the controller with its reason."""

import numpy as np
import pytest

from mpcc_controller.driving.fallback import BRAKING, SHIFTED
from mpcc_controller.driving.records import TickInputs, unknown_state
from msgs_yaml import conformance, encode
from stage_solver.solution import FAILED, SOLVED, STOPPED_EARLY

TICK = 50_000_000


def fail(solution):
    return solution._replace(status=FAILED)


def early(solution):
    return solution._replace(status=STOPPED_EARLY, primal_residual=1e-5)


def level_and_reason(controller, x):
    record = controller.step(TickInputs(x))
    _, why = controller.report(record)
    return why.values['rung'], why.values['reason']


def test_level_1_a_converged_plan(controller, world):
    assert level_and_reason(controller, world.rolling(X=25.0)) == (SOLVED, 'converged')


def test_level_2_a_plan_stopped_early_that_is_good_enough(controller, world, modify_solver):
    modify_solver(early)
    assert level_and_reason(controller, world.rolling(X=25.0)) == (STOPPED_EARLY, 'good_enough')


def test_a_solver_that_raises_counts_as_failed(controller, world, modify_solver):
    def raise_(solution):
        raise RuntimeError('nobody expected this')

    world.tick(controller, world.rolling(X=25.0))
    modify_solver(raise_)
    *_, why = world.tick(controller, world.rolling(X=26.0, stamp_ns=TICK))
    v = why.values
    assert (v['rung'], v['reason']) == (SHIFTED, 'solver_failed')
    assert v['solver.message'] == 'nobody expected this'
    assert not conformance.check('/controller/why', encode.why(why))


def test_level_3_the_shifted_plan_for_five_ticks_then_level_5_braking(
    controller, world, modify_solver
):
    x = world.rolling(X=25.0)
    world.tick(controller, x)
    planned = controller.memory.plans.plan.X[:, 7]
    modify_solver(fail)
    decisions, commands, whys = [], [], []
    for k in range(1, 8):
        command, _, why = world.tick(controller, x._replace(stamp_ns=k * TICK))
        decisions.append((why.values['rung'], why.values['reason'], why.values['plan.age']))
        commands.append(command)
        whys.append(why.values)
    assert decisions[:5] == [(SHIFTED, 'solver_failed', age) for age in range(1, 6)]
    assert decisions[5:] == [(BRAKING, 'solver_failed', 0)] * 2
    assert [c.delta for c in commands[:5]] == pytest.approx(planned[2:7], abs=1e-9)
    assert [v.get('guide') for v in whys] == [None] * 5 + ['plan'] * 2
    assert commands[6].Fxf + commands[6].Fxr < commands[5].Fxf + commands[5].Fxr < 0
    assert not controller.memory.rejections


def test_level_5_without_a_plan_the_car_brakes_along_the_path(controller, world, modify_solver):
    modify_solver(fail)
    command, prediction, why = world.tick(controller, world.rolling(X=45.0, Y=-0.5))
    assert (why.values['rung'], why.values['guide']) == (BRAKING, 'path')
    assert command.delta > 0.005  # back to the path, which bends to the left
    assert command.Fxf + command.Fxr < 0
    assert len(prediction.X) == 1


def test_level_5_switches_to_the_path_when_the_last_plan_is_too_old(
    controller, world, modify_solver, monkeypatch
):
    world.tick(controller, world.rolling(X=25.0))
    modify_solver(fail)
    lookahead_lines = []
    for k in range(1, 34):
        x = world.rolling(X=25.0 + 0.2 * k, stamp_ns=k * TICK)
        lookahead_lines.append(world.tick(controller, x)[2].values.get('guide'))
    oldest = controller.params.fallback.max_guide_age
    assert lookahead_lines == [None] * 5 + ['plan'] * (oldest - 5) + ['path'] * (33 - oldest)


@pytest.mark.parametrize('missing_input', ['path', 'road', 'obstacles'])
def test_level_5_the_reason_names_the_missing_input(controller, world, missing_input):
    controller.scene = controller.scene._replace(**{missing_input: None})
    command, prediction, why = world.tick(controller, world.rolling(X=25.0))
    assert (why.values['rung'], why.values['reason']) == (BRAKING, f'no_{missing_input}')
    assert why.values['guide'] == ('none' if missing_input == 'path' else 'path')
    assert command.Fxf < 0
    assert len(prediction.X) == 1


def test_level_5_a_car_that_is_too_slow_still_steers_and_reports_its_distances(controller, world):
    world.tick(controller, world.rolling(v=7.2, X=60.0, Y=2.0, psi=0.1))
    x = world.rolling(v=6.0, X=60.3, Y=2.0, psi=0.1, stamp_ns=TICK)
    command, _, why = world.tick(controller, x)
    assert (why.values['rung'], why.values['reason']) == (BRAKING, 'too_slow')
    assert why.values['guide'] == 'plan'
    assert command.delta != 0
    gap = np.hypot(x.X - 72.0, x.Y - 1.5) - 1.0 - 1.1
    assert why.values['v2o.1'] == pytest.approx(gap, abs=1e-5)
    assert why.values['v2e.left'] == pytest.approx(6.0 - 2.0 - 1.1, abs=1e-3)
    assert why.values['v2e.right'] == pytest.approx(2.0 + 2.5 - 1.1, abs=1e-3)
    assert why.values['set_point.delta'] == pytest.approx(controller.active_ramp.begin.delta)


def test_level_5_past_the_end_of_the_path_the_car_brakes_straight_ahead(controller, world):
    X, Y = (column[-1] for column in controller.scene.path.arcs[:2])
    before = world.tick(controller, world.rolling(X=X - 1.0, Y=Y))[2]
    assert before.values['rung'] == 'solved'
    command, _, why = world.tick(controller, world.rolling(X=X + 1.0, Y=Y, stamp_ns=TICK))
    assert (why.values['rung'], why.values['reason']) == (BRAKING, 'path_ended')
    assert command.Fxf < 0
    assert abs(command.delta) < 0.01


def test_without_a_finite_state_the_plan_is_followed_for_five_ticks_then_braked_along(
    controller, world
):
    world.tick(controller, world.rolling(X=40.0))
    planned = controller.memory.plans.plan.X[:, 7]
    commands, decisions = [], []
    for k in range(1, 8):
        command, prediction, why = world.tick(controller, unknown_state(k * TICK))
        commands.append(command)
        decisions.append((why.values['rung'], why.values['reason'], why.values.get('guide')))
        assert np.isfinite(command).all()
        assert len(prediction.X) == (51 if k <= 5 else 1)
        assert not conformance.check('/controller/why', encode.why(why))
    assert decisions[:5] == [(SHIFTED, 'state_not_finite', None)] * 5
    assert decisions[5:] == [(BRAKING, 'state_not_finite', 'plan')] * 2
    assert [c.delta for c in commands[:5]] == pytest.approx(planned[2:7], abs=1e-9)
    # with a state again, it drives on
    assert level_and_reason(controller, world.rolling(X=47.0, stamp_ns=8 * TICK))[0] == SOLVED


def test_a_state_that_returns_in_time_keeps_the_warm_start(controller, world):
    world.tick(controller, world.rolling(X=40.0))
    world.tick(controller, unknown_state(TICK))
    *_, why = world.tick(controller, world.rolling(X=42.0, stamp_ns=2 * TICK))
    assert why.values['rung'] == SOLVED
    assert why.values['solver.warm']
    assert (why.values['plan.age'], why.values['plan.failures']) == (0, 0)
