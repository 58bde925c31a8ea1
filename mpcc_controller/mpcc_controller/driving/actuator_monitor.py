"""Compares the measured actuators with the set-points that were sent. SI units; stamps in ns.

However an actuator lags, without overshoot it is between the least and the greatest set-point of
the last while. One that is beyond these for longer does not do what is asked of it: it sticks, is
weaker, or somebody else moves it. Plans then begin where it is.

Set-points that all arrive late are another fault (`late_setpoints`). Plans then begin when they
arrive. An axle that does not brake beside one that does has lost its brakes. From then on forces
are those of the other one alone: ramps, plans, and the laws without a plan; not the braking after
an exception, which takes nothing from here.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from mpcc_controller.driving import braking, setpoints
from mpcc_controller.driving.delay_compensation import SetpointRamp, constant_ramp, setpoints_at
from mpcc_controller.driving.late_setpoints import DelayEstimate, DelayEstimator
from mpcc_controller.driving.setpoints import Setpoints, SetpointTarget
from mpcc_controller.model import single_track
from mpcc_controller.model.single_track import Car
from mpcc_controller.parameters import CarParams, Limits
from msgs_yaml.conversions import NS_PER_S, ns_to_s
from msgs_yaml.types import Actuators, Command

FAULT = 'actuators.fault'  # in the report
STEER, FORCE, LATE = 'steer', 'force', 'late'  # its words
FRONT, REAR = 'front', 'rear'  # likewise: the brakes of this axle are lost
STEER_RAD = 0.012  # at the road wheel: three standard deviations of a cheap sensor's offset
FORCE_MPS2 = 1.0  # of the mass of the car
CONFIRM_S, CLEAR_S = 0.18, 1.0  # four ticks in a row; a manoeuvre without a difference
LAGS, UNANNOUNCED_S = 2.0, 0.05  # set-points that count: of so many lags, and of a delay besides
UNKNOWN_LAG_S = 0.1  # of a car file without lags
OLDEST_S = 0.1  # a message that differs more from the state's stamp says nothing
# a steering sticks that moves in so many messages by less than a share of what it is asked for,
STILL_MESSAGES, STILL_SHARE = 5, 0.1
MOVED_RAD, FREE_RAD = 0.004, 0.01  # which is at least so much; one that moves by more is free
# and was, in those that ended up to so many messages earlier: otherwise it may only be late
LATEST = 6
# one that followed before sticks with less than this share of what its lag explains in so few
# messages or more, if the forces follow: then it is not late. What follows was in so few nearer to
# what its lag explains than a share of the movement, which was at least so much
FOLLOWER_SHARE, FEW_MESSAGES, MOST_MESSAGES = 0.2, 3, 8
NEAR_SHARE, NEAR = 0.3, 0.17  # of the units of the comparison with a delay
# an axle of which at least so much is asked has lost its brakes if it has less than the share of it
# and the other one at least half, in so many messages; until it brakes with half of that force
LOST_MPS2, LOST_SHARE, LOST_MESSAGES = 0.15, 0.1, 3  # m/s^2 of the mass of the car
PROBE_SHARE = 0.1  # of the force of the other one that it is asked for, so that it tells
# a sticking steering is not asked for more than this beyond where it is: it may come free
LEAD_RAD = 0.1


class ActuatorCheck(NamedTuple):
    """What the newest message of the actuators says."""

    age_s: float | None  # of the message when the state was measured; None: of an earlier tick
    measured: Setpoints
    steer_error: float  # rad beyond the set-points of the last while, 0 within them
    force_error: float  # N, the same
    faults: tuple[str, ...]  # of STEER, FORCE, LATE, FRONT, REAR
    late_ns: int  # delay of the set-points beyond what is known


class Persistence(NamedTuple):
    """Whether something is so since it was so for a while."""

    holds: bool = False
    agreed_ns: int | None = None  # when it last was as `holds` says

    def update(self, is_so: bool, stamp_ns: int) -> 'Persistence':
        """Return what holds after a message."""
        if self.agreed_ns is None or is_so == self.holds:
            return Persistence(self.holds, stamp_ns)
        if stamp_ns - self.agreed_ns >= (CLEAR_S if self.holds else CONFIRM_S) * NS_PER_S:
            return Persistence(is_so, stamp_ns)
        return self


class ActuatorState(NamedTuple):
    """What is known of the actuators after a tick, at first nothing."""

    start: Actuators | None = None  # where set-points began
    last: Actuators | None = None
    check: ActuatorCheck | None = None  # None where nothing is known of the actuators
    persistences: tuple[Persistence, Persistence] = (Persistence(), Persistence())
    delay: DelayEstimate = DelayEstimate()
    sticks: bool = False  # whether the steering does not move at all
    followed: bool = False  # whether it was seen to follow without a delay
    lost: str = ''  # FRONT or REAR: an axle without brakes
    lost_by: tuple[str, ...] = ()  # the same, as the last messages tell it

    @property
    def faults(self) -> tuple[str, ...]:
        """What does not follow, of STEER and FORCE, LATE set-points, and FRONT or REAR."""
        return self.check.faults if self.check else ()

    @property
    def held(self) -> dict[str, float]:
        """Where the actuators are that do not follow, by the field of their set-point."""
        fields = {'delta': STEER, 'Fx': FORCE}
        return {k: getattr(self.check.measured, k) for k, v in fields.items() if v in self.faults}

    def begin(self, now: Setpoints, limits: Limits) -> Setpoints:
        """Return where a plan begins: at `now`, and where an actuator does not follow, there."""
        ranges = {
            'delta': (-limits.steer_rad, limits.steer_rad),
            'Fx': (-limits.brake_n, limits.drive_n),
        }
        held = {k: min(max(v, ranges[k][0]), ranges[k][1]) for k, v in self.held.items()}
        return now._replace(**held)

    def acting(self, ramps: Sequence[SetpointRamp]) -> Sequence[SetpointRamp]:
        """Return ramps of what acts on the car: of an actuator with a fault where it is."""
        held = self.held
        if not held:
            return ramps
        return tuple(
            ramp._replace(begin=ramp.begin._replace(**held), end=ramp.end._replace(**held))
            for ramp in ramps
        )

    @property
    def lost_force(self) -> str:
        """The force of a command that lost brakes do not give, '' where none are lost."""
        return {FRONT: 'Fxf', REAR: 'Fxr'}.get(self.lost, '')

    def left_of(self, ramp: SetpointRamp) -> SetpointRamp:
        """Return a ramp of what the other axle brakes with beside lost brakes."""
        if not self.lost:
            return ramp
        front = 0.0 if self.lost == FRONT else 1.0
        share = ramp.lambda_b if front else 1 - ramp.lambda_b
        ends = [p._replace(Fx=share * p.Fx if p.Fx < 0 else p.Fx) for p in (ramp.begin, ramp.end)]
        return ramp._replace(begin=ends[0], end=ends[1], lambda_b=front)

    def setpoints_of(self, command: Command, car: Car) -> tuple[Setpoints, float]:
        """Return `setpoints.setpoints_of` of a command without lost brakes."""
        ramp = self.left_of(constant_ramp(*setpoints.setpoints_of(command, car)))
        return ramp.end, ramp.lambda_b

    def limits_left(self, limits: Limits, car: Car) -> Limits:
        """Return the limits of a car that brakes with the axle that is left, on its friction."""
        if not self.lost:
            return limits
        share = 0.0 if self.lost == FRONT else 1.0
        left = replace(limits, brake_front_share_min=share, brake_front_share_max=share)
        return replace(left, brake_n=braking.max_braking_force(0.0, car, left))

    def probing(self, command: Command, last: Command, limits: Limits, step_s: float) -> Command:
        """Return a command that asks lost brakes for a little, to see whether they are back.

        That is reached from the `last` command within the rate limit of the whole force.
        """
        if not self.lost:
            return command
        lost, other = self.lost_force, 'Fxr' if self.lost == FRONT else 'Fxf'
        force, before = getattr(command, other), getattr(last, lost)
        if before < 0:  # no axle drives while the other one is asked to brake
            force = min(force, 0.0)
        rest, most = before - force + getattr(last, other), limits.force_rate_nps * step_s
        wanted = getattr(command, lost) + PROBE_SHARE * min(force, 0.0)
        asked = min(max(wanted, rest - most), rest + most)
        if force < 0:  # by rounding, too, no axle drives then
            asked = min(asked, 0.0)
        return command._replace(**{other: force, lost: asked})

    def target_from(
        self,
        target: SetpointTarget,
        start: Setpoints,
        now: Setpoints,
        car: Car,
        limits: Limits,
        step_s: float,
    ) -> SetpointTarget:
        """Return the set-points to send for a target that was planned from `start`.

        The set-points `now` change by as much as the plan does: of an actuator that is off by an
        amount or a share, only that leads to the target. A driving force is not asked for beyond
        the plan, steering not further beyond where it is.
        """
        if not self.held:
            return target
        delta, Fx, lambda_b = target
        if STEER in self.faults and not self.sticks:  # it would come free far from there
            measured = self.check.measured.delta
            lead = max(LEAD_RAD, abs(now.delta - measured))
            delta = np.clip(now.delta + delta - start.delta, measured - lead, measured + lead)
            delta = float(np.clip(delta, -limits.steer_rad, limits.steer_rad))
        if FORCE in self.faults:
            Fx = min(now.Fx + Fx - start.Fx, max(Fx, 0.0))
            Fz = single_track.loads(Fx, car)
            grip = limits.friction_use * (car.mu_f * Fz.f + car.mu_r * Fz.r)
            Fx = float(np.clip(Fx, -min(limits.brake_n, grip), limits.drive_n))
            lambda_b = setpoints.split_within_friction(lambda_b, Fx, car, limits)
        return setpoints.within_rates(SetpointTarget(delta, Fx, lambda_b), now, limits, step_s)

    def describe(self) -> str:
        """Return a line for the log: where actuators are that do not follow their set-points."""
        if not self.faults:
            return 'the actuators follow their set-points'
        check, off = self.check, 'beyond what was asked for, plans begin there'
        angle = f'steering angle {check.measured.delta:.3f} rad'
        texts = {
            STEER: f'{angle}, {check.steer_error:+.3f} rad {off}',
            FORCE: f'force {check.measured.Fx:.0f} N, {check.force_error:+.0f} N {off}',
            FRONT: 'the brakes in front are lost, the car brakes with those of the rear axle',
            REAR: 'the brakes of the rear axle are lost, the car brakes with those in front',
            LATE: f'set-points arrive {1e3 * ns_to_s(check.late_ns):.0f} ms late, plans begin then',
        }
        if self.sticks:
            texts[STEER] = f'{angle}, which does not move, the car stops'
        return f'actuators do not follow: {"; ".join(texts[name] for name in self.faults)}'


class ActuatorMonitor:
    """Compares messages of the actuators with the set-points that were sent."""

    def __init__(self, vehicle: CarParams):
        lags = (vehicle.actuators.steer_lag_s, vehicle.actuators.force_lag_s)
        # s, of steering and force behind their set-points
        self.lags = tuple(UNKNOWN_LAG_S if lag is None else lag for lag in lags)
        windows_s = (LAGS * lag + UNANNOUNCED_S for lag in self.lags)
        self._windows_ns = [round(window_s * NS_PER_S) for window_s in windows_s]
        self._thresholds = STEER_RAD, FORCE_MPS2 * vehicle.car.mass_kg
        self._least_n = LOST_MPS2 * vehicle.car.mass_kg
        self._delays = DelayEstimator(self.lags, self._thresholds)
        self.memory_s = max(self._windows_ns) / NS_PER_S + OLDEST_S  # of set-points

    def update(
        self,
        known: ActuatorState,
        actuators: Actuators | None,
        ramps: Sequence[SetpointRamp],
        state_ns: int,
    ) -> ActuatorState:
        """Compare a message at its own stamp, and return what is known.

        Without a message that is the last check, until it is too old: a topic that falls silent
        counts as one that nobody publishes. A delay that was found stays.
        """
        last = known.last
        if actuators is None or not _is_recent(actuators, state_ns):
            if last is None:
                return known
            if not _is_recent(last, state_ns):
                return ActuatorState(delay=known.delay)
            return known._replace(check=known.check._replace(age_s=None))
        age_s = (state_ns - actuators.stamp_ns) / NS_PER_S
        if last is not None and actuators.stamp_ns <= last.stamp_ns:  # the same message again
            return known._replace(check=known.check._replace(age_s=age_s))
        measured = Setpoints(actuators.delta, actuators.Fxf + actuators.Fxr)
        errors = [
            self._error(i, measured[i], known.start, ramps, actuators.stamp_ns)
            for i in range(len(measured))
        ]
        delay = self._delays.update(known.delay, measured, ramps, actuators.stamp_ns)
        persistences = tuple(
            persistence.update(abs(error) > threshold, actuators.stamp_ns)
            for persistence, error, threshold in zip(known.persistences, errors, self._thresholds)
        )
        if delay.late_ns != known.delay.late_ns:  # compared anew
            persistences = (Persistence(), Persistence())
        follows, is_prompt = (
            _follows(delay.messages[-FEW_MESSAGES:], i, unit)
            for i, unit in enumerate(self._thresholds)
        )
        # what is found of a delay is not exact
        followed = not delay.late_ns and (follows or known.followed)
        sticks = not follows and _sticks(delay.messages, known.sticks, followed and is_prompt)
        lost_by = (*known.lost_by, self._lost(known.lost, actuators, ramps))[-LOST_MESSAGES:]
        agree = len(lost_by) == LOST_MESSAGES and len({*lost_by}) == 1
        lost = lost_by[-1] if agree else known.lost
        if lost != known.lost:  # other forces are compared from now on
            persistences = (persistences[0], Persistence())
            delay = delay._replace(messages=())
        has = {
            STEER: persistences[0].holds or sticks,
            FORCE: persistences[1].holds,
            LATE: bool(delay.late_ns),
            lost: bool(lost),
        }
        faults = tuple(name for name, is_so in has.items() if is_so)
        check = ActuatorCheck(age_s, measured, *errors, faults, delay.late_ns)
        known = ActuatorState(known.start, actuators, check, persistences, delay, sticks, followed)
        return known._replace(lost=lost, lost_by=lost_by)

    def _lost(self, lost, actuators, ramps):
        """Return the axle without brakes as a message tells it: also the known one for nothing."""
        brakes = {FRONT: -actuators.Fxf, REAR: -actuators.Fxr}
        if lost:
            return '' if brakes[lost] > self._least_n / 2 else lost
        lag_ns = round(self.lags[1] * NS_PER_S)
        (_, Fx), lambda_b = setpoints_at(ramps, actuators.stamp_ns - lag_ns)
        asked = {FRONT: -lambda_b * Fx, REAR: -(1 - lambda_b) * Fx}
        if min(asked.values()) < self._least_n:
            return ''
        shares = {axle: brakes[axle] / asked[axle] for axle in asked}
        least = min(shares, key=shares.get)
        return least if shares[least] < LOST_SHARE and max(shares.values()) > 0.5 else ''

    def _error(self, i, measured, start, ramps, stamp_ns):
        """Return by how much a measured value is beyond the set-points of the last while."""
        since_ns = stamp_ns - self._windows_ns[i]
        corners = (ns for ramp in ramps for ns in (ramp.begin_ns, ramp.end_ns))
        instants = {since_ns, stamp_ns, *(ns for ns in corners if since_ns < ns < stamp_ns)}
        values = [setpoints_at(ramps, ns)[0][i] for ns in instants]
        if start is not None and since_ns <= start.stamp_ns:
            values.append(Setpoints(start.delta, start.Fxf + start.Fxr)[i])
        return measured - min(max(measured, min(values)), max(values))


def _explained(messages, i, unit):
    """Return the angles [rad] or forces [N] that the lag explains in messages."""
    return [m.measured[i] - unit * m.differences[i] for m in messages]


def _follows(messages, i, unit):
    """Return whether the steering (0) or the force (1) is where its lag explains, and moves."""
    moved = _range(_explained(messages, i, unit))
    farthest = unit * max(abs(message.differences[i]) for message in messages)
    return moved > NEAR * unit and farthest < NEAR_SHARE * moved


def _sticks(messages, stuck, in_time):
    """Return whether the steering stays where it is, though it is, or was, asked to move.

    What follows with a delay stays as long as the set-points did earlier; `in_time`: it has none.
    """
    measured = [message.measured.delta for message in messages]
    asked = [message.asked.delta for message in messages]
    moved_rad = _range(measured[-STILL_MESSAGES:])
    if stuck:
        is_asked = any(abs(a - b) > MOVED_RAD for a, b in zip(asked, measured))
        return _range(measured[-FEW_MESSAGES:]) < FREE_RAD and is_asked
    most = min(len(messages), MOST_MESSAGES) if in_time else 0
    for number in range(FEW_MESSAGES, most + 1):
        still, explained = measured[-number:], _explained(messages[-number:], 0, STEER_RAD)
        early_rad, whole_rad = (abs(explained[k] - explained[0]) for k in (-2, -1))
        # one that is a little late stands still when a movement begins, and at a turn
        is_late = early_rad < NEAR_SHARE * whole_rad
        is_late |= abs(still[0] - explained[0]) > NEAR_SHARE * whole_rad
        if not is_late and whole_rad > MOVED_RAD and _range(still) < FOLLOWER_SHARE * whole_rad:
            return True
    if len(messages) < STILL_MESSAGES + LATEST:
        return False
    # one less than measured: a delay may end between two messages
    ends = range(len(asked) - LATEST, len(asked) + 1)
    asked_rad = min(_range(asked[end - STILL_MESSAGES + 1 : end]) for end in ends)
    return asked_rad > MOVED_RAD and moved_rad < STILL_SHARE * asked_rad


def _range(values):
    return max(values) - min(values)


def _is_recent(actuators, state_ns):
    return abs(state_ns - actuators.stamp_ns) <= OLDEST_S * NS_PER_S
