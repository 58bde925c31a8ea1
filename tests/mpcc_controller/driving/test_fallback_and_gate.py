"""The substitute command after a rejection by the gate."""

from mpcc_controller.driving.fallback import BRAKING
from mpcc_controller.driving.gate import Gate
from msgs_yaml import conformance, encode

TICK = 50_000_000


def jump(solution):
    """Return a solution whose first setpoint no actuator can reach."""
    X = solution.plan.X.copy()
    X[1, 7] += 0.3
    return solution._replace(plan=solution.plan._replace(X=X))


def test_a_command_that_the_gate_rejects_is_replaced_by_braking_along_the_path(
    controller, world, modify_solver
):
    before, _, _ = world.tick(controller, world.rolling(X=45.0, Y=-0.5))
    modify_solver(jump)
    command, prediction, why = world.tick(controller, world.rolling(X=46.0, Y=-0.5, stamp_ns=TICK))
    v = why.values
    assert (v['rung'], v['reason'], v['gate']) == (BRAKING, 'command_turned_back', 'too_fast')
    assert (v['guide'], v['gate.rejections'], v['gate.too_fast']) == ('path', 1, 1)
    assert why.level == 2
    assert len(prediction.X) == 1
    assert command.Fxf + command.Fxr < before.Fxf + before.Fxr
    assert command.delta > before.delta  # back to the path, which bends to the left
    assert controller.last_command == command
    assert not conformance.check('/controller/why', encode.why(why))


def test_after_a_second_rejection_the_last_command_is_held(
    controller, world, modify_solver, monkeypatch
):
    before, _, _ = world.tick(controller, world.rolling(X=45.0, Y=-0.5))
    modify_solver(jump)
    monkeypatch.setattr(Gate, '_in_rate', lambda self, command, last: False)
    command, _, why = world.tick(controller, world.rolling(X=46.0, Y=-0.5, stamp_ns=TICK))
    assert (why.values['gate'], why.values['gate.rejections']) == ('too_fast', 2)
    assert (command.delta, command.d_delta) == (before.delta, 0.0)


def test_a_late_tick_neither_releases_the_brakes_nor_costs_the_plan(controller, world):
    before, _, _ = world.tick(controller, world.rolling(X=45.0), fault='obstacles_stale')
    x = world.rolling(X=46.0, stamp_ns=TICK)
    late, _, why = world.tick(controller, x, fault='obstacles_stale', age_s=0.3)
    assert why.values['gate'] == 'too_old'
    assert late.Fxf + late.Fxr == before.Fxf + before.Fxr < 0
    world.tick(controller, world.rolling(X=47.0, stamp_ns=2 * TICK))
    *_, why = world.tick(controller, world.rolling(X=48.0, stamp_ns=3 * TICK), age_s=0.3)
    assert (why.values['rung'], why.values['gate']) == ('solved', 'too_old')
    *_, why = world.tick(controller, world.rolling(X=49.0, stamp_ns=4 * TICK))
    assert why.values['solver.warm']
