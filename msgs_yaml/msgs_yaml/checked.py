"""What every decoder needs: the contract's verdict as an error, and a heading from a pose."""

from typing import Any

from msgs_yaml import conformance, yaw

UNIT_TOLERANCE = 1e-3


class DecodeError(ValueError):
    """A message breaks the contract."""


def check(topic: str, msg: Any) -> None:
    """Raise DecodeError with the first breach of the contract in a message."""
    violations = conformance.check(topic, msg)
    if violations:
        raise DecodeError(str(violations[0]))


def check_form(topic: str, msg: Any) -> None:
    """Raise DecodeError for wrong sizes, names, frames and stamps, whatever the numbers are."""
    violations = conformance.check_form(topic, msg)
    if violations:
        raise DecodeError(str(violations[0]))


def heading(topic: str, q: Any) -> float:
    """Return the heading of a turn about z [rad]; DecodeError when q is no unit quaternion."""
    norm = q.x * q.x + q.y * q.y + q.z * q.z + q.w * q.w
    if abs(norm - 1.0) > UNIT_TOLERANCE:
        raise DecodeError(f'{topic}: orientation has the squared length {norm:g}; allowed 1')
    return yaw.from_quaternion(float(q.z), float(q.w))
