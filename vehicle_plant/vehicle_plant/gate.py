"""The last check before the servos: what cannot be meant is refused, the last command stands."""

import math
from typing import NamedTuple

from msgs_yaml.types import Command
from vehicle_plant.parameters import Car
from vehicle_plant.state import SetPoints

NS_PER_S = 1_000_000_000


class Verdict(NamedTuple):
    """Whether a command passed, and if not, why."""

    accepted: bool
    reason: str  # empty when accepted


ACCEPTED = Verdict(True, '')


class Gate:
    """Accepts commands in time order; counts what it refuses."""

    def __init__(self, car: Car, last: SetPoints, stamp_ns: int):
        """Start from the set-points that the servos hold at stamp_ns."""
        self._car = car
        self._last = last
        self._stamp_ns = stamp_ns
        self.rejected = 0
        self.last_reason = ''

    def check(self, command: Command, now_ns: int, tick_ns: int) -> Verdict:
        """Judge a command that arrives at now_ns; one that passes becomes the last good one.

        Its set-points may differ from the last good ones by what the greatest rates allow in the
        time since, at least one tick.
        """
        elapsed_s = max(command.stamp_ns - self._stamp_ns, tick_ns) / NS_PER_S
        reason = self._objection(command, now_ns, elapsed_s)
        if reason:
            return self.refuse(reason)
        self._last = SetPoints(command.delta, command.Fxf, command.Fxr)
        self._stamp_ns = command.stamp_ns
        return ACCEPTED

    def refuse(self, reason: str) -> Verdict:
        """Count a command as refused."""
        self.rejected += 1
        self.last_reason = reason
        return Verdict(False, reason)

    def _objection(self, command: Command, now_ns: int, elapsed_s: float) -> str:
        if not all(math.isfinite(value) for value in command):
            return 'a value is not finite'
        if command.stamp_ns > now_ns:
            return 'the stamp lies in the future'
        if command.stamp_ns < self._stamp_ns:
            return 'the stamp is older than that of the last command'
        p, gate = self._car, self._car.gate
        steer = p.steering.limit_rad + gate.steer_tolerance_rad
        front, rear, spare = p.force.front, p.force.rear, gate.force_tolerance_n
        angle, force = gate.steer_rate_radps * elapsed_s, gate.force_rate_nps * elapsed_s
        rules = (
            ('steer', command.delta, -steer, steer, 'rad'),
            ('front_axle', command.Fxf, -front.brake_n - spare, front.drive_n + spare, 'N'),
            ('rear_axle', command.Fxr, -rear.brake_n - spare, rear.drive_n + spare, 'N'),
            ('steer step', command.delta - self._last.delta, -angle, angle, 'rad'),
            ('front_axle step', command.Fxf - self._last.Fxf, -force, force, 'N'),
            ('rear_axle step', command.Fxr - self._last.Fxr, -force, force, 'N'),
        )
        for name, value, low, high, unit in rules:
            if not low <= value <= high:
                return f'{name} is {value:.6g} {unit}, allowed {low:.6g} to {high:.6g}'
        return ''
