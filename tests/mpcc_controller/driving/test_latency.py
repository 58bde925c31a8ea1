"""Realtime: the plan starts at the state predicted with the setpoints already sent."""

from dataclasses import replace

import numpy as np
import pytest

from mpcc_controller.driving.controller import Controller
from mpcc_controller.driving.delay_compensation import (
    constant_ramp,
    predict,
    setpoints_at,
    still_needed,
)
from mpcc_controller.driving.friction_estimate import FrictionBelief
from mpcc_controller.driving.records import TickInputs
from mpcc_controller.driving.setpoints import Setpoints
from mpcc_controller.model.single_track import State
from msgs_yaml.types import Actuators, Command, Obstacle, Obstacles, VehicleState

TICK, MS = 50_000_000, 1_000_000


def test_the_plan_starts_at_the_state_at_which_its_command_takes_effect(realtime, world):
    x = world.rolling(X=10.0, stamp_ns=TICK)
    _, prediction, why = world.tick(realtime, x, age_s=0.002)
    # 2 ms of age, 8 ms as configured, 1 ms of transport
    assert why.values['time.lead_ms'] == pytest.approx(11.0)
    assert prediction.X[0] == pytest.approx(10.0 + 0.011 * 20.0, abs=1e-3)
    assert prediction.stamp_ns == TICK + 11 * MS
    for k in range(2, 5):
        x = world.rolling(X=10.0 + k, stamp_ns=k * TICK)
        _, prediction, why = world.tick(realtime, x, age_s=0.002)
        # from now on the measured computing time
        assert why.values['time.lead_ms'] == pytest.approx(2 + 15 + 1)
        assert prediction.X[0] == pytest.approx(x.X + 0.018 * 20.0, abs=1e-3)
    assert why.stamp_ns == 4 * TICK


def test_in_lockstep_there_is_no_delay(controller, world):
    _, prediction, why = world.tick(controller, world.rolling(X=10.0, stamp_ns=TICK), age_s=0.1)
    assert why.values['time.lead_ms'] == 0
    assert (prediction.X[0], prediction.stamp_ns) == (10.0, TICK)


@pytest.mark.parametrize('ticks', [1, 2])
def test_late_commands_are_compensated_for_in_lockstep_too(world, ticks):
    """The plan starts at the state that the car reaches under the commands on their way."""
    late = Controller(*world.load(delay__command_s=ticks * 0.05))
    world.set_inputs(late, world.lane_change())
    advance = world.make_car(late.car)
    x, expected = State(40.0, 0.0, 0.0, 20.0, 0.0, 0.0, 40.0, 0.0, 0.0), {}
    arriving = [Command(0, 0.0, 0.0, 0.0, 0.0)] * ticks
    for k in range(1, 30):
        command, prediction, why = world.tick(late, VehicleState(k * TICK, *x[:6]))
        assert why.values['time.lead_ms'] == pytest.approx(50 * ticks)
        assert prediction.stamp_ns == (k + ticks) * TICK
        expected[k + ticks] = prediction.X[0], prediction.Y[0], prediction.psi[0]
        if k in expected:
            assert expected[k] == pytest.approx((x.X, x.Y, x.psi), abs=2e-3)
        arriving = [*arriving, command]
        x = advance(x, arriving.pop(0))
    assert x.Y > 1.0  # it has changed lanes, so that steering mattered
    assert not late.memory.rejections


def test_after_an_early_state_the_last_setpoint_is_reached_first(realtime, world):
    world.tick(realtime, world.rolling(X=10.0, stamp_ns=TICK))
    early = world.rolling(X=10.6, stamp_ns=TICK + 30 * MS)
    *_, why = world.tick(realtime, early)
    assert why.values['time.lead_ms'] == pytest.approx(20.0)
    *_, why = world.tick(realtime, world.rolling(X=10.7, stamp_ns=TICK + 31 * MS))
    assert why.values['time.lead_ms'] == pytest.approx(49.0)
    assert not realtime.memory.rejections


