"""Set-points against measured actuators: what counts as a fault, and what is sent then."""

import dataclasses
import itertools
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mpcc_controller.driving.actuator_faults import (
    FAULT,
    FORCE,
    FRONT,
    LATE,
    LEAD_RAD,
    REAR,
    STEER,
    ActuatorState,
)
from mpcc_controller.driving.actuator_monitor import STEER_RAD, ActuatorMonitor
from mpcc_controller.driving.delay_compensation import SetpointRamp, constant_ramp, shifted
from mpcc_controller.driving.gate import Gate
from mpcc_controller.driving.records import TickInputs
from mpcc_controller.driving.setpoints import Setpoints, SetpointTarget
from mpcc_controller.model import single_track
from msgs_yaml.types import Actuators, Command

TICK, MS = 50_000_000, 1_000_000
TICK_S, MS_S = 0.05, 1e-3
REST = Setpoints(0.0, 0.0)
AT_REST = [constant_ramp(REST, 0.6)]


def follow(set_points, lag_s, damping):
    """Return positions of a second-order servo with a lag, 2 damping / frequency, every ms."""
    w = 2 * damping / lag_s
    x = rate = 0.0
    positions = []
    for u in set_points:
        rate += MS_S * (w**2 * (u - x) - 2 * damping * w * rate)
        x += MS_S * rate
        positions.append(x)
    return np.array(positions)


def message(stamp_ns, delta=0.0, force=0.0):
    return Actuators(stamp_ns, delta, 0.0, 0.6 * force, 0.4 * force, (0.0,) * 4)


@pytest.fixture
def monitor(vehicle):
    return Watch(vehicle)


class Watch:
    """A monitor with what it knows."""

    def __init__(self, vehicle, start=None):
        self.monitor, self.state = ActuatorMonitor(vehicle), ActuatorState(start)

    def update(self, actuators, ramps, state_ns):
        ramps = shifted(ramps, self.state.delay.late_ns)
        self.state = self.monitor.update(self.state, actuators, ramps, state_ns)
        return self.state.check

    def watch(self, position_at, ticks, ramps=AT_REST):
        """Return the check of each tick; `position_at(k)` is (angle, force)."""
        return [
            self.update(message(k * TICK, *position_at(k)), ramps[: k + 1], k * TICK)
            for k in range(ticks)
        ]


def manoeuvres():
    """Return set-points every tick: at the greatest rates, with reversals, held and left again."""
    rng, limits = np.random.default_rng(7), [0.47, 17e3]
    for _ in range(5):
        directions = np.repeat(rng.integers(-1, 2, (20, 2)), rng.integers(1, 9, 20), axis=0)
        points = [REST]
        for move in directions * [0.524 * TICK_S, 40e3 * TICK_S]:
            points.append(Setpoints(*np.clip(points[-1] + move, np.negative(limits), limits)))
        yield points


def watch_delayed(vehicle, points, delay_ms, damping, off_rad=0.0, from_s=0.0):
    """Yield what is known after every tick of servos that follow set-points late."""
    ramps = [*AT_REST]
    for k, (begin, end) in enumerate(itertools.pairwise(points)):
        ramps.append(SetpointRamp(k * TICK, begin, (k + 1) * TICK, end, 0.6))
    t = np.arange(0, (len(points) - 1) * TICK_S, MS_S)
    knots = TICK_S * np.arange(len(points))
    lags = vehicle.actuators.steer_lag_s, vehicle.actuators.force_lag_s
    at_ticks = np.transpose([
        follow(np.interp(t - delay_ms * MS_S * (t >= from_s), knots, column), lag, damping)[::50]
        for lag, column in zip(lags, np.transpose(points))
    ])  # fmt: skip
    watch = Watch(vehicle)
    for k, position in enumerate(at_ticks):
        delta, force = position
        watch.update(message(k * TICK, delta + off_rad, force), ramps[: k + 1], k * TICK)
        yield watch.state


