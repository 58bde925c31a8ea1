"""The set-points that stop the car where no command follows: what they are, and when."""

from dataclasses import replace

import numpy as np
import pytest

from mpcc_controller.driving import stop_plan
from mpcc_controller.driving.records import TickInputs, unknown_state
from msgs_yaml import conformance, encode
from msgs_yaml.types import VehicleState

TICK_S, TICK_NS = 0.05, 50_000_000


def answered(controller, world, ticks=1):
    """Return the record of the last of some ticks of the prediction model."""
    driven = world.drive(controller, ticks)
    x = driven.states
    last = VehicleState(ticks * TICK_NS, x.X[-1], x.Y[-1], x.psi[-1], x.vx[-1], x.vy[-1], x.r[-1])
    return controller.step(TickInputs(last))


def with_states(record, X):
    """Return a record of a plan of other states (N + 1, 9)."""
    plan = record.decision.plan._replace(X=X)
    return record._replace(decision=record.decision._replace(plan=plan))


def test_they_are_those_of_the_plan_then_brake_along_its_line(controller, world):
    record = answered(controller, world, 30)
    plan, stop = record.decision.plan, controller.stop_plan(record)
    assert conformance.check('/controller/stop_plan', encode.stop_plan(stop)) == []
    assert stop.stamp_ns == record.command.stamp_ns
    assert stop.t == pytest.approx(TICK_S * np.arange(4, 51))
    assert stop.delta[:9] == pytest.approx(plan.X[4:13, 7])
    force = stop.Fxf + stop.Fxr
    assert force[:9] == pytest.approx(np.minimum(plan.X[4:13, 8], 0))
    assert np.all(force <= 0)
    assert force[-1] < -3000
    # both ways of the lane change that the car has yet to drive
    assert np.ptp(stop.delta[9:]) > 0.02
    limits, braked = controller.params.limits, force < 0
    share = stop.Fxf[braked] / force[braked]
    assert np.all(share >= limits.brake_front_share_min)
    assert np.all(share <= limits.brake_front_share_max)


def test_from_the_held_command_on_they_change_no_faster_than_the_limits_allow(controller, world):
    record, limits = answered(controller, world), controller.params.limits
    X = record.decision.plan.X.copy()
    X[:, 7:] = 0.3, -limits.brake_n
    stop = controller.stop_plan(with_states(record, X))
    held, force = record.command.Fxf + record.command.Fxr, stop.Fxf + stop.Fxr
    changes = np.abs([np.diff([record.command.delta, *stop.delta]), np.diff([held, *force])])
    rates = limits.steer_rate_radps, limits.force_rate_nps
    assert np.max(changes, axis=1) == pytest.approx(TICK_S * np.array(rates))


def test_in_realtime_they_are_due_as_much_later_as_the_command_takes_effect(controller, world):
    record = answered(controller, world)
    at_once = controller.stop_plan(record)
    later = record._replace(effective_ns=record.effective_ns + 20_000_000)
    assert controller.stop_plan(later).t == pytest.approx(at_once.t + 0.02)
    delayed = stop_plan.stop_plan(later, controller.car, controller.params, 20_000_000)
    assert delayed.t == pytest.approx(at_once.t)


def test_there_are_none_without_a_plan_and_for_a_car_that_stands(controller, world):
    record = answered(controller, world)
    standing = record.decision.plan.X * (np.arange(9) != 3)
    assert controller.stop_plan(with_states(record, standing)) is None
    controller.memory = controller.memory._replace(plans=controller.memory.plans.discard())
    assert controller.stop_plan(controller.step(TickInputs(unknown_state(2 * TICK_NS)))) is None


def test_they_end_where_the_car_stands_and_fit_the_shortest_horizon(controller, world):
    record = answered(controller, world)
    X = record.decision.plan.X[:6].copy()
    assert len(controller.stop_plan(with_states(record, X)).t) == 2
    X[:, 3] = 1.0
    stop = controller.stop_plan(with_states(record, X))
    assert 1 <= len(stop.t) <= 2


@pytest.mark.parametrize('step_s', [0.025, 0.1])
def test_with_stages_of_another_length_they_are_those_of_the_same_instants(
    controller, world, step_s
):
    record = answered(controller, world, 30)
    plan, usual = record.decision.plan, controller.stop_plan(record)
    t = TICK_S * np.arange(len(plan.X))
    instants = np.arange(0.0, t[-1] + 1e-9, step_s)
    X = np.column_stack([np.interp(instants, t, column) for column in plan.X.T])
    params = replace(controller.params, model=replace(controller.params.model, step_s=step_s))

    def stop_of(stages):
        return stop_plan.stop_plan(with_states(record, stages), controller.car, params, 0)

    stop = stop_of(X)
    assert stop.t == pytest.approx(np.arange(0.2, t[-1] + 1e-9, step_s))
    followed = stop.t < 0.6
    assert stop.delta[followed] == pytest.approx(np.interp(stop.t, usual.t, usual.delta)[followed])
    assert stop_of(X[: round(0.2 / step_s)]) is None  # it ends while the command is held


def test_an_error_inside_is_counted(controller, world, monkeypatch):
    record = answered(controller, world)
    monkeypatch.setattr(stop_plan.guesses, 'braking', lambda *_, **__: 1 / 0)
    before = sum(controller.errors.counts.values())
    assert controller.stop_plan(record) is None
    assert sum(controller.errors.counts.values()) == before + 1
