"""From an accepted command to the force at the wheels: ramp, delay and servo of each set-point.

A command is due one tick after its stamp; until then each set-point is a straight line
(`SetPointRamp`). Set-points are linear between samples at the ends of the 1 ms steps, so shifting
the samples by n of them delays the signal by exactly n steps (`DelayLine`). While there are faults,
the servos are given something else (`ActuatorFaults`).

A servo for the steering angle, and for brake or drive force per axle, is a rate loop inside a
position loop, x'' = 2 zeta w (v - x'), v = w / (2 zeta) (u - x) limited to the greatest rate;
without limits this is x'' = w^2 (u - x) - 2 zeta w x'. Limiting v instead of x'' avoids wind-up.
"""

import math

import casadi as ca
import numpy as np

from msgs_yaml.conversions import NS_PER_S
from vehicle_plant.car import AxleForce, Car, FaultParams, Steering
from vehicle_plant.state import Servo, SetPoints


class SetPointRamp:
    """The set-points over time, counted in steps."""

    def __init__(self, held: SetPoints):
        self._now = held
        self._target = held
        self._steps_left = 0  # until the target is due

    @property
    def now(self) -> SetPoints:
        """The set-points at this step."""
        return self._now

    def set_target(self, target: SetPoints, due_in: int) -> None:
        """Set a target that is due in that many steps, after one step if none are left."""
        self._target = target
        self._steps_left = max(due_in, 1)

    def advance(self, steps: int) -> np.ndarray:
        """Advance; return the set-points at the ends of the steps, (steps + 1, 3)."""
        begin, target = np.array(self._now), np.array(self._target)
        done = np.arange(steps + 1)[:, None] / max(self._steps_left, 1)
        # the last point is the target itself, not a rounded sum
        path = np.where(done < 1, begin + (target - begin) * done, target)
        self._steps_left = max(self._steps_left - steps, 0)
        self._now = SetPoints(*path[-1].tolist())
        return path


def servo_parameters(car: Car) -> tuple[Steering, AxleForce, AxleForce]:
    """Return the parameters of the servos, in the order of `SetPoints` and `Servos`."""
    return car.steering, car.force.front, car.force.rear


def delay_steps(car: Car) -> SetPoints:
    """Return the delay of each set-point in steps of 1 ms."""
    return SetPoints(*(servo.delay_ms for servo in servo_parameters(car)))


class DelayLine:
    """The last samples of each delayed set-point."""

    def __init__(self, delays: SetPoints, held: SetPoints):
        """Fill the line with the set-points held until now; delays in steps."""
        self._lines = {
            i: np.full(n + 1, value) for i, (n, value) in enumerate(zip(delays, held)) if n
        }

    def shift(self, set_points: np.ndarray) -> np.ndarray:
        """Take the set-points (n + 1, 3) of n steps in; return the delayed ones, (n + 1, 3).

        The first row is the last one of the call before.
        """
        delayed = np.array(set_points)
        for i, line in self._lines.items():
            samples = np.concatenate([line, set_points[1:, i]])
            delayed[:, i] = samples[: len(set_points)]
            self._lines[i] = samples[len(set_points) - 1 :]
        return delayed


class ActuatorFaults:
    """Changes the set-points of the servos while there are faults."""

    def __init__(self, params: FaultParams, held: SetPoints, start_ns: int):
        """`held` are the set-points until `start_ns` [ns], from which times count."""
        until_s = math.inf if params.until_s is None else params.until_s
        self._while_s, self._start_ns = (params.from_s or 0.0, until_s), start_ns
        shares = (params.front_force_share, params.rear_force_share)
        self._factors = np.array([1.0, *(1.0 if share is None else share for share in shares)])
        self._offsets = np.array([params.steer_offset_rad or 0.0, 0.0, 0.0])
        self._line = DelayLine(SetPoints(*(params.delay_ms or 0,) * len(held)), held)
        self._sticks, self._stuck_at = bool(params.steer_stuck), None

    def apply(self, set_points: np.ndarray, stamps_ns: np.ndarray) -> np.ndarray:
        """Return what the servos follow, (n + 1, 3), of the set-points at n + 1 stamps.

        The first row is the last one of the call before.
        """
        late = self._line.shift(set_points)
        t = (stamps_ns - self._start_ns) / NS_PER_S
        is_faulty = (self._while_s[0] <= t) & (t < self._while_s[1])
        if not is_faulty.any():
            return set_points
        changed = self._factors * late + self._offsets
        if self._sticks:
            if self._stuck_at is None:
                self._stuck_at = set_points[np.argmax(is_faulty), 0]
            changed[:, 0] = self._stuck_at
        return np.where(is_faulty[:, None], changed, set_points)


def servo_derivative(x: Servo, target, p: Steering | AxleForce) -> Servo:
    """Return the time derivative of a servo with the parameters p that follows a set-point."""
    low, high, greatest_rate = _limits(p)
    damping = 2 * p.damping * p.natural_frequency_radps
    gain = p.natural_frequency_radps**2 / damping
    rate = gain * (_clip(target, low, high) - x.position)
    return Servo(x.rate, damping * (_clip(rate, -greatest_rate, greatest_rate) - x.rate))


def stop_at_limits(x: Servo, p: Steering | AxleForce) -> Servo:
    """Return the servo within its mechanical stops: beyond one it is at rest on it."""
    low, high, _ = _limits(p)
    outside = ca.logic_or(x.position < low, x.position > high)
    return Servo(_clip(x.position, low, high), ca.if_else(outside, 0, x.rate))


def _limits(p):
    """Return the lowest and highest position and the greatest rate; braking is negative."""
    if isinstance(p, Steering):
        return -p.limit_rad, p.limit_rad, p.rate_radps
    return -p.brake_n, p.drive_n, p.rate_nps


def _clip(x, low, high):
    return ca.fmin(ca.fmax(x, low), high)
