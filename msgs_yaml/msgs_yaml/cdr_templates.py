"""Serialised messages of fixed size, written and read by a template (CDR: XCDR1, little endian).

Building and serialising a message object costs tens of microseconds, patching its bytes two; the
plant sends two thousand messages per simulated second. Reading costs 10 us in place of 300 us. No
ROS is needed.

Alignment counts from the end of the 4-byte encapsulation header; padding is 0, while a serialiser
may leave there what was in memory.
"""

import struct
from collections.abc import Sequence
from operator import itemgetter
from typing import Any

import numpy as np

from msgs_yaml import conformance, contract, conversions, flat_fields
from msgs_yaml.contract import Topic
from msgs_yaml.conversions import NS_PER_S

ENCAPSULATION = b'\x00\x01\x00\x00'
STAMP = struct.Struct('<iI')
STAMP_OFFSET = len(ENCAPSULATION)
_UINT32 = struct.Struct('<I')
_FLOAT64_BYTES = 8
_IDENTITY = (0.0, 0.0, 0.0, 1.0)  # quaternion
_NO_ORIENTATION = (-1.0, *(0.0,) * 8)  # sensor_msgs/Imu: covariance of what is not measured
_COVARIANCE_3D = (0.0,) * 9
_COVARIANCE_6D = (0.0,) * 36


class Template:
    """A serialised message of one topic whose stamp and numbers can be replaced."""

    def __init__(self, topic: str):
        """Raise KeyError for a topic that is not in `flat_fields.TYPES`."""
        self._fields = flat_fields.load(topic)
        described = contract.load().topics[topic]
        writer = _Writer(described)
        _write(writer, described)
        self._buffer = writer.buffer
        offsets = [writer.offsets[path] for path in self._fields.paths]
        order = sorted(range(len(offsets)), key=offsets.__getitem__)
        self._sort = itemgetter(*order)
        runs = _runs([offsets[i] for i in order], self._buffer)
        self._runs = [(form.pack_into, offset, part) for form, offset, part in runs]
        self._reads = [(form.unpack_from, offset) for form, offset, _ in runs]
        self._unsort = itemgetter(*sorted(range(len(order)), key=order.__getitem__))
        self._obey = conformance.number_check(topic, self._fields.paths)
        variable = [(STAMP_OFFSET, STAMP.size), *((begin, _FLOAT64_BYTES) for begin in offsets)]
        constant = np.ones(len(self._buffer), bool)
        for begin, size in variable:
            constant[begin : begin + size] = False
        self._constant = np.flatnonzero(constant)
        self._constant_bytes = np.frombuffer(bytes(self._buffer), np.uint8)[self._constant]

    def fill(self, value: Any) -> bytes:
        """Return the serialised message of a value of `types`."""
        buffer = self._buffer
        STAMP.pack_into(buffer, STAMP_OFFSET, *conversions.split_stamp(value.stamp_ns))
        numbers = self._sort(self._fields.to_numbers(value))
        for pack_into, offset, part in self._runs:
            pack_into(buffer, offset, *numbers[part])
        return bytes(buffer)

    def read(self, raw: bytes) -> Any | None:
        """Return the value of a serialised message, to the last bit what `decode` returns of it.

        None for a message that violates the contract, and for one that differs from the template in
        more than its stamp and the numbers of the value (covariances, bytes in the padding).
        """
        if len(raw) != len(self._buffer):
            return None
        if (np.frombuffer(raw, np.uint8)[self._constant] != self._constant_bytes).any():
            return None
        sec, nanosec = STAMP.unpack_from(raw, STAMP_OFFSET)
        stamp_ns = sec * NS_PER_S + nanosec
        if sec < 0 or stamp_ns == 0:
            return None
        in_order = [x for unpack, offset in self._reads for x in unpack(raw, offset)]
        numbers = self._unsort(in_order)
        return self._fields.join_numbers(stamp_ns, numbers) if self._obey(numbers) else None


def _runs(offsets, buffer):
    """Return (struct, offset, slice of the numbers) of each run of numbers with zeros between.

    One call for a run is faster than one per number; bytes that are not 0 end a run.
    """
    runs, first = [], 0
    for k in range(1, len(offsets) + 1):
        if k < len(offsets) and not any(buffer[offsets[k - 1] + _FLOAT64_BYTES : offsets[k]]):
            continue
        gaps = [b - a - _FLOAT64_BYTES for a, b in zip(offsets[first:k], offsets[first + 1 : k])]
        form = struct.Struct('<d' + ''.join(f'{gap}xd' for gap in gaps))
        runs.append((form, offsets[first], slice(first, k)))
        first = k
    return runs


class _Writer:
    """Writes a serialised message whose numbers are 0, and notes the offset of each path."""

    def __init__(self, topic: Topic):
        self.buffer = bytearray(ENCAPSULATION) + bytes(STAMP.size)
        self.offsets: dict[str, int] = {}
        self.text(topic.frame)

    def text(self, text: str) -> None:
        """Append a string: length with the closing zero, then the bytes."""
        encoded = text.encode() + b'\x00'
        self.count(len(encoded))
        self.buffer += encoded

    def count(self, number: int) -> None:
        """Append a uint32, the length of a sequence."""
        self._align(_UINT32.size)
        self.buffer += _UINT32.pack(number)

    def constants(self, numbers: Sequence[float]) -> None:
        """Append float64 numbers that stay."""
        self._align(_FLOAT64_BYTES)
        self.buffer += struct.pack(f'<{len(numbers)}d', *numbers)

    def numbers(self, form: str, names: Sequence[str]) -> None:
        """Append a float64 for each name; its path is `form` with the name in the braces."""
        self._align(_FLOAT64_BYTES)
        for name in names:
            self.offsets[form.format(name)] = len(self.buffer)
            self.buffer += bytes(_FLOAT64_BYTES)

    def _align(self, size):
        self.buffer += bytes(-(len(self.buffer) - len(ENCAPSULATION)) % size)


def _write(writer: _Writer, topic: Topic) -> None:
    if topic.type == 'nav_msgs/msg/Odometry':
        writer.text(topic.child_frame)
        writer.numbers('pose.pose.position.{}', 'xyz')
        writer.numbers('pose.pose.orientation.{}', 'xyzw')
        writer.constants(_COVARIANCE_6D)
        writer.numbers('twist.twist.linear.{}', 'xyz')
        writer.numbers('twist.twist.angular.{}', 'xyz')
        writer.constants(_COVARIANCE_6D)
    elif topic.type == 'sensor_msgs/msg/Imu':
        writer.constants(_IDENTITY)
        writer.constants(_NO_ORIENTATION)
        writer.numbers('angular_velocity.{}', 'xyz')
        writer.constants(_COVARIANCE_3D)
        writer.numbers('linear_acceleration.{}', 'xyz')
        writer.constants(_COVARIANCE_3D)
    else:  # JointState
        writer.count(len(topic.joints))
        for name in topic.joints:
            writer.text(name)
        for array in contract.JOINT_ARRAYS:
            writer.count(len(topic.joints))
            writer.numbers(array + '[{}]', topic.joints)
