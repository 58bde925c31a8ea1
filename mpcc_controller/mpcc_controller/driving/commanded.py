"""What the actuators have been told, over time: straight lines from set-point to set-point."""

from itertools import pairwise
from typing import NamedTuple

import numpy as np

from mpcc_controller.driving.target import SetPoints
from mpcc_controller.model import single_track
from mpcc_controller.model.single_track import Car
from mpcc_controller.parameters import Limits
from msgs_yaml.conversions import NS_PER_S
from msgs_yaml.types import Actuators, Command


class Ramp(NamedTuple):
    """The set-points move straight from `begin` to `end` and stay there.

    A command that takes hold when it is due already makes them jump: then both times are equal.
    """

    begin_ns: int
    begin: SetPoints
    end_ns: int
    end: SetPoints
    lambda_b: float  # -, front share of the braking force

    def at(self, stamp_ns: int) -> SetPoints:
        """Return the set-points at an instant."""
        return self.end if stamp_ns >= self.end_ns else self.before(stamp_ns)

    def before(self, stamp_ns: int) -> SetPoints:
        """Return the set-points just before an instant: another value only where they jump."""
        if stamp_ns <= self.begin_ns:
            return self.begin
        if stamp_ns >= self.end_ns:
            return self.end
        done = (stamp_ns - self.begin_ns) / (self.end_ns - self.begin_ns)
        return SetPoints(*(a + (b - a) * done for a, b in zip(self.begin, self.end)))


class Piece(NamedTuple):
    """A time over which the set-points move at constant rates."""

    seconds: float
    begin: SetPoints
    end: SetPoints


def pieces(ramp: Ramp, from_ns: int, to_ns: int) -> tuple[Piece, ...]:
    """Return the pieces between two instants, split where the ramp begins and ends."""
    # a command that was due at once has both in one instant
    corners = sorted({ns for ns in (ramp.begin_ns, ramp.end_ns) if from_ns < ns < to_ns})
    instants = [from_ns, *corners, to_ns]
    return tuple(
        Piece((b - a) / NS_PER_S, ramp.at(a), ramp.before(b)) for a, b in pairwise(instants)
    )


def held(set_points: SetPoints, lambda_b: float) -> Ramp:
    """Return set-points that have always been where they are."""
    return Ramp(0, set_points, 0, set_points, lambda_b)


def end(command: Command, car: Car) -> tuple[SetPoints, float]:
    """Return the set-points that a command leads to, and the front share of its braking."""
    Fx = command.Fxf + command.Fxr
    share = command.Fxf / Fx if Fx < 0 else single_track.ideal_split(Fx, car)
    return SetPoints(command.delta, Fx), float(share)


def where(actuators: Actuators, limits: Limits, stamp_ns: int) -> Command:
    """Return the command that would hold the actuators where they are, inside their limits."""
    force = actuators.Fxf + actuators.Fxr
    share = np.clip(force, -limits.brake_n, limits.drive_n) / force if force else 0.0
    if actuators.Fxf * actuators.Fxr < 0:
        share = 0.0
    return Command(
        stamp_ns=stamp_ns,
        delta=float(np.clip(actuators.delta, -limits.steer_rad, limits.steer_rad)),
        d_delta=0.0,
        Fxf=float(share * actuators.Fxf),
        Fxr=float(share * actuators.Fxr),
    )
