"""The plan starts at the state at which its command takes effect, under the set-points sent."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mpcc_controller.driving.controller import Controller
from mpcc_controller.driving.delay_compensation import (
    SetpointRamp,
    constant_ramp,
    expected_delay,
    predict,
    setpoints_at,
    still_needed,
)
from mpcc_controller.driving.friction_estimate import FrictionBelief
from mpcc_controller.driving.records import TickInputs, unknown_state
from mpcc_controller.driving.setpoints import Setpoints
from mpcc_controller.model import single_track
from mpcc_controller.model.single_track import Input, State
from mpcc_controller.parameters import Delay
from msgs_yaml.types import Actuators, Command, Obstacle, Obstacles, VehicleState

TICK, MS = 50_000_000, 1_000_000


def held(delta, Fx):
    return constant_ramp(Setpoints(delta, Fx), 0.6)


instants = st.integers(-60, 60)
angles, forces = st.floats(-0.15, 0.15), st.floats(-12e3, 5e3)


@settings(max_examples=40)
@given(
    marks=st.lists(st.tuples(instants, instants, angles, forces), min_size=1, max_size=4),
    motion=st.tuples(st.floats(12, 35), st.floats(-0.5, 0.5), st.floats(-0.4, 0.4)),
    until_ms=st.integers(0, 60),
)
def test_the_state_is_that_of_the_model_under_the_set_points_sent(car, marks, motion, until_ms):
    """The reference takes short midpoint steps under set-points of its own; some of them jump."""
    ramps, last = [held(0.0, 0.0)], Setpoints(0.0, 0.0)
    for begin_ms, duration_ms, *end in sorted(marks):
        end_ms = begin_ms + max(duration_ms, 0)
        ramps.append(SetpointRamp(begin_ms * MS, last, end_ms * MS, Setpoints(*end), 0.6))
        last = ramps[-1].end

    def sent(t_ms):
        active = [ramp for ramp in ramps[1:] if ramp.begin_ns <= t_ms * MS]
        ramp = active[-1] if active else ramps[0]
        at = (ramp.begin_ns / MS, max(ramp.end_ns / MS, ramp.begin_ns / MS + 1e-9))
        return [np.interp(t_ms, at, pair) for pair in zip(ramp.begin, ramp.end)]

    x = VehicleState(0, 0.0, 0.0, 0.0, *motion)
    rates = single_track.rates(single_track.structure(car))

    def change(y, t_ms):
        delta, Fx = sent(t_ms)
        state = State(*y, theta=0.0, delta=delta, Fx=Fx)
        return rates(state, Input(0.0, 0.0, 0.6, 0.0), car).full().ravel()[:6]

    y = np.array(x[1:], float)
    for t_ms in np.arange(0.5, until_ms, 1.0):
        middle = y + 5e-4 * change(y, t_ms)
        y = y + 1e-3 * change(middle, t_ms)
    predicted = predict(x, ramps, until_ms * MS, car)
    assert predicted.stamp_ns == until_ms * MS
    assert predicted[1:4] == pytest.approx(y[:3], abs=3e-3)
    assert predicted[4:] == pytest.approx(y[3:], abs=0.04)
    between = round((until_ms + 0.5) * MS)  # two instants at which set-points may jump
    assert setpoints_at(ramps, between)[0] == pytest.approx(sent(until_ms + 0.5), abs=1e-6)


@pytest.mark.parametrize(
    ('computing_s', 'age_s', 'expected'),
    [
        ((), 0.002, 0.013),  # with the computing time of the parameters
        ((0.004, 0.003, 0.1), 0.0, 0.005),  # an interrupted solve does not change the estimate
        ((), 0.2, 0.05),
        ((), -1.0, 0.0),
    ],
)
def test_the_delay_is_age_computing_and_transport_time_at_most_a_tick(computing_s, age_s, expected):
    rules = Delay(computing_s=0.01, transport_s=0.001, longest_s=0.05, command_s=None)
    assert expected_delay(computing_s, age_s, rules) == pytest.approx(expected)


# in the controller


def test_the_plan_starts_at_the_state_at_which_its_command_takes_effect(realtime, world):
    # 2 ms of age, 8 ms as configured, 1 ms of transport; then the measured computing time
    for k, lead_ms in ((1, 11), (2, 18), (3, 18), (4, 18)):
        x = world.rolling(X=10.0 + k, stamp_ns=k * TICK)
        _, prediction, why = world.tick(realtime, x, age_s=0.002)
        assert why.values['time.lead_ms'] == pytest.approx(lead_ms)
        assert prediction.X[0] == pytest.approx(x.X + lead_ms * 0.02, abs=1e-3)
        assert prediction.stamp_ns == x.stamp_ns + lead_ms * MS
        assert why.stamp_ns == x.stamp_ns
    # braking takes no time and says nothing about the next solve
    for k in range(5, 30):
        world.tick(realtime, unknown_state(k * TICK), fault='state_stale')
    expected = expected_delay(realtime.memory.computing_s, 0.0, realtime.params.delay)
    assert expected == pytest.approx(0.016)


def test_after_an_early_state_the_last_setpoint_is_reached_first(realtime, world):
    command, *_ = world.tick(realtime, world.rolling(X=10.0, v=18.0, stamp_ns=TICK))
    ramp = realtime.memory.ramp
    assert ramp[:2] == (TICK + 9 * MS, (0.0, 0.0))
    assert ramp[2:4] == (2 * TICK, (command.delta, command.Fxf + command.Fxr))
    for ms, lead_ms in ((30, 20.0), (31, 49.0)):
        early = world.rolling(X=10.6, stamp_ns=TICK + ms * MS)
        assert world.tick(realtime, early)[2].values['time.lead_ms'] == pytest.approx(lead_ms)
    assert not realtime.memory.rejections
    realtime.reset(Actuators(0, 0.02, 0.0, -600.0, -400.0, (0.0,) * 4))
    assert realtime.memory.ramp.at(0) == realtime.memory.ramp.end == (0.02, -1000.0)


def test_a_drive_continues_from_another_command_than_the_last_one(controller, world):
    for k in (1, 2):
        world.tick(controller, world.rolling(X=10.0 + k, stamp_ns=k * TICK))
    before, other = controller.memory.ramps, Command(2 * TICK, 0.02, 0.0, -600.0, -400.0)
    controller.set_last_command(other)
    assert controller.memory.last == other
    assert controller.memory.ramps[:-1] == before[:-1] != ()
    ramp = controller.memory.ramp
    assert (ramp.end, ramp.lambda_b) == ((0.02, -1000.0), 0.6)
    assert ramp[:3] == before[-1][:3]


def test_the_age_that_the_gate_checks_includes_the_computing_time(realtime, world):
    realtime.parts.solvers.followed.takes_s = 0.15
    *_, why = world.tick(realtime, world.rolling(stamp_ns=TICK), age_s=0.06)
    assert why.values['gate'] == 'too_old'


def test_a_moving_obstacle_is_predicted_to_the_time_of_the_command(realtime, world):
    realtime.set_obstacles(Obstacles(TICK - 20 * MS, (Obstacle(3, 40.0, 1.0, 1.0, 10.0, -5.0),)))
    _, prediction, why = world.tick(realtime, world.rolling(X=10.0, stamp_ns=TICK))
    t = 0.02 + 1e-3 * why.values['time.lead_ms']
    gap = np.hypot(40.0 + 10.0 * t - prediction.X[0], 1.0 - 5.0 * t - prediction.Y[0]) - 2.1
    assert why.values['v2o.3'] == pytest.approx(gap, abs=1e-4)


@pytest.fixture(scope='module')
def estimating(world):
    """Return a controller that estimates the friction and whose commands take 200 ms."""
    return Controller(*world.load(delay__command_s=0.2, **world.ESTIMATE))


@pytest.mark.parametrize(('lag_error_s', 'kept_ms'), [(0.0, 170), (0.2, 210)])
def test_every_command_on_its_way_is_in_the_prediction_however_many_there_are(
    world, lag_error_s, kept_ms
):
    """States every 10 ms, commands that take 200 ms: twenty are on their way.

    A comparison of actuators that lag by 10 ms needs those of 170 ms, a doubt of the lags its own.
    """
    doubted = world.ESTIMATE | {'friction_estimate__lag_error_s': lag_error_s}
    params, vehicle = world.load(delay__command_s=0.2, **doubted)
    quick = replace(vehicle.actuators, steer_lag_s=0.01, force_lag_s=0.01)
    late = Controller(params, replace(vehicle, actuators=quick))
    world.set_inputs(late, world.lane_change())
    sent = list(late.memory.ramps)
    for k in range(1, 40):
        x = world.rolling(X=40.0 + 0.2 * k, stamp_ns=10 * k * MS)
        record = late.step(TickInputs(x))
        state = late.parts.friction.filtered(late.memory.friction, x)  # these look like noise
        assert record.state == predict(state, sent, x.stamp_ns + 200 * MS, late.car)
        sent.append(late.memory.ramp)
    assert abs(sent[-1].end.delta) > 0.01  # so that what is on its way matters
    first_ns = x.stamp_ns - 50 * MS  # that the estimate of the friction looks back
    assert late.memory.ramps == still_needed(sent, x.stamp_ns - kept_ms * MS)
    instants = range(first_ns, first_ns + 300 * MS, 5 * MS)
    assert [setpoints_at(late.memory.ramps, t) for t in instants] == [
        setpoints_at(sent, t) for t in instants
    ]


def test_the_delay_is_predicted_on_the_road_that_is_believed(estimating, world, monkeypatch):
    """Hard braking for 0.2 s: where less friction is believed, the car is expected to slow less."""
    slowed = {}
    for friction in (1.0, 0.4):
        late = world.set_inputs(estimating, world.straight())
        late.memory = late.memory._replace(ramps=(held(0.0, -15e3),))
        belief = FrictionBelief(friction, 0.0)
        monkeypatch.setattr(late.parts.friction, 'belief', lambda _, belief=belief: belief)
        x = world.rolling(stamp_ns=TICK)
        slowed[friction] = x.vx - late.step(TickInputs(x)).state.vx
    assert slowed[0.4] == pytest.approx(0.4 * slowed[1.0], rel=0.25)
