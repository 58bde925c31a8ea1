"""Serialised messages of fixed size, written by patching a template (CDR: XCDR1, little endian).

Building and serialising a message object costs tens of microseconds, patching its bytes two; the
plant sends two thousand messages per simulated second. No ROS is needed.

Alignment counts from the end of the 4-byte encapsulation header; padding is 0, while a serialiser
may leave there what was in memory.
"""

import struct
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

from msgs_yaml import contract, conversions, flat_fields
from msgs_yaml.contract import Topic

ENCAPSULATION = b'\x00\x01\x00\x00'
STAMP = struct.Struct('<iI')
STAMP_OFFSET = len(ENCAPSULATION)
_UINT32 = struct.Struct('<I')
_FLOAT64_BYTES = 8
_NO_ORIENTATION = (-1.0, *(0.0,) * 8)  # sensor_msgs/Imu: covariance of what is not measured
_COVARIANCE_3D = (0.0,) * 9
_COVARIANCE_6D = (0.0,) * 36
_IDENTITY = (0.0, 0.0, 0.0, 1.0)
_VECTOR = (0.0,) * 3
_POSE = (0.0,) * 7
_TWIST = (0.0,) * 6


class Writer:
    """Appends to a serialised message."""

    def __init__(self):
        self.buffer = bytearray(ENCAPSULATION)

    def header(self, frame: str) -> None:
        """Append a std_msgs/Header with stamp 0."""
        self.buffer += bytes(STAMP.size)
        self.text(frame)

    def text(self, text: str) -> None:
        """Append a string: length with the closing zero, then the bytes."""
        encoded = text.encode() + b'\x00'
        self.count(len(encoded))
        self.buffer += encoded

    def count(self, number: int) -> None:
        """Append a uint32, the length of a sequence."""
        self._align(_UINT32.size)
        self.buffer += _UINT32.pack(number)

    def floats(self, numbers: Sequence[float]) -> int:
        """Append float64 numbers and return where they begin."""
        self._align(_FLOAT64_BYTES)
        offset = len(self.buffer)
        self.buffer += struct.pack(f'<{len(numbers)}d', *numbers)
        return offset

    def _align(self, size):
        self.buffer += bytes(-(len(self.buffer) - len(ENCAPSULATION)) % size)


class Layout(NamedTuple):
    """A serialised message and where in it the numbers of its value lie."""

    buffer: bytearray
    offsets: tuple[int, ...]


class Template:
    """A serialised message whose stamp and numbers can be replaced."""

    def __init__(self, topic: str):
        """Take a topic of `FORMS`; KeyError for others."""
        self._blocks, layout = FORMS[topic]
        self._buffer, self._offsets = layout(contract.load().topics[topic])

    def fill(self, value: Any) -> bytes:
        """Return the serialised message of a value of `types`."""
        buffer = self._buffer
        STAMP.pack_into(buffer, STAMP_OFFSET, *conversions.split_stamp(value.stamp_ns))
        for offset, run in zip(self._offsets, self._blocks(value)):
            struct.pack_into(f'<{len(run)}d', buffer, offset, *run)
        return bytes(buffer)


def _odometry(topic: Topic) -> Layout:
    writer = Writer()
    writer.header(topic.frame)
    writer.text(topic.child_frame)
    pose = writer.floats(_POSE)
    writer.floats(_COVARIANCE_6D)
    twist = writer.floats(_TWIST)
    writer.floats(_COVARIANCE_6D)
    return Layout(writer.buffer, (pose, twist))


def _imu(topic: Topic) -> Layout:
    writer = Writer()
    writer.header(topic.frame)
    writer.floats(_IDENTITY)
    writer.floats(_NO_ORIENTATION)
    rate = writer.floats(_VECTOR)
    writer.floats(_COVARIANCE_3D)
    acceleration = writer.floats(_VECTOR)
    writer.floats(_COVARIANCE_3D)
    return Layout(writer.buffer, (rate, acceleration))


def _joint_state(topic: Topic) -> Layout:
    writer = Writer()
    writer.header(topic.frame)
    writer.count(len(topic.joints))
    for name in topic.joints:
        writer.text(name)
    offsets = []
    for _ in ('position', 'velocity', 'effort'):
        writer.count(len(topic.joints))
        offsets.append(writer.floats((0.0,) * len(topic.joints)))
    return Layout(writer.buffer, tuple(offsets))


# value to runs of numbers, topic to layout
FORMS: dict[str, tuple[Callable, Callable[[Topic], Layout]]] = {
    '/vehicle/odometry': (flat_fields.odometry, _odometry),
    '/vehicle/imu': (flat_fields.imu, _imu),
    '/vehicle/actuators': (flat_fields.actuators, _joint_state),
    '/vehicle/wheels': (flat_fields.wheels, _joint_state),
    '/controller/command': (flat_fields.command, _joint_state),
}
