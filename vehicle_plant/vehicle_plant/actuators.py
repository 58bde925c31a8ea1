"""Second-order servos with a rate limit: steering angle, and brake or drive force per axle.

The servo is a rate loop inside a position loop, x'' = 2 zeta w (v - x'), v = w / (2 zeta) (u - x)
limited to the greatest rate; without limits this is x'' = w^2 (u - x) - 2 zeta w x'. Limiting v
instead of x'' leaves no wind-up.
"""

from typing import Any, NamedTuple

import casadi as ca


class Servo(NamedTuple):
    """Position (rad or N) and its rate."""

    position: Any
    rate: Any


class Limits(NamedTuple):
    """Greatest and smallest position, greatest rate."""

    low: Any
    high: Any
    rate: Any


def _clip(x, low, high):
    return ca.fmin(ca.fmax(x, low), high)


def limits_of_steering(p) -> Limits:
    """Return the limits of `car.Steering` [rad, rad/s]."""
    return Limits(-p.limit_rad, p.limit_rad, p.rate_radps)


def limits_of_force(p) -> Limits:
    """Return the limits of `car.AxleForce` [N, N/s], braking negative."""
    return Limits(-p.brake_n, p.drive_n, p.rate_nps)


def derivative(x: Servo, target, p, limits: Limits) -> Servo:
    """Return the time derivative of a servo with the parameters p that follows a set-point."""
    twice = 2 * p.damping * p.natural_frequency_radps
    gain = p.natural_frequency_radps**2 / twice
    wanted = gain * (_clip(target, limits.low, limits.high) - x.position)
    return Servo(x.rate, twice * (_clip(wanted, -limits.rate, limits.rate) - x.rate))


def stopped(x: Servo, limits: Limits) -> Servo:
    """Return the servo against its mechanical stops: it rests there instead of passing them."""
    outside = ca.logic_or(x.position < limits.low, x.position > limits.high)
    return Servo(_clip(x.position, limits.low, limits.high), ca.if_else(outside, 0, x.rate))