@pytest.mark.parametrize('delay_ms', [0, 10, 25, 40, 60])
@pytest.mark.parametrize('damping', [0.7, 2.0])
def test_no_lag_and_no_short_delay_of_any_manoeuvre_is_a_fault(vehicle, delay_ms, damping):
    for points in manoeuvres():
        for state in watch_delayed(vehicle, points, delay_ms, damping):
            assert not state.faults
            assert not state.stands
            assert abs(state.check.steer_error) < (0.5 + delay_ms / 60) * STEER_RAD


@pytest.mark.parametrize('delay_ms', [100, 150, 175, 200, 250])
@pytest.mark.parametrize('damping', [0.7, 2.0])
def test_a_longer_delay_is_found_and_is_then_no_fault_of_an_actuator(vehicle, delay_ms, damping):
    for points in manoeuvres():
        states = [*watch_delayed(vehicle, points, delay_ms, damping)]
        moves = next(k for k, point in enumerate(points) if point != REST)
        found = next(k for k, state in enumerate(states) if LATE in state.faults)
        # a movement must have been seen to arrive before it is known how late
        assert found - moves <= (delay_ms + 300) / 50
        for state in states[found:]:
            assert abs(state.delay.late_ns - delay_ms * MS) <= 25 * MS
            assert state.faults == (LATE,)
        assert f'{states[-1].delay.late_ns // MS} ms late' in states[-1].describe()


def test_a_steering_that_does_not_move_sticks_until_it_moves_and_is_not_late(vehicle):
    watch = Watch(vehicle)
    ramps = [
        SetpointRamp(
            k * TICK, Setpoints(0.02 * k, 0.0), (k + 1) * TICK, Setpoints(0.02 * (k + 1), 0.0), 0.6
        )
        for k in range(20)
    ]
    checks = watch.watch(lambda k: (0.0, 0.0), 20, ramps)
    assert [check.faults for check in checks] == [()] * 7 + [(STEER,)] * 13
    assert watch.state.sticks
    watch.update(message(20 * TICK, 0.001), ramps, 20 * TICK)
    assert watch.state.sticks, 'noise'
    watch.update(message(21 * TICK, 0.02), ramps, 21 * TICK)
    assert not watch.state.sticks


@pytest.mark.parametrize('noise_rad', [0.0, 0.0003])
@pytest.mark.parametrize('force_follows', [True, False])
def test_a_steering_that_followed_sticks_two_ticks_after_it_stopped_if_the_force_follows(
    vehicle, noise_rad, force_follows
):
    rng = np.random.default_rng(5)
    points = [Setpoints(0.01 * k, -400.0 * k) for k in range(30)]
    lags = vehicle.actuators.steer_lag_s, vehicle.actuators.force_lag_s
    t = np.arange(0, 29 * TICK_S, MS_S)
    asked, force = (np.interp(t, TICK_S * np.arange(30), column) for column in zip(*points))
    angles = follow(np.minimum(asked, asked[15 * 50]), lags[0], 0.7)[::50]
    forces = force_follows * follow(force, lags[1], 0.7)[::50]
    watch, ramps, found, stands = Watch(vehicle), [*AT_REST], [], []
    for k, (begin, end) in enumerate(itertools.pairwise(points)):
        ramps.append(SetpointRamp(k * TICK, begin, (k + 1) * TICK, end, 0.6))
        angle = angles[k] + noise_rad * rng.standard_normal()
        watch.update(message(k * TICK, angle, forces[k]), ramps, k * TICK)
        found.append(watch.state.sticks)
        stands.append(watch.state.stands)
    # the servo ends its movement in two ticks; what it moved before does not make it free again
    first = 18 if force_follows else 20
    assert found == [False] * first + [True] * (29 - first)
    assert stands.index(True) == 18
    assert all(a or b for a, b in zip(stands[18:], found[18:]))


