"""The last check before the servos: what cannot be meant is refused, the last command stands.

It shares no code with the gate of the controller and does not know its limits: the car's own
actuators and tyres decide what can be meant.
"""

import math
from collections import Counter
from collections.abc import Iterator
from typing import NamedTuple

from msgs_yaml.types import Command
from vehicle_plant.parameters import PlantParams
from vehicle_plant.state import SetPoints

NS_PER_S = 1_000_000_000
OLDEST_TICKS = 3  # a command is due after one tick and held for two more (see `ring`)
UNREADABLE = 'unreadable'


class Verdict(NamedTuple):
    """Whether a command passed, and if not, why."""

    accepted: bool
    reason: str  # empty when accepted


class Objection(NamedTuple):
    """What is wrong with a command."""

    code: str  # one word, to count by
    reason: str  # for a person


ACCEPTED = Verdict(True, '')


class Gate:
    """Accepts commands in time order; counts what it refuses."""

    def __init__(self, params: PlantParams, friction: float, last: SetPoints, stamp_ns: int):
        """Start from the set-points that the servos hold at stamp_ns.

        friction: road friction over that of the tyre's test surface.
        """
        self._params, self._car = params, params.car
        # wheels that lock on a slippery road are physics, not nonsense
        self._friction = max(friction, 1.0)
        self._last = last
        self._stamp_ns = stamp_ns
        self.rejections = Counter()  # by the code of the objection
        self.last_code = self.last_reason = ''

    @property
    def rejected(self) -> int:
        """How many commands were refused."""
        return sum(self.rejections.values())

    def check(self, command: Command, now_ns: int, tick_ns: int) -> Verdict:
        """Judge a command that arrives at now_ns; one that passes becomes the last good one.

        Its set-points may differ from the last good ones by what the greatest rates allow in the
        time since, at least one tick.
        """
        objection = next(self._objections(command, now_ns, tick_ns), None)
        if objection:
            return self.refuse(objection.reason, objection.code)
        self._last = SetPoints(command.delta, command.Fxf, command.Fxr)
        self._stamp_ns = command.stamp_ns
        return ACCEPTED

    def refuse(self, reason: str, code: str = UNREADABLE) -> Verdict:
        """Count a command as refused."""
        self.rejections[code] += 1
        self.last_code, self.last_reason = code, reason
        return Verdict(False, reason)

    def _objections(self, command: Command, now_ns: int, tick_ns: int) -> Iterator[Objection]:
        if not all(math.isfinite(value) for value in command):
            yield Objection('not_finite', 'a value is not finite')
        if command.stamp_ns > now_ns:
            yield Objection('from_future', 'the stamp lies in the future')
        if command.stamp_ns < self._stamp_ns:
            yield Objection('out_of_order', 'the stamp is older than that of the last command')
        age_ns = now_ns - command.stamp_ns
        if age_ns > OLDEST_TICKS * tick_ns:
            yield Objection('too_old', f'the command is {age_ns / NS_PER_S:g} s old')
        for code, name, value, low, high, unit in self._rules(command, tick_ns):
            if not low <= value <= high:
                allowed = f'allowed {low:.6g} to {high:.6g}'
                yield Objection(code, f'{name} is {value:.6g} {unit}, {allowed}')

    def _rules(self, command, tick_ns):
        """Return (code, name, value, lowest, highest, unit) of everything that has a limit."""
        p, gate = self._car, self._car.gate
        elapsed_s = max(command.stamp_ns - self._stamp_ns, tick_ns) / NS_PER_S
        steer = p.steering.limit_rad + gate.steer_tolerance_rad
        angle, force = gate.steer_rate_radps * elapsed_s, gate.force_rate_nps * elapsed_s
        yield 'out_of_range', 'steer', command.delta, -steer, steer, 'rad'
        yield 'too_fast', 'steer step', command.delta - self._last.delta, -angle, angle, 'rad'
        grip = axle_friction(command.Fxf + command.Fxr, self._params, self._friction)
        axles = zip(('front', 'rear'), (command.Fxf, command.Fxr), self._last[1:], grip)
        for name, value, last, friction in axles:
            axle, limit = getattr(p.force, name), gate.friction_use * friction
            spare = gate.force_tolerance_n
            low, high = -axle.brake_n - spare, axle.drive_n + spare
            yield 'out_of_range', f'{name}_axle', value, low, high, 'N'
            yield 'too_fast', f'{name}_axle step', value - last, -force, force, 'N'
            yield 'beyond_friction', f'{name}_axle friction', value, -limit, limit, 'N'


def axle_friction(Fx: float, params: PlantParams, friction: float) -> tuple[float, float]:
    """Return the force [N] that the tyres of the front and of the rear axle hold lengthways.

    Fx [N]: the force of both axles, which moves load from one to the other; it counts up to the
    friction of the whole car. The tyre's friction is that of its two coefficients (4.E13).
    """
    body, tyre = params.car.body, params.tyre
    weight, wheelbase = body.mass_kg * body.gravity_mps2, body.cog_to_front_m + body.cog_to_rear_m
    held = friction * tyre.longitudinal.PDX1 * weight
    moved = body.cog_height_m * min(max(Fx, -held), held) / wheelbase
    front = weight * body.cog_to_rear_m / wheelbase - moved
    rear = weight * body.cog_to_front_m / wheelbase + moved
    scaling = params.car.scaling
    return tuple(
        friction * _friction(load / 2, tyre, one) * load
        for load, one in ((front, scaling.front), (rear, scaling.rear))
    )


def _friction(Fz, tyre, scaling):
    nominal = tyre.reference.FNOMIN * scaling.LFZO
    excess = (Fz - nominal) / nominal
    return (tyre.longitudinal.PDX1 + tyre.longitudinal.PDX2 * excess) * scaling.LMUX
