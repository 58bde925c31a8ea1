"""Delay compensation: predict the state to the instant at which its command takes effect.

A command takes effect after computing and transport. The controller plans from the state that the
prediction model reaches by then under the set-points already sent. SI units; no clock is read here.
"""

import math
from collections.abc import Sequence
from functools import cache
from itertools import pairwise, zip_longest
from statistics import median
from typing import NamedTuple

import casadi as ca
import numpy as np

from mpcc_controller.driving.setpoints import Setpoints
from mpcc_controller.model import single_track
from mpcc_controller.model.single_track import Car, Input, State
from mpcc_controller.parameters import Delay
from msgs_yaml.conversions import NS_PER_S
from msgs_yaml.types import VehicleState
from stage_solver import stage_problem

MAX_STEP_S = 0.01  # of the integration
# computing times that count, 1 s of ticks: adapts to a busy machine, ignores an outlier
WINDOW = 20


class SetpointRamp(NamedTuple):
    """Set-points that move linearly from `begin` to `end` and then stay.

    A command that takes effect when it is already due makes them jump: both times are then equal.
    """

    begin_ns: int
    begin: Setpoints
    end_ns: int
    end: Setpoints
    lambda_b: float  # -, front share of the braking force

    def at(self, stamp_ns: int) -> Setpoints:
        """Return the set-points at an instant."""
        return self.end if stamp_ns >= self.end_ns else self.before(stamp_ns)

    def before(self, stamp_ns: int) -> Setpoints:
        """Return the set-points just before an instant; differs from `at` only at a jump."""
        if stamp_ns <= self.begin_ns:
            return self.begin
        if stamp_ns >= self.end_ns:
            return self.end
        share = (stamp_ns - self.begin_ns) / (self.end_ns - self.begin_ns)
        (delta, Fx), (delta_end, Fx_end) = self.begin, self.end
        return Setpoints(delta + (delta_end - delta) * share, Fx + (Fx_end - Fx) * share)


def setpoints_at(ramps: Sequence[SetpointRamp], stamp_ns: int) -> tuple[Setpoints, float]:
    """Return set-points and brake split at an instant; each ramp ends where the next one begins."""
    for ramp in reversed(ramps):  # before the first one begins it holds
        if ramp.begin_ns <= stamp_ns:
            break
    return ramp.at(stamp_ns), ramp.lambda_b


def constant_ramp(setpoints: Setpoints, lambda_b: float) -> SetpointRamp:
    """Return a ramp that holds the set-points at all times."""
    return SetpointRamp(0, setpoints, 0, setpoints, lambda_b)


def shifted(ramps: Sequence[SetpointRamp], by_ns: int) -> tuple[SetpointRamp, ...]:
    """Return ramps that act so much later."""
    return tuple(
        ramp._replace(begin_ns=ramp.begin_ns + by_ns, end_ns=ramp.end_ns + by_ns) for ramp in ramps
    )


def still_needed(ramps: Sequence[SetpointRamp], from_ns: int) -> tuple[SetpointRamp, ...]:
    """Return the ramps that hold at an instant or later: each ends where the next one begins."""
    ended = sum(following.begin_ns <= from_ns for following in ramps[1:])
    return tuple(ramps[ended:])


def predict(
    measured: VehicleState, ramps: Sequence[SetpointRamp], stamp_ns: int, car: Car
) -> VehicleState:
    """Return the state at `stamp_ns`; the measured state itself if that is its stamp.

    Uses midpoint steps of the prediction model: the actuators of a car with lags follow their
    set-points with these, those of others at once. Each of the `ramps` holds until the next one
    begins.
    """
    if stamp_ns == measured.stamp_ns:
        return measured
    x = State(*measured[1:], theta=0.0, delta=0.0, Fx=0.0)
    begin_ns, numbers = measured.stamp_ns, np.array(car)
    step = midpoint_step(single_track.structure(car))
    for ramp, following in zip_longest(ramps, ramps[1:]):
        end_ns = min(following.begin_ns, stamp_ns) if following else stamp_ns
        if end_ns > begin_ns:
            # begin and end coincide for a command that was due when it took effect
            corners = {ns for ns in (ramp.begin_ns, ramp.end_ns) if begin_ns < ns < end_ns}
            for from_ns, to_ns in pairwise([begin_ns, *sorted(corners), end_ns]):
                begin, end, t = ramp.at(from_ns), ramp.before(to_ns), (to_ns - from_ns) / NS_PER_S
                rates = (end.delta - begin.delta) / t, (end.Fx - begin.Fx) / t
                u = Input(*rates, lambda_b=ramp.lambda_b, slack=0.0)
                flat = np.array(x._replace(theta=0.0, delta=begin.delta, Fx=begin.Fx))
                steps = math.ceil(t / MAX_STEP_S)
                for _ in range(steps):
                    flat = step(flat, u, t / steps, numbers).full().ravel()
                x = State(*map(float, flat))
            begin_ns = end_ns
    return VehicleState(stamp_ns, x.X, x.Y, x.psi, x.vx, x.vy, x.r)


@cache
def midpoint_step(structure: Car) -> ca.Function:
    """Return (x, u, h, car) -> the state h [s] later, by one midpoint step."""
    f, h = single_track.rates(structure), ca.SX.sym('h')
    x, u, car = f.sx_in()
    return ca.Function('step', [x, u, h, car], [stage_problem.rk2(f, h)(x, u, car)])


def expected_delay(computing_s: Sequence[float], age_s: float, params: Delay) -> float:
    """Return the delay [s] from a state to the effect of its command.

    It is the age of the state [s], the median of the computing times of the last steps
    (`computing_s` of the parameters until there is one) and the transport time, at most
    `longest_s`.
    """
    computing = median(computing_s) if computing_s else params.computing_s
    delay_s = age_s + computing + params.transport_s
    return min(max(delay_s, 0.0), params.longest_s)