@pytest.fixture
def axles(vehicle):
    """Return what is known after ticks that ask for a force, of which the axles give shares."""
    watch = Watch(vehicle)
    watch.state = ActuatorState(followed=True)

    def brake(ticks, asked_n, front, rear):
        ramps = [constant_ramp(Setpoints(0.0, asked_n), 0.6)]
        begin = watch.state.last.stamp_ns // TICK + 1 if watch.state.last else 0
        for k in range(begin, begin + ticks):
            forces = front * 0.6 * asked_n, rear * 0.4 * asked_n
            watch.update(Actuators(k * TICK, 0.0, 0.0, *forces, (0.0,) * 4), ramps, k * TICK)
        return watch.state

    return brake


@pytest.mark.parametrize(('lost', 'front', 'rear'), [(FRONT, 0.0, 1.0), (REAR, 1.0, 0.05)])
def test_an_axle_that_does_not_brake_beside_the_other_has_lost_its_brakes(axles, lost, front, rear):
    assert axles(3, -600.0, front, rear).lost == '', 'too little to tell'
    assert axles(2, -6000.0, front, rear).lost == ''
    state = axles(1, -6000.0, front, rear)
    assert state.lost == lost in state.faults
    assert 'brakes' in state.describe()
    assert axles(20, 0.0, 1.0, 1.0).lost == lost, 'nothing is asked of it'
    state = axles(3, -6000.0, 1.0, 1.0)
    assert (state.lost, state.faults) == ('', ())


@pytest.mark.parametrize(('front', 'rear'), [(0.0, 0.0), (0.5, 0.5), (0.2, 1.0), (0.0, 0.3)])
def test_axles_that_are_late_or_weak_have_not_lost_their_brakes(axles, front, rear):
    assert axles(20, -6000.0, front, rear).lost == ''


@pytest.mark.parametrize(('lost', 'share'), [(FRONT, 0.4), (REAR, 0.6)])
def test_beside_lost_brakes_set_points_are_those_of_the_other_axle(car, params, lost, share):
    state = ActuatorState(lost=lost)
    brakes = Command(0, 0.1, 0.0, -3000.0, -2000.0)
    now, front = state.setpoints_of(brakes, car)
    assert now == (0.1, pytest.approx(-5000.0 * share))
    assert front == (lost == REAR)
    drives = Command(0, 0.1, 0.0, 0.0, 500.0)
    assert state.setpoints_of(drives, car)[0] == (0.1, 500.0)
    limits = state.limits_left(params.limits, car)
    assert limits.brake_front_share_min == limits.brake_front_share_max == front
    Fz = single_track.loads(-limits.brake_n, car)
    friction = car.mu_f * Fz.f if front else car.mu_r * Fz.r
    assert limits.brake_n == pytest.approx(params.limits.friction_use * friction)


@pytest.mark.parametrize(
    ('last', 'wanted', 'sent'),
    [
        ((-400.0, -4000.0), -4000.0, (-400.0, -4000.0)),  # a tenth, whether it is back
        ((-5000.0, -4000.0), -4200.0, (-2800.0, -4200.0)),  # within the rate of the whole force
        ((-400.0, -1000.0), 900.0, (0.0, 0.0)),  # no axle drives while the other brakes
        ((0.0, 300.0), 500.0, (0.0, 500.0)),
    ],
)
def test_lost_brakes_are_asked_for_a_little_within_what_the_gate_allows(params, last, wanted, sent):
    limits = dataclasses.replace(params.limits, force_rate_nps=40e3)
    asked = ActuatorState(lost=FRONT).probing(
        Command(0, 0.0, 0.0, 0.0, wanted), Command(0, 0.0, 0.0, *last), limits, TICK_S
    )
    assert (asked.Fxf, asked.Fxr) == pytest.approx(sent)


