"""Values of fixed size: as flat numbers, and as serialised messages (CDR: XCDR1, little endian).

Fields of the contract with a `column` make the value of their topic. A field of the value is one
number, which a symmetric matrix has twice, four (one per wheel), or a heading (z and w of its
quaternion). `encode`, `decode`, the publishers and the tables of `bags` derive from this, so a new
number costs two lines in topics.yaml and one in the type of its topic. No ROS is needed.

Building and serialising a message object costs tens of microseconds, packing its bytes a few; the
plant sends two thousand messages per simulated second. Reading costs 10 us in place of 300 us.
Alignment counts from the end of the 4-byte encapsulation header; padding is 0, while a serialiser
may leave there what was in memory.
"""

import struct
from collections.abc import Iterator, Sequence
from functools import cache
from itertools import accumulate, pairwise
from operator import attrgetter
from typing import Any

from msgs_yaml import conformance, contract, conversions
from msgs_yaml.contract import JOINT_ARRAYS, ContractError, Topic
from msgs_yaml.types import (
    WHEELS,
    Actuators,
    Chassis,
    Command,
    EstimatedState,
    Gnss,
    Imu,
    Inertial,
    VehicleState,
    Wheels,
)

TYPES = {
    '/vehicle/odometry': VehicleState,
    '/vehicle/actuators': Actuators,
    '/vehicle/imu': Imu,
    '/vehicle/wheels': Wheels,
    '/sensors/inertial': Inertial,
    '/sensors/chassis': Chassis,
    '/sensors/gnss': Gnss,
    '/estimator/odometry': EstimatedState,
    '/controller/command': Command,
}
HEADING = 'psi'
ENCAPSULATION = b'\x00\x01\x00\x00'
STAMP = struct.Struct('<iI')
_IDENTITY = (0.0, 0.0, 0.0, 1.0)  # quaternion
_NO_ORIENTATION = (-1.0, *(0.0,) * 8)  # sensor_msgs/Imu: covariance of what is not measured


class FlatFields:
    """The numbers of a topic in the order of the fields of its value, and their serialised message.

    kind      the named tuple of a value; its first field is `stamp_ns`
    paths     of every number in the message
    columns   column of a table -> its paths
    """

    def __init__(self, topic: str):
        """Raise KeyError for a topic that is not in TYPES, ContractError as `load`."""
        self.kind, described = TYPES[topic], contract.load().topics[topic]
        fields: dict[str, list[str]] = {}
        columns: dict[str, list[str]] = {}
        for path, field in described.fields.items():
            if field.column:
                fields.setdefault(field.value, []).append(path)
                columns.setdefault(field.column, []).append(path)
        if ('stamp_ns', *fields) != self.kind._fields:
            what = f'topics.yaml has the values {", ".join(fields)}; {self.kind.__name__} others'
            raise ContractError(f'{topic}: {what}')
        for name, paths in fields.items():
            symbols = {described.fields[path].symbol for path in paths}
            is_pair = len(paths) == 2 and (name == HEADING or len(symbols) == 1)
            if len(paths) not in (1, len(WHEELS)) and not is_pair:
                what = f'{len(paths)} fields; allowed 1 or {len(WHEELS)}, or 2 of one symbol'
                raise ContractError(f'{topic}: the value {name} has {what}')
        self.paths = tuple(path for group in fields.values() for path in group)
        self.columns = {column: tuple(group) for column, group in columns.items()}
        self._parts = [
            slice(*ends) for ends in pairwise(accumulate(map(len, fields.values()), initial=0))
        ]
        # of each number its attribute and, in an array, its index
        places = [path.rstrip(']').partition('[')[::2] for path in self.paths]
        names = [*dict.fromkeys(name for name, _ in places)]
        self._get = attrgetter(*names, names[0])  # of one name it would be no tuple
        joints = described.joints
        self._places = [
            (names.index(name), joints.index(i) if i in joints else int(i) if i else None)
            for name, i in places
        ]
        self._ranges = [(described.fields[p].low, described.fields[p].high) for p in self.paths]
        self._turn = [i for i, p in enumerate(self.paths) if f'{conformance.ORIENTATION}.' in p]
        message, offsets = _message(described)
        in_order = sorted(self.paths, key=offsets.get)
        self._slots = [4 + 2 * in_order.index(path) for path in self.paths]
        # stamp and numbers follow a piece of the message each that stays, which may be empty
        form, end = '<', 0
        for begin in (len(ENCAPSULATION), *map(offsets.get, in_order)):
            form += f'{begin - end}s{"d" if end else "iI"}'
            end = begin + 8
        self._form = struct.Struct(f'{form}{len(message) - end}s')
        self._blank = self._form.unpack(message)

    def to_numbers(self, value: Any) -> list[float]:
        """Return the numbers of a value, one per path."""
        numbers = []
        for name, part, field in zip(self.kind._fields[1:], self._parts, value[1:]):
            width = part.stop - part.start
            if name == HEADING:
                numbers += conversions.heading_to_quaternion(field)
            else:
                numbers += [field] * width if width <= 2 else field
        return numbers

    def to_value(self, stamp_ns: int, numbers: Sequence[float]) -> Any:
        """Return the value of numbers, one per path."""
        fields = []
        for name, part in zip(self.kind._fields[1:], self._parts):
            group = numbers[part]
            if name == HEADING:
                fields.append(conversions.quaternion_to_heading(*group))
            else:
                fields.append(group[0] if len(group) <= 2 else tuple(group))
        return self.kind(stamp_ns, *fields)

    def numbers_of(self, message: Any) -> list[float]:
        """Return the numbers of a message object of any library."""
        given = self._get(message)
        return [float(given[k] if i is None else given[k][i]) for k, i in self._places]

    def fill(self, value: Any) -> bytes:
        """Return the serialised message of a value of `types`."""
        fields = list(self._blank)
        fields[1:3] = conversions.split_stamp(value.stamp_ns)
        for slot, number in zip(self._slots, self.to_numbers(value)):
            fields[slot] = number
        return self._form.pack(*fields)

    def read(self, raw: bytes) -> Any | None:
        """Return the value of a serialised message, to the last bit what `decode` returns of it.

        None for a message that violates the contract, and for one that differs from what `fill`
        makes in more than its stamp and numbers (covariances, bytes in the padding).
        """
        if len(raw) != self._form.size:
            return None
        fields = self._form.unpack(raw)
        if fields[0] != ENCAPSULATION or fields[3::2] != self._blank[3::2]:
            return None
        sec, nanosec = fields[1:3]
        stamp_ns = sec * conversions.NS_PER_S + nanosec
        if sec < 0 or stamp_ns == 0:
            return None
        numbers = [fields[slot] for slot in self._slots]
        if not all(low <= x <= high for x, (low, high) in zip(numbers, self._ranges)):
            return None
        if self._turn:
            square = sum(numbers[i] ** 2 for i in self._turn)
            if abs(square - 1.0) > conformance.UNIT_TOLERANCE:
                return None
        return self.to_value(stamp_ns, numbers)

    def __repr__(self):
        return f'FlatFields({self.kind.__name__}, {len(self.paths)} numbers)'