def test_the_age_that_the_gate_checks_includes_the_computing_time(realtime, world):
    realtime.parts.solvers.first.takes_s = 0.15
    *_, why = world.tick(realtime, world.rolling(stamp_ns=TICK), age_s=0.06)
    assert why.values['gate'] == 'too_old'


def test_a_moving_obstacle_is_predicted_to_the_time_of_the_command(realtime, world):
    realtime.set_obstacles(Obstacles(TICK - 20 * MS, (Obstacle(3, 40.0, 1.0, 1.0, 10.0, -5.0),)))
    _, prediction, why = world.tick(realtime, world.rolling(X=10.0, stamp_ns=TICK))
    t = 0.02 + 1e-3 * why.values['time.lead_ms']
    gap = np.hypot(40.0 + 10.0 * t - prediction.X[0], 1.0 - 5.0 * t - prediction.Y[0]) - 2.1
    assert why.values['v2o.3'] == pytest.approx(gap, abs=1e-4)


def test_the_active_setpoint_ramp_is_that_of_the_last_command(realtime, world):
    command, *_ = world.tick(realtime, world.rolling(X=10.0, v=18.0, stamp_ns=TICK))
    ramp = realtime.active_ramp
    assert ramp.end == (command.delta, command.Fxf + command.Fxr)
    assert (ramp.begin_ns, ramp.end_ns) == (TICK + 9 * MS, 2 * TICK)
    assert ramp.begin == (0.0, 0.0)
    realtime.reset(Actuators(0, 0.02, 0.0, -600.0, -400.0, (0.0,) * 4))
    assert realtime.active_ramp.at(0) == realtime.active_ramp.end == (0.02, -1000.0)


def test_every_command_on_its_way_is_in_the_prediction_however_many_there_are(world):
    """States every 10 ms, commands that take 200 ms: twenty are on their way."""
    late = Controller(*world.load(delay__command_s=0.2, **world.ESTIMATE))
    world.set_inputs(late, world.lane_change())
    sent = list(late.memory.ramps)
    for k in range(1, 40):
        x = world.rolling(X=40.0 + 0.2 * k, stamp_ns=10 * k * MS)
        record = late.step(TickInputs(x))
        state = late.parts.friction.filtered(
            late.memory.friction, x
        )  # these states look like noise: the car does not react
        expected = predict(state, sent, x.stamp_ns + 200 * MS, late.car)
        assert record.state == expected
        sent.append(late.active_ramp)
    assert abs(sent[-1].end.delta) > 0.01  # so that what is on its way matters
    first_ns = x.stamp_ns - 50 * MS  # that the estimate of the friction looks back
    longest_ns = x.stamp_ns - round(1e3 * late.parts.actuators.memory_s) * MS
    assert late.memory.ramps == still_needed(sent, longest_ns)
    instants = range(first_ns, first_ns + 300 * MS, 5 * MS)
    assert [setpoints_at(late.memory.ramps, t) for t in instants] == [
        setpoints_at(sent, t) for t in instants
    ]


def test_the_delay_is_predicted_on_the_road_that_is_believed(world, monkeypatch):
    """Hard braking for 0.2 s: where less friction is believed, the car is expected to slow less."""
    late = Controller(*world.load(delay__command_s=0.2, **world.ESTIMATE))
    world.set_inputs(late, world.straight())
    hard = constant_ramp(Setpoints(0.0, -15e3), 0.6)
    slowed = {}
    for friction in (1.0, 0.4):
        late.memory = replace(late.memory, ramps=(hard,))
        belief = FrictionBelief(friction, 0.0)
        monkeypatch.setattr(late.parts.friction, 'belief', lambda _, belief=belief: belief)
        x = world.rolling(stamp_ns=TICK)
        slowed[friction] = x.vx - late.step(TickInputs(x)).state.vx
        world.set_inputs(late, world.straight())
    assert slowed[0.4] == pytest.approx(0.4 * slowed[1.0], rel=0.25)