@given(st.lists(st.sampled_from([0.3, 1.0]), min_size=5, max_size=20), st.floats(-15e3, 3e3))
@pytest.mark.parametrize('lost', [FRONT, REAR])
def test_what_is_asked_beside_lost_brakes_passes_the_gate(params, car, lost, shares, begin):
    state, step_n = ActuatorState(lost=lost), params.limits.force_rate_nps * TICK_S
    limits = state.limits_left(params.limits, car)
    gate = Gate(params.limits, car, TICK_S, 0.1, lost=state.lost_force)
    last, left = Command(0, 0.0, 0.0, 0.6 * begin, 0.4 * begin), 0.4 if lost == FRONT else 0.6
    force = begin if begin > 0 else left * begin
    for k, share in enumerate(shares, 1):
        force = max(force - share * step_n, -limits.brake_n)
        split = float(lost == REAR) if force < 0 else 0.4
        wanted = Command(k * TICK, 0.0, 0.0, split * force, (1 - split) * force)
        sent = state.probing(wanted, last, params.limits, TICK_S)
        assert gate.check(sent, last, 0.0, car).reason == ''
        last = sent


@pytest.mark.parametrize('gain', [0.0, 0.05])
@pytest.mark.parametrize('noise_rad', [0.0, 0.0003])
def test_a_steering_that_sticks_stays_a_fault_also_with_noise_and_some_play(
    vehicle, gain, noise_rad
):
    rng = np.random.default_rng(3)
    for points in manoeuvres():
        watch, ramps, found = Watch(vehicle), [*AT_REST], []
        for k, (begin, end) in enumerate(itertools.pairwise(points)):
            ramps.append(SetpointRamp(k * TICK, begin, (k + 1) * TICK, end, 0.6))
            angle = gain * begin.delta + noise_rad * rng.standard_normal()
            watch.update(message(k * TICK, angle, begin.Fx), ramps, k * TICK)
            found.append(watch.state.sticks)
        changes = np.count_nonzero(np.diff(found))
        assert any(found)
        assert changes <= len(points) / 10


def test_a_steering_that_is_off_and_late_does_not_stick(vehicle):
    for points in manoeuvres():
        for state in watch_delayed(vehicle, points, 150, 0.7, off_rad=0.03):
            assert not state.sticks


@pytest.mark.parametrize('delay_ms', [100, 150, 200])
def test_a_delay_that_begins_while_driving_is_no_steering_that_sticks(vehicle, delay_ms):
    """The car brakes for a few ticks until it knows."""
    for points in manoeuvres():
        states = [*watch_delayed(vehicle, points, delay_ms, 0.7, from_s=1.5)]
        assert sum(state.stands for state in states) <= 4
        assert not any(state.sticks for state in states)
        assert LATE in states[-1].faults


def test_a_difference_is_a_fault_after_four_ticks_and_none_after_a_second(monitor):
    checks = monitor.watch(lambda k: (0.03 if 10 <= k < 20 else 0.0, -9.0), 60)
    faulty = [k for k, check in enumerate(checks) if check.faults == (STEER,)]
    assert faulty == [*range(13, 39)]
    assert checks[15].steer_error == pytest.approx(0.03)
    assert checks[25].steer_error == 0.0


def test_after_a_start_the_actuators_may_be_where_they_were(vehicle):
    """The set-points are cut to the limits; the brakes still come from an emergency stop."""
    started = Watch(vehicle, message(0, 0.0, -22e3))
    ramps = [constant_ramp(Setpoints(0.0, -17e3), 0.6)]
    checks = started.watch(lambda k: (0.0, -17e3 - 5e3 * 0.5**k), 10, ramps)
    assert not any(check.faults for check in checks)
    assert checks[1].force_error == 0.0


