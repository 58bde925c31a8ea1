"""The receding horizon controller with the baseline's problem: reports and closed loop."""

import numpy as np
import pytest

from mpcc_controller.driving.controller import Controller
from mpcc_controller.driving.fallback import SHIFTED
from msgs_yaml import conformance, encode
from stage_solver.solution import FAILED, SOLVED


@pytest.fixture
def controller(baseline_controller):
    return baseline_controller


def test_the_report_agrees_with_the_solution_and_conforms_to_the_contract(controller, world):
    world.set_inputs(controller, world.lane_change())
    _, prediction, why = world.tick(controller, world.rolling(X=20.0, Y=0.3, psi=0.05, stamp_ns=1))
    costs = {name: value for name, value in why.values.items() if name.startswith('cost.')}
    assert set(costs) - {'cost.total', 'cost.slack', 'cost.slow'} == {
        f'cost.{name}' for name in ('e', 'dpsi', 'vel', 'd_delta', 'd_Fx', 'lambda_b', 'v2o', 'v2e')
    }
    assert why.values['cost.total'] == pytest.approx(why.values['solver.cost'], rel=1e-6)
    assert why.values['error.e'] == pytest.approx(0.3, abs=1e-6)
    assert why.values['error.dpsi'] == pytest.approx(0.05, abs=1e-6)
    assert conformance.check('/controller/why', encode.why(why)) == []
    assert (prediction.X[0], prediction.Y[0], prediction.psi[0]) == pytest.approx(
        (20.0, 0.3, 0.05), abs=1e-9
    )


def test_in_closed_loop_it_changes_lane_past_the_obstacle(controller, world):
    world.set_inputs(controller, world.lane_change())
    run = world.drive(controller, 90)
    assert {why.values['rung'] for why in run.whys} == {SOLVED}
    gap = np.hypot(run.states.X - 72.0, run.states.Y - 1.5).min() - 2.1
    assert gap > 0.3
    assert run.states.Y[-1] == pytest.approx(3.5, abs=0.4)


def test_a_failure_follows_the_last_plan_in_the_map(controller, world, monkeypatch):
    world.set_inputs(controller, world.lane_change())
    first = world.tick(controller, world.rolling(X=40.0))[1]
    inner = controller.parts.solvers.first

    class Failing:
        """Returns the last iterate with the status of a failure."""

        def solve(self, *numbers):
            return inner.solve(*numbers)._replace(status=FAILED)

    monkeypatch.setattr(controller.parts.solvers, 'first', Failing())
    state = world.rolling(X=41.0, stamp_ns=50_000_000)
    _, second, why = world.tick(controller, state)
    assert why.values['rung'] == SHIFTED
    assert first.Y[2:] == pytest.approx(second.Y[1:-1], abs=1e-9)


def test_a_new_path_keeps_the_plan(controller, world):
    """The same road with a path that begins 10 m later: s changes, the plan does not."""
    situation, state = world.lane_change(), world.rolling(X=31.0, stamp_ns=50_000_000)
    path = situation.reference
    shorter = {name: getattr(path, name)[20:] for name in ('X', 'Y', 'psi')}
    later = path._replace(**shorter, t=path.t[20:] - path.t[20])
    results = []
    for reference in (path, later):
        world.set_inputs(controller, situation)
        world.tick(controller, world.rolling(X=30.0))
        assert controller.set_reference(reference) == ''
        results.append(world.tick(controller, state))
    (_, before, _), (_, after, why) = results
    assert why.values['rung'] == SOLVED
    assert why.values['theta'] == pytest.approx(21.0, abs=1e-6)
    assert why.values['solver.iterations'] < 12
    assert pytest.approx(before.X, abs=1e-3) == after.X
    assert pytest.approx(before.Y, abs=1e-3) == after.Y


def test_equal_bounds_fix_the_brake_split(world):
    params, vehicle = world.load(
        'frenet',
        limits__brake_front_share_min=0.6,
        limits__brake_front_share_max=0.6,
    )
    controller = world.set_inputs(Controller(params, vehicle), world.straight(v=12.0))
    commands = world.drive(controller, 6).commands[2:]
    assert all(c.Fxf + c.Fxr < -500 for c in commands)
    assert [c.Fxf / (c.Fxf + c.Fxr) for c in commands] == pytest.approx([0.6] * 4, abs=1e-3)
