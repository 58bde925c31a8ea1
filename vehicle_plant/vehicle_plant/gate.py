"""The last check before the servos: an implausible command is rejected, the last one stands.

It shares no code with the gate of the controller and does not know the controller's limits: the
car's own actuators and tyres decide which commands are plausible.
"""

import copy
import math
from collections import Counter
from collections.abc import Iterator
from typing import NamedTuple

from msgs_yaml import contract
from msgs_yaml.conversions import NS_PER_S
from msgs_yaml.types import Command
from vehicle_plant.parameters import PlantParams
from vehicle_plant.state import SetPoints

COMMAND = contract.load().topics['/controller/command']
HELD_TICKS = round(COMMAND.held_s * COMMAND.rate_hz[contract.REALTIME])
OLDEST_TICKS = 1 + HELD_TICKS  # a command is due after one tick and then held (see `stepping`)
UNREADABLE = 'unreadable'


class Verdict(NamedTuple):
    """Whether a command passed, and if not, why."""

    accepted: bool
    reason: str  # empty when accepted


ACCEPTED = Verdict(True, '')


class Gate:
    """Accepts commands in time order; counts the rejected ones."""

    def __init__(self, params: PlantParams, friction: float, last: SetPoints, stamp_ns: int):
        """Start from the set-points that the servos hold at stamp_ns.

        friction: road friction relative to the tyre's test surface.
        """
        self._params = params
        # locking wheels on a slippery road are plausible
        self._friction = max(friction, 1.0)
        self._last = last
        self._stamp_ns = stamp_ns
        self.rejections = Counter()  # by the code of the violation
        self.last_code = self.last_reason = ''

    def fork(self) -> 'Gate':
        """Return a second gate in the same state; either goes on without the other."""
        other = copy.copy(self)
        other.rejections = self.rejections.copy()
        return other

    @property
    def stamp_ns(self) -> int:
        """The stamp of the last accepted command, or of the start."""
        return self._stamp_ns

    @property
    def rejected(self) -> int:
        """The number of rejected commands."""
        return sum(self.rejections.values())

    def check(self, command: Command, now_ns: int, tick_ns: int) -> Verdict:
        """Check a command that arrives at now_ns; an accepted one becomes the last one.

        Its set-points may differ from the last ones by what the greatest rates allow in the time
        between, at least one tick.
        """
        for code, reason in self._violations(command, now_ns, tick_ns):
            return self.reject(reason, code)
        self._last = SetPoints(command.delta, command.Fxf, command.Fxr)
        self._stamp_ns = command.stamp_ns
        return ACCEPTED

    def reject(self, reason: str, code: str = UNREADABLE) -> Verdict:
        """Count a command as rejected."""
        self.rejections[code] += 1
        self.last_code, self.last_reason = code, reason
        return Verdict(False, reason)

    def _violations(self, command: Command, now_ns: int, tick_ns: int) -> Iterator[tuple[str, str]]:
        """Yield a word to count by and a reason for a person, per rule that is broken."""
        if not all(math.isfinite(value) for value in command):
            yield 'not_finite', 'a value is not finite'
        if command.stamp_ns > now_ns:
            yield 'from_future', 'the stamp lies in the future'
        if command.stamp_ns < self._stamp_ns:
            yield 'out_of_order', 'the stamp is older than that of the last command'
        age_ns = now_ns - command.stamp_ns
        if age_ns > OLDEST_TICKS * tick_ns:
            yield 'too_old', f'the command is {age_ns / NS_PER_S:g} s old'
        for code, name, value, low, high, unit in self._rules(command, tick_ns):
            if not low <= value <= high:
                allowed = f'allowed {low:.6g} to {high:.6g}'
                yield code, f'{name} is {value:.6g} {unit}, {allowed}'

    def _rules(self, command, tick_ns):
        """Yield (code, name, value, lowest, highest, unit) of every limited quantity."""
        p, gate, last = self._params.car, self._params.car.gate, self._last
        elapsed_s = max(command.stamp_ns - self._stamp_ns, tick_ns) / NS_PER_S
        steer = p.steering.limit_rad + gate.steer_tolerance_rad
        angle, force = gate.steer_rate_radps * elapsed_s, gate.force_rate_nps * elapsed_s
        yield 'out_of_range', 'steer', command.delta, -steer, steer, 'rad'
        yield 'too_fast', 'steer step', command.delta - last.delta, -angle, angle, 'rad'
        front_grip, rear_grip = axle_friction(
            command.Fxf + command.Fxr, self._params, self._friction
        )
        for name, axle, value, before, grip in (
            ('front', p.force.front, command.Fxf, last.Fxf, front_grip),
            ('rear', p.force.rear, command.Fxr, last.Fxr, rear_grip),
        ):
            low = -axle.brake_n - gate.force_tolerance_n
            high = axle.drive_n + gate.force_tolerance_n
            limit = gate.friction_use * grip
            yield 'out_of_range', f'{name}_axle', value, low, high, 'N'
            yield 'too_fast', f'{name}_axle step', value - before, -force, force, 'N'
            yield 'beyond_friction', f'{name}_axle friction', value, -limit, limit, 'N'


def axle_friction(Fx: float, params: PlantParams, friction: float) -> tuple[float, float]:
    """Return the longitudinal friction force [N] of the front and of the rear axle.

    Fx [N]: the force of both axles, which transfers load; it counts up to the friction of the whole
    car. The tyre's friction is that of its two coefficients (Pacejka 2012, 4.E13).
    """
    body, tyre = params.car.body, params.tyre
    weight, wheelbase = body.mass_kg * body.gravity_mps2, body.cog_to_front_m + body.cog_to_rear_m
    most = friction * tyre.longitudinal.PDX1 * weight
    transfer = body.cog_height_m * min(max(Fx, -most), most) / wheelbase
    front = weight * body.cog_to_rear_m / wheelbase - transfer
    rear = weight * body.cog_to_front_m / wheelbase + transfer
    factors = params.car.scaling
    grips = []
    for load, scaling in ((front, factors.front), (rear, factors.rear)):
        nominal = tyre.reference.FNOMIN * scaling.LFZO
        excess = (load / 2 - nominal) / nominal
        peak = (tyre.longitudinal.PDX1 + tyre.longitudinal.PDX2 * excess) * scaling.LMUX
        grips.append(friction * peak * load)
    return tuple(grips)
