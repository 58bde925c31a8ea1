"""Braking on stale inputs, and the warm-up before the first command."""

import numpy as np
import pytest

from mpcc_controller.driving.controller import Controller
from mpcc_controller.driving.delay_compensation import expected_delay
from mpcc_controller.driving.fallback import BRAKING
from mpcc_controller.driving.records import Arrival, unknown_state
from mpcc_controller.model.single_track import State
from msgs_yaml import conformance, encode
from msgs_yaml.types import Actuators, VehicleState
from stage_solver.solution import SOLVED

TICK = 50_000_000


def decision(why):
    """Return fallback level, reason and line of the lookahead point."""
    return why.values['rung'], why.values['reason'], why.values.get('guide')


def test_with_a_stale_state_it_follows_the_plan_then_brakes_along_it_by_dead_reckoning(
    controller, world
):
    """In the lane change: the true car, which nobody measures any more, stays on its line."""
    limits, advance = controller.params.limits, world.make_car(controller.car)
    x = State(40.0, 0.0, 0.0, 20.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    commands, decisions, line = [], [], []
    for k in range(60):
        measured = k < 10
        stamp_ns = (k + 1) * TICK
        state = VehicleState(stamp_ns, *x[:6]) if measured else unknown_state(stamp_ns)
        fault = '' if measured else 'state_stale'
        command, prediction, why = world.tick(controller, state, fault=fault)
        assert why.values['gate'] == 'passed'
        assert not conformance.check('/controller/why', encode.why(why))
        commands.append(command)
        decisions.append(decision(why))
        x = advance(x, command)
        line.append(x)
        if k == 9:
            plan = prediction
    assert decisions[10:15] == [('shifted', 'state_stale', None)] * 5
    assert decisions[15:38] == [(BRAKING, 'state_stale', 'plan')] * 23
    assert decisions[-1] == (BRAKING, 'state_stale', 'none')  # nothing is known any more
    for X, Y in ((x.X, x.Y) for x in line[10:40]):
        assert abs(Y - np.interp(X, plan.X, plan.Y)) < 0.3
    forces = [c.Fxf + c.Fxr for c in commands]
    steps = np.diff(forces)
    assert np.abs(steps).max() <= limits.force_rate_nps * 0.05 * (1 + 1e-6)
    assert forces[30] < -8000.0
    assert line[-1].vx < 5.0


def test_a_stale_state_that_is_noticed_late_is_answered_with_the_plan_of_now(controller, world):
    for k in range(8):
        world.tick(controller, world.rolling(X=40.0 + k, stamp_ns=k * TICK))
    steering = controller.memory.plans.plan.X[:, 7]
    command, _, why = world.tick(controller, unknown_state(9 * TICK), fault='state_stale')
    assert decision(why) == ('shifted', 'state_stale', None)
    assert command.delta == pytest.approx(steering[3], abs=1e-9)


def test_without_any_state_it_brakes_straight(controller, world):
    command, prediction, why = world.tick(controller, unknown_state(TICK), fault='state_stale')
    assert decision(why) == (BRAKING, 'state_stale', 'none')
    assert command.Fxf + command.Fxr < 0
    assert command.delta == 0.0
    assert not len(prediction.X)


def test_after_braking_without_a_state_it_starts_from_the_measured_actuators(controller, world):
    world.tick(controller, world.rolling(X=40.0))
    world.tick(controller, unknown_state(TICK), fault='state_stale')
    controller.reset(Actuators(2 * TICK, -0.03, 0.0, -3000.0, -1000.0, (0.0,) * 4))
    command, _, why = world.tick(controller, world.rolling(X=42.0, stamp_ns=2 * TICK))
    assert decision(why)[:2] == (SOLVED, 'converged')
    assert why.values['set_point.delta'] == pytest.approx(-0.03)
    assert why.values['set_point.Fx'] == pytest.approx(-4000.0)
    assert abs(command.delta + 0.03) <= controller.params.limits.steer_rate_radps * 0.05 * 1.001


@pytest.mark.parametrize('fault', ['obstacles_stale', 'reference_stale', 'edges_stale'])
def test_with_stale_surroundings_it_brakes_along_the_last_plan(controller, world, fault):
    world.tick(controller, world.rolling(X=40.0))
    *_, why = world.tick(controller, world.rolling(X=41.0, stamp_ns=TICK), fault=fault)
    assert decision(why) == (BRAKING, fault, 'plan')
    assert 'time.solve_ms' not in why.values
    *_, why = world.tick(controller, world.rolling(X=42.0, stamp_ns=2 * TICK))
    assert decision(why)[:2] == (SOLVED, 'converged')
    assert not why.values['solver.warm']


def test_braking_does_not_change_the_latency_estimate(realtime, world):
    world.tick(realtime, world.rolling(stamp_ns=TICK))
    expected = expected_delay(realtime.memory.computing_s, 0.0, realtime.params.delay)
    for k in range(2, 30):
        world.tick(realtime, unknown_state(k * TICK), fault='state_stale')
    assert expected_delay(realtime.memory.computing_s, 0.0, realtime.params.delay) == expected


def test_the_arrival_of_the_state_is_reported_if_it_is_known(controller, world):
    arrival = Arrival(received_ns=77, wait_s=0.002)
    *_, why = world.tick(controller, world.rolling(stamp_ns=TICK), arrival=arrival)
    assert (why.values['time.heard_ns'], why.values['time.wait_ms']) == (77, pytest.approx(2.0))
    assert not conformance.check('/controller/why', encode.why(why))
    *_, why = world.tick(controller, world.rolling(stamp_ns=2 * TICK))
    assert 'time.heard_ns' not in why.values


def test_the_warm_up_leaves_no_state_behind_except_the_latency_estimate(realtime, world):
    x = world.rolling(X=10.0, stamp_ns=TICK)
    stamps = [record.command.stamp_ns for record in realtime.warm_up(x, 5)]
    assert stamps == [(1 + k) * TICK for k in range(1, 6)]
    assert realtime.memory.plans.plan is None
    assert realtime.memory.progress.theta is None
    assert not realtime.memory.rejections
    assert expected_delay(realtime.memory.computing_s, 0.0, realtime.params.delay) == pytest.approx(
        0.015 + 0.001
    )


def test_a_warm_up_that_is_cut_short_leaves_no_state_behind_either(realtime, world):
    steps = realtime.warm_up(world.rolling(X=10.0, stamp_ns=TICK), 5)
    assert next(steps)
    assert realtime.memory.plans.plan is not None
    last, scene = realtime.last_command, realtime.scene
    steps.close()
    assert realtime.memory.plans.plan is None
    assert realtime.last_command != last
    assert realtime.scene is scene


def test_after_the_warm_up_the_commands_are_those_of_a_controller_that_did_not_warm_up(world):
    """Set-points, friction and obstacles are as before; all solvers of candidates have worked."""
    settings = world.load(candidates__most=4, **world.ESTIMATE)
    controllers = [Controller(*settings) for _ in range(2)]
    for controller in controllers:
        world.set_inputs(controller, world.lane_change(18.0))
    warm, cold = controllers
    solvers = [world.ModifiedSolver(solver) for solver in warm.parts.solvers.parallel.solvers]
    warm.parts.solvers.parallel.solvers = solvers
    before = warm.scene
    records = list(warm.warm_up(world.rolling(v=18.0, X=20.0), 12))
    assert sum(record.attempt.candidates is not None for record in records) >= 3
    assert all(solver.solutions for solver in solvers)
    assert all(record.attempt.candidates is None for record in records[-5:])
    assert (warm.last_command, warm.memory.ramps) == (cold.last_command, cold.memory.ramps)
    assert warm.scene is before
    one, other = (world.drive(controller, 12) for controller in controllers)
    assert one.commands == other.commands
    assert [why.values['friction.estimate'] for why in one.whys] == [
        why.values['friction.estimate'] for why in other.whys
    ]
