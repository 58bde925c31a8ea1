"""Compares the measured actuators with the set-points that were sent. SI units; stamps in ns.

However an actuator lags, without overshoot it is between the least and the greatest set-point of
the last while. One that is beyond these for longer does not do what is asked of it: it sticks, is
weaker, or somebody else moves it.

Set-points that all arrive late are another fault (`late_setpoints`). An axle that does not brake
beside one that does has lost its brakes. What is done then is in `actuator_faults`.
"""

from collections.abc import Sequence

from mpcc_controller.driving.actuator_faults import (
    FORCE,
    FRONT,
    LATE,
    REAR,
    STEER,
    ActuatorCheck,
    ActuatorState,
    Persistence,
)
from mpcc_controller.driving.delay_compensation import SetpointRamp, setpoints_at
from mpcc_controller.driving.late_setpoints import DelayEstimator
from mpcc_controller.driving.setpoints import Setpoints
from mpcc_controller.parameters import CarParams
from msgs_yaml.conversions import NS_PER_S
from msgs_yaml.types import Actuators

STEER_RAD = 0.012  # at the road wheel: three standard deviations of a cheap sensor's offset
FORCE_MPS2 = 1.0  # of the mass of the car
LAGS, UNANNOUNCED_S = 2.0, 0.05  # set-points that count: of so many lags, and of a delay besides
UNKNOWN_LAG_S = 0.1  # of a car file without lags
OLDEST_S = 0.1  # a message that differs more from the state's stamp says nothing
# a steering sticks that moves in so many messages by less than a share of what it is asked for,
STILL_MESSAGES, STILL_SHARE = 5, 0.1
MOVED_RAD, FREE_RAD = 0.004, 0.01  # which is at least so much; one that moves by more is free
# and was, in those that ended up to so many messages earlier: otherwise it may only be late
LATEST = 6
# one that followed before stands with less than this share of what its lag explains in so few
# messages or more. What follows was in so few nearer to what its lag explains than a share of the
# movement, which was at least so much
FOLLOWER_SHARE, FEW_MESSAGES, MOST_MESSAGES = 0.2, 3, 8
NEAR_SHARE, NEAR = 0.3, 0.17  # of the units of the comparison with a delay
# an axle of which at least so much is asked has lost its brakes if it has less than the share of it
# and the other one at least half, in so many messages; until it brakes with half of that force
LOST_MPS2, LOST_SHARE, LOST_MESSAGES = 0.15, 0.1, 3  # m/s^2 of the mass of the car


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
        errors = self._errors(measured, known.start, ramps, actuators.stamp_ns)
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
        stands = followed and not follows and _stands(delay.messages)
        # who stands while the forces follow is not late
        sticks = not follows and (
            _sticks(delay.messages, known.sticks) or (stands and is_prompt and not known.sticks)
        )
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
        return ActuatorState(
            start=known.start,
            last=actuators,
            check=check,
            persistences=persistences,
            delay=delay,
            sticks=sticks,
            stands=stands,
            followed=followed,
            lost=lost,
            lost_by=lost_by,
        )

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

    def _errors(self, measured, start, ramps, stamp_ns):
        """Return by how much measured values are beyond the set-points of the last while."""
        begins_ns = [stamp_ns - window_ns for window_ns in self._windows_ns]
        first_ns = min(begins_ns)
        corners = (ns for ramp in ramps for ns in (ramp.begin_ns, ramp.end_ns))
        instants = {stamp_ns, *begins_ns, *(ns for ns in corners if first_ns < ns < stamp_ns)}
        asked = [(ns, setpoints_at(ramps, ns)[0]) for ns in instants]
        errors = []
        for i, (value, begin_ns) in enumerate(zip(measured, begins_ns)):
            values = [point[i] for ns, point in asked if ns >= begin_ns]
            if start is not None and begin_ns <= start.stamp_ns:
                values.append(Setpoints(start.delta, start.Fxf + start.Fxr)[i])
            errors.append(value - min(max(value, min(values)), max(values)))
        return errors


def _explained(messages, i, unit):
    """Return the angles [rad] or forces [N] that the lag explains in messages."""
    return [m.measured[i] - unit * m.differences[i] for m in messages]


def _follows(messages, i, unit):
    """Return whether the steering (0) or the force (1) is where its lag explains, and moves."""
    moved = _range(_explained(messages, i, unit))
    farthest = unit * max(abs(message.differences[i]) for message in messages)
    return moved > NEAR * unit and farthest < NEAR_SHARE * moved


def _stands(messages):
    """Return whether the steering stands where its lag explains a movement: it sticks, or is late.

    One that is only a little late stands when a movement begins, and at a turn.
    """
    measured = [message.measured.delta for message in messages]
    explained = _explained(messages, 0, STEER_RAD)
    for number in range(FEW_MESSAGES, min(len(messages), MOST_MESSAGES) + 1):
        first, still = explained[-number], measured[-number:]
        early_rad, whole_rad = abs(explained[-2] - first), abs(explained[-1] - first)
        begins = early_rad < NEAR_SHARE * whole_rad or (
            abs(still[0] - first) > NEAR_SHARE * whole_rad
        )
        if not begins and whole_rad > MOVED_RAD and _range(still) < FOLLOWER_SHARE * whole_rad:
            return True
    return False


def _sticks(messages, stuck):
    """Return whether the steering stays where it is, though it is, or was, asked to move.

    What follows with a delay stays as long as the set-points did earlier.
    """
    measured = [message.measured.delta for message in messages]
    asked = [message.asked.delta for message in messages]
    if stuck:
        is_asked = any(abs(a - b) > MOVED_RAD for a, b in zip(asked, measured))
        return _range(measured[-FEW_MESSAGES:]) < FREE_RAD and is_asked
    if len(messages) < STILL_MESSAGES + LATEST:
        return False
    moved_rad = _range(measured[-STILL_MESSAGES:])
    # one less than measured: a delay may end between two messages
    ends = range(len(asked) - LATEST, len(asked) + 1)
    asked_rad = min(_range(asked[end - STILL_MESSAGES + 1 : end]) for end in ends)
    return asked_rad > MOVED_RAD and moved_rad < STILL_SHARE * asked_rad


def _range(values):
    return max(values) - min(values)


def _is_recent(actuators, state_ns):
    return abs(state_ns - actuators.stamp_ns) <= OLDEST_S * NS_PER_S
