"""Safety gate: the last check of a command before it is published. SI units.

It uses the limits, the last command and the friction that is believed, and shares no code with the
optimal control problem.
"""

import math
from typing import NamedTuple

from mpcc_controller.model.single_track import GRAVITY, Car
from mpcc_controller.parameters import Limits
from msgs_yaml.types import Command

# the state is too old or out of order: no other command would pass either
UNTIMELY = ('too_old', 'from_future', 'not_newer')
ROUNDING = 1e-6  # relative; a command on its limit passes


class GateResult(NamedTuple):
    """The command to publish, and why it is not the one that was checked."""

    command: Command
    reason: str  # '' if the command passed


class Gate(NamedTuple):
    """The limits of commands."""

    limits: Limits
    car: Car  # identified, on the friction of the start
    step_s: float
    max_age_s: float
    axle_rate_nps: float = math.inf  # what the actuators of one axle can do, `limits`: of both
    lost: str = ''  # 'Fxf' or 'Fxr' of an axle without brakes: what is asked of it does not act

    def check(self, command: Command, last: Command, age_s: float, to_brake: Car) -> GateResult:
        """Return the command, or if it is rejected the last one held.

        `age_s` is the age of the state that the command answers; a state from the future, by a
        tick or more, means that clocks disagree. `to_brake` is the car on the friction that
        braking may use now (`PredictionModel.car_to_brake`). The held command keeps the steering
        set-point and the brakes; it releases a driving force at its rate limit.
        """
        checks = {
            'not_finite': not all(math.isfinite(value) for value in command),
            'too_old': not age_s <= self.max_age_s,
            'from_future': age_s <= -self.step_s,
            'not_newer': command.stamp_ns <= last.stamp_ns,
            'out_of_range': not self._in_range(command),
            'too_fast': not self._in_rate(command, last),
            'beyond_friction': not self._in_friction(command, last, to_brake),
        }
        reason = next((reason for reason, failed in checks.items() if failed), '')
        return GateResult(self._hold(last, command.stamp_ns) if reason else command, reason)

    def _in_range(self, command):
        force = command.Fxf + command.Fxr
        return (
            abs(command.delta) <= _rounded_up(self.limits.steer_rad)
            and -_rounded_up(self.limits.brake_n) <= force <= _rounded_up(self.limits.drive_n)
            # no axle drives while the other brakes
            and command.Fxf * command.Fxr >= 0
        )

    def _in_rate(self, command, last):
        steer_step = abs(command.delta - last.delta)
        front, rear = command.Fxf - last.Fxf, command.Fxr - last.Fxr
        force_step = abs(command.Fxf + command.Fxr - last.Fxf - last.Fxr)
        axle_step = max(abs(front), abs(rear))
        return (
            steer_step <= _rounded_up(self.limits.steer_rate_radps) * self.step_s
            and force_step <= _rounded_up(self.limits.force_rate_nps) * self.step_s
            and axle_step <= _rounded_up(self.axle_rate_nps) * self.step_s
            and abs(command.d_delta) <= _rounded_up(self.limits.steer_rate_radps)
        )

    def _in_friction(self, command, last, to_brake):
        """Return whether no axle gets more than the friction of the identified car.

        Nor more than that of the car `to_brake`, unless the last command asked for as much: forces
        take time to fall when the belief does.
        """
        if self.lost:
            nothing = {self.lost: 0.0}
            command, last = command._replace(**nothing), last._replace(**nothing)
        allowed = max(1.0, _friction_use(last, to_brake))
        return _friction_use(command, self.car) <= _rounded_up(1.0) and _friction_use(
            command, to_brake
        ) <= _rounded_up(allowed)

    def _hold(self, last, stamp_ns):
        driving = max(last.Fxf + last.Fxr, 0.0)
        kept = max(driving - self.limits.force_rate_nps * self.step_s, 0.0)
        share = kept / driving if driving else 1.0
        return Command(stamp_ns, last.delta, 0.0, share * last.Fxf, share * last.Fxr)


def _friction_use(command, car):
    """Return the larger share of mu Fz of both axles, with the loads under that force."""
    force, weight, wheelbase = command.Fxf + command.Fxr, car.m * GRAVITY, car.l_f + car.l_r
    front = car.mu_f * (weight * car.l_r - car.h * force) / wheelbase
    rear = car.mu_r * (weight * car.l_f + car.h * force) / wheelbase
    if min(front, rear) <= 0:  # an axle lifts off
        return math.inf
    return max(abs(command.Fxf) / front, abs(command.Fxr) / rear)


def _rounded_up(limit):
    return limit * (1 + ROUNDING)