@cache
def load(topic: str) -> FlatFields:
    """Return the numbers of a topic of TYPES; raise KeyError for another topic.

    Raises ContractError if the contract and the type do not have the same fields in this order.
    """
    return FlatFields(topic)


def _message(topic: Topic) -> tuple[bytes, dict[str, int]]:
    """Return a serialised message whose stamp and numbers are 0, and the offset of each number."""
    message, offsets = bytearray(ENCAPSULATION + bytes(STAMP.size)), {}
    for code, constant, path in _message_fields(topic):
        if not code.endswith('s'):
            message += bytes(-(len(message) - len(ENCAPSULATION)) % struct.calcsize(f'<{code}'))
        offsets[path] = len(message)
        message += struct.pack(f'<{code}', constant)
    return bytes(message), offsets


def _message_fields(topic) -> Iterator[tuple[str, float | bytes, str]]:
    """Yield struct code, constant and path of each field behind the stamp; '' has no path."""

    def text(text):
        encoded = text.encode() + b'\x00'
        return ('I', len(encoded), ''), (f'{len(encoded)}s', encoded, '')

    def constants(*values):
        return (('d', value, '') for value in values)

    def numbers(form, names):
        return (('d', 0.0, form.format(name)) for name in names)

    def matrix(path):
        return numbers(f'{path}[{{}}]', range(36))

    yield from text(topic.frame)
    if topic.type == 'nav_msgs/msg/Odometry':
        yield from text(topic.child_frame)
        yield from numbers('pose.pose.position.{}', 'xyz')
        if any(conformance.ORIENTATION in path for path in topic.fields):
            yield from numbers('pose.pose.orientation.{}', 'xyzw')
        else:
            yield from constants(*_IDENTITY)
        yield from matrix('pose.covariance')
        yield from numbers('twist.twist.linear.{}', 'xyz')
        yield from numbers('twist.twist.angular.{}', 'xyz')
        yield from matrix('twist.covariance')
    elif topic.type == 'sensor_msgs/msg/Imu':
        yield from constants(*_IDENTITY, *_NO_ORIENTATION)
        yield from numbers('angular_velocity.{}', 'xyz')
        yield from constants(*[0.0] * 9)
        yield from numbers('linear_acceleration.{}', 'xyz')
        yield from constants(*[0.0] * 9)
    else:  # JointState
        yield 'I', len(topic.joints), ''
        for name in topic.joints:
            yield from text(name)
        for array in JOINT_ARRAYS:
            yield 'I', len(topic.joints), ''
            yield from numbers(array + '[{}]', topic.joints)
