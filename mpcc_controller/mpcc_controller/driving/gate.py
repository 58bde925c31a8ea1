"""The last check before a command leaves. It trusts no plan and no solver. SI units.

It knows the limits, the last command that passed, and nothing else; it shares no code with the
problem that the commands come from.
"""

import math
from collections import Counter
from typing import NamedTuple

from mpcc_controller.model.single_track import GRAVITY, Car
from mpcc_controller.parameters import Limits
from msgs_yaml.types import Command

# to a state of such an age or order no command is right, whatever it says
UNTIMELY = ('too_old', 'from_future', 'not_newer')
ROUNDING = 1e-6  # relative; a command on its limit passes


class Verdict(NamedTuple):
    """What leaves, and why it is not what came."""

    command: Command
    reason: str  # '' when the command passed


class Gate:
    """Checks commands one after the other and counts what it turns back."""

    def __init__(self, limits: Limits, car: Car, step_s: float, max_age_s: float):
        self.limits = limits
        self.car = car
        self.step_s = step_s
        self.max_age_s = max_age_s
        self.rejections = Counter()

    def check(self, command: Command, last: Command, age_s: float) -> Verdict:
        """Return the command, or the last one held in its place.

        `age_s` is the age of the state that the command answers; a state from the future, by a
        tick or more, means that clocks disagree. The substitute keeps the steering where it was
        last told to be and takes the force off at its rate limit.
        """
        reason = self._fault(command, last, age_s)
        if not reason:
            return Verdict(command, '')
        self.rejections[reason] += 1
        return Verdict(self._hold(last, command.stamp_ns), reason)

    def again(self, command: Command, last: Command, age_s: float, refused: Verdict) -> Verdict:
        """Return another command in the place of a refused one, or what left in its place.

        The reason stays that of the first refusal; every refusal is counted.
        """
        second = self.check(command, last, age_s)
        return Verdict(second.command, refused.reason)

    def _fault(self, command, last, age_s):
        faults = {
            'not_finite': not all(math.isfinite(value) for value in command),
            'too_old': not age_s <= self.max_age_s,
            'from_future': age_s <= -self.step_s,
            'not_newer': command.stamp_ns <= last.stamp_ns,
            'out_of_range': not self._in_range(command),
            'too_fast': not self._in_rate(command, last),
            'beyond_friction': not self._in_friction(command),
        }
        return next((name for name, found in faults.items() if found), '')

    def _in_range(self, command):
        force = command.Fxf + command.Fxr
        return (
            abs(command.delta) <= _more(self.limits.steer_rad)
            and -_more(self.limits.brake_n) <= force <= _more(self.limits.drive_n)
            # an axle never drives while the other one brakes
            and command.Fxf * command.Fxr >= 0
        )

    def _in_rate(self, command, last):
        turn = abs(command.delta - last.delta)
        push = abs(command.Fxf + command.Fxr - last.Fxf - last.Fxr)
        return (
            turn <= _more(self.limits.steer_rate_radps) * self.step_s
            and push <= _more(self.limits.force_rate_nps) * self.step_s
            and abs(command.d_delta) <= _more(self.limits.steer_rate_radps)
        )

    def _in_friction(self, command):
        car, force = self.car, command.Fxf + command.Fxr
        weight, wheelbase = car.m * GRAVITY, car.l_f + car.l_r
        front = car.mu_f * (weight * car.l_r - car.h * force) / wheelbase
        rear = car.mu_r * (weight * car.l_f + car.h * force) / wheelbase
        return abs(command.Fxf) <= _more(front) and abs(command.Fxr) <= _more(rear)

    def _hold(self, last, stamp_ns):
        force = abs(last.Fxf + last.Fxr)
        kept = max(force - self.limits.force_rate_nps * self.step_s, 0.0)
        share = kept / force if force else 0.0
        return Command(stamp_ns, last.delta, 0.0, share * last.Fxf, share * last.Fxr)


def _more(limit):
    return limit * (1 + ROUNDING)
