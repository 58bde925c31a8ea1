"""Heading and quaternion: a turn psi about z is (0, 0, sin(psi / 2), cos(psi / 2)). Radians."""

import math


def wrap(psi: float) -> float:
    """Return the same heading in (-pi, pi]."""
    wrapped = math.remainder(psi, math.tau)
    return math.pi if wrapped == -math.pi else wrapped


def to_quaternion(psi: float) -> tuple[float, float]:
    """Return (z, w) of the unit quaternion of a heading; x and y are 0."""
    return math.sin(0.5 * psi), math.cos(0.5 * psi)


def from_quaternion(z: float, w: float) -> float:
    """Return the heading in (-pi, pi] of a turn about z."""
    return wrap(2.0 * math.atan2(z, w))


def as_received(psi: float) -> float:
    """Return the heading that a receiver reads from the message, to the last bit."""
    return from_quaternion(*to_quaternion(psi))
