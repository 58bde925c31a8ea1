"""What is driven when the gate turns a command back."""

from mpcc_controller.driving.fallback import BRAKING
from msgs_yaml import conformance, encode

TICK = 50_000_000


def jump(solution):
    """A plan whose first set-point no actuator reaches."""
    X = solution.plan.X.copy()
    X[1, 7] += 0.3
    return solution._replace(plan=solution.plan._replace(X=X))


def test_a_command_that_the_gate_turns_back_is_replaced_by_braking_along_the_path(
    changing, world, spoilt
):
    before, _, _ = world.tick(changing, world.rolling(X=45.0, Y=-0.5))
    spoilt(jump)
    command, prediction, why = world.tick(changing, world.rolling(X=46.0, Y=-0.5, stamp_ns=TICK))
    v = why.values
    assert (v['rung'], v['reason'], v['gate']) == (BRAKING, 'command_turned_back', 'too_fast')
    assert (v['guide'], v['gate.rejections'], v['gate.too_fast']) == ('path', 1, 1)
    assert why.level == 2
    assert len(prediction.X) == 1
    assert command.Fxf + command.Fxr < before.Fxf + before.Fxr
    assert command.delta > before.delta  # back to the path, which bends to the left
    assert changing.last_command == command
    assert not conformance.check('/controller/why', encode.why(why))


def test_a_braking_command_that_is_turned_back_too_holds_the_last_one(
    changing, world, spoilt, monkeypatch
):
    before, _, _ = world.tick(changing, world.rolling(X=45.0, Y=-0.5))
    spoilt(jump)
    monkeypatch.setattr(changing.gate, '_in_rate', lambda command, last: False)
    command, _, why = world.tick(changing, world.rolling(X=46.0, Y=-0.5, stamp_ns=TICK))
    assert (why.values['gate'], why.values['gate.rejections']) == ('too_fast', 2)
    assert (command.delta, command.d_delta) == (before.delta, 0.0)