def test_messages_count_once_and_only_while_they_are_recent(monitor):
    for k in range(1, 8):
        check = monitor.update(message(0, 0.1), AT_REST, 10 * k * MS)
        assert check.age_s == pytest.approx(10 * k * MS_S)
    assert check.faults == ()
    monitor.watch(lambda k: (0.1, 0.0), 8)
    assert monitor.state.faults == (STEER,)
    held = monitor.update(None, AT_REST, 8 * TICK)
    assert (held.faults, held.age_s) == ((STEER,), None)
    # a topic that falls silent counts as one that nobody publishes
    assert monitor.update(None, AT_REST, 11 * TICK) is None
    assert monitor.state.faults == ()
    assert monitor.update(message(8 * TICK, 0.1), AT_REST, 11 * TICK) is None, 'too old'


@pytest.fixture
def plan(monitor, car, params):
    """Return begin and target of plans after a fault of the steering, or of the force."""

    def begin_with(fault, angle=0.0, force=0.0):
        monitor.watch(lambda k: (angle, force), 8)
        assert monitor.state.faults == (fault,)

    def target(change, now):
        """Return what is sent for a plan that changes the set-points (rad, N)."""
        start = monitor.state.begin(now, params.limits)
        wanted = SetpointTarget(start.delta + change[0], start.Fx + change[1], 0.6)
        return monitor.state.target_from(wanted, start, now, car, params.limits, TICK_S)

    def begin(now):
        return monitor.state.begin(now, params.limits)

    return SimpleNamespace(begin_with=begin_with, target=target, begin=begin)


def test_a_steering_that_is_off_moves_as_planned_and_is_not_asked_for_ever_more(plan):
    plan.begin_with(STEER, angle=0.05)
    assert plan.begin(REST) == (0.05, 0.0)
    assert plan.target((-0.02, -500.0), REST) == (pytest.approx(-0.02), -500.0, 0.6)
    now = REST
    for _ in range(20):
        now = Setpoints(*plan.target((-0.02, 0.0), now)[:2])
    assert now.delta == pytest.approx(0.05 - LEAD_RAD)


def test_weak_brakes_are_asked_for_more_but_not_beyond_the_friction(plan, car, params):
    plan.begin_with(FORCE, force=3000.0)  # somebody drives while nobody asked for it
    now = Setpoints(0.0, -8000.0)
    assert plan.target((0.0, -1500.0), now).Fx == pytest.approx(-9500.0)
    for _ in range(20):
        sent = plan.target((0.0, -2000.0), now)
        assert now.Fx - 2000.0 * 1.001 <= sent.Fx <= now.Fx + 20.0  # load transfer
        now = Setpoints(0.0, sent.Fx)
    weight, limits = 9.81 * car.m, params.limits
    assert -now.Fx <= limits.friction_use * max(car.mu_f, car.mu_r) * weight
    assert -now.Fx >= 0.98 * min(limits.brake_n, limits.friction_use * car.mu_f * weight)


def test_a_driving_force_is_not_asked_for_beyond_the_plan(plan):
    """A driver brakes: the car does not drive against that."""
    plan.begin_with(FORCE, force=-6000.0)
    assert plan.target((0.0, 2000.0), REST).Fx == 0.0


def test_a_fault_is_reported_and_the_plan_begins_where_the_steering_is(controller, world):
    for k in range(1, 8):
        x = world.rolling(X=10.0 + k, stamp_ns=k * TICK)
        record = controller.step(TickInputs(x, actuators=message(k * TICK, 0.04)))
        values = controller.report(record)[1].values
        assert values.get(FAULT) == (STEER if k >= 5 else None)
        assert values['actuators.age_ms'] == 0.0
    assert 0.02 < values['actuators.steer_error_rad'] <= 0.08
    assert record.decision.plan.X[0][-2] == record.x0.delta == values['set_point.delta'] == 0.04
    *_, why = world.tick(controller, world.rolling(X=18.0, stamp_ns=20 * TICK))
    assert not [name for name in why.values if name.startswith('actuators')]
