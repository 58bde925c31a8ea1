"""Decode recorded messages: to stamps, to values of `msgs_yaml.types`, and to columns.

header_stamps_ns   the stamps of messages, without decoding them
decode_message     one message as a value, checked against the contract
build_columns      thousands of messages of one topic as columns, at once

Odometry, Imu and JointState with constant names occupy the same bytes in every message of a
topic. Their layout is computed once per group of equal messages; numpy then reads a number of
all of them as one strided column.
"""

import struct
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from bags.errors import BagError
from bags.storage import cdr
from bags.storage.cdr import CODES, HEADER, aligned, byte_order
from bags.storage.columns import Columns, Source
from bags.storage.message_definitions import parse_definition
from bags.storage.rosbag2_metadata import BagTopic
from msgs_yaml import conversions, decode
from msgs_yaml.conversions import NS_PER_S
from msgs_yaml.decode import DecodeError, stamp_ns_of

MARKER_ARRAY = 'visualization_msgs/msg/MarkerArray'
MARKER_COUNT_BYTES, STAMP_BYTES = 4, 8
YAW = 'yaw_rad'
DECODERS = {
    '/scenario/reference': decode.reference,
    '/scenario/road_edges': decode.road_edges,
    '/scenario/obstacles': decode.obstacles,
    '/vehicle/odometry': decode.odometry,
    '/vehicle/actuators': decode.actuators,
    '/vehicle/imu': decode.imu,
    '/vehicle/wheels': decode.wheels,
    '/controller/command': decode.command,
    '/controller/prediction': decode.prediction,
    '/controller/why': decode.why,
    '/diagnostics': decode.health,
    '/clock': decode.clock,
}
# of `decode_message`: DecodeError, a ValueError, for a broken contract; the others where the
# definition in the bag lacks a field or gives it another type
DECODE_ERRORS = (BagError, ValueError, AttributeError, TypeError, LookupError, ArithmeticError)


def stamp_reader(type_name: str) -> Callable[[bytes], int]:
    """Return a function stamp_ns(data) for a type.

    A MarkerArray has the stamp of its first marker; every other type of the contract begins with
    its stamp. The function raises `msgs_yaml.decode.DecodeError` for a message without one.
    """
    return _stamp_of_first_marker if type_name == MARKER_ARRAY else stamp_ns_of


def header_stamps_ns(topic: str, payloads: Sequence[bytes]) -> np.ndarray:
    """Return the stamps (n,) int64 [ns] of messages that begin with a header.

    Raises BagError for one without, which names the topic and the number of the message.
    """
    stamps_ns = np.empty(len(payloads), dtype=np.int64)
    for i, data in enumerate(payloads):
        try:
            stamps_ns[i] = stamp_ns_of(data)
        except DecodeError as error:
            raise BagError(f'message {i} of {topic}: {error}') from error
    return stamps_ns


def _stamp_of_first_marker(data):
    begin = HEADER + MARKER_COUNT_BYTES
    return stamp_ns_of(data[:HEADER] + data[begin : begin + STAMP_BYTES])


def decode_message(topic: BagTopic, payload: bytes) -> Any:
    """Return the value of a message (CDR with its encapsulation header) of a topic in DECODERS.

    Raises one of DECODE_ERRORS when it breaks the contract or does not fit its definition.
    """
    return DECODERS[topic.name](cdr.decode(payload, topic.schema, topic.type))


class Layout(NamedTuple):
    """Offsets into one message: of numbers by their path, as in 'pose.pose.position.x'."""

    numbers: dict[str, tuple[int, str]]  # path -> (offset, numpy type)
    strings: dict[str, str]  # path -> text
    fixed: np.ndarray  # offsets of the bytes that determine the layout: lengths and texts


def find_layout(data: bytes, text: str, type_name: str) -> Layout:
    """Return the layout of one message; BagError when the bytes do not fit the definition."""
    walk = _LayoutWalk(data, parse_definition(text, type_name))
    try:
        walk.message('', '')
    except (struct.error, UnicodeDecodeError) as error:
        raise BagError(f'{type_name}: {len(data)} bytes do not fit its definition') from error
    return Layout(walk.numbers, walk.strings, np.array(walk.fixed, dtype=np.intp))


def group_by_layout(payloads: list[bytes], text: str, type_name: str):
    """Yield (row numbers, (n, bytes) array of uint8, Layout) of messages with equal layout."""
    lengths = np.fromiter(map(len, payloads), dtype=np.int64, count=len(payloads))
    for length in dict.fromkeys(lengths.tolist()):
        rows = np.flatnonzero(lengths == length)
        # one join of the payloads, then no copy per message
        bytes_ = np.frombuffer(b''.join([payloads[i] for i in rows]), dtype=np.uint8)
        bytes_ = bytes_.reshape(len(rows), length)
        while len(rows):
            layout = find_layout(payloads[rows[0]], text, type_name)
            same = (bytes_[:, layout.fixed] == bytes_[0, layout.fixed]).all(axis=1)
            if same.all():
                yield rows, bytes_, layout
                break
            yield rows[same], bytes_[same], layout
            rows, bytes_ = rows[~same], bytes_[~same]


def raw_column(bytes_: np.ndarray, layout: Layout, path: str) -> np.ndarray:
    """Return one number of every message, (n,), in its own type."""
    offset, kind = layout.numbers[path]
    width = np.dtype(kind).itemsize
    return np.ascontiguousarray(bytes_[:, offset : offset + width]).view(kind)[:, 0]


class _LayoutWalk:
    """One pass over a message that collects the offsets of its fields."""

    def __init__(self, data, types):
        self.data, self.types, self.order = data, types, byte_order(data)
        self.position = 0
        self.numbers, self.strings, self.fixed = {}, {}, list(range(HEADER))

    def message(self, base, path):
        for field in self.types[base]:
            name = f'{path}.{field.name}' if path else field.name
            if not field.is_array:
                self.value(field.base, name)
                continue
            n = self.length() if field.length is None else field.length
            if n > len(self.data):
                raise struct.error('more items than bytes')
            for i in range(n):
                self.value(field.base, f'{name}[{i}]')

    def value(self, base, path):
        if base in CODES:
            code = CODES[base]
            begin = aligned(self.position, struct.calcsize(code))
            self.position = begin + struct.calcsize(code)
            if self.position > len(self.data) - HEADER:
                raise struct.error('beyond the end')
            self.numbers[path] = (HEADER + begin, self.order + code)
        elif base == 'string':
            n = self.length()
            begin = HEADER + self.position
            self.position += n
            if self.position > len(self.data) - HEADER:
                raise struct.error('beyond the end')
            self.fixed += range(begin, begin + n)
            self.strings[path] = self.data[begin : begin + max(n - 1, 0)].decode('utf-8')
        else:
            self.message(base, path)

    def length(self):
        """Return a count or the length of a text; its bytes belong to the layout."""
        begin = aligned(self.position, 4)
        self.position = begin + 4
        self.fixed += range(HEADER + begin, HEADER + begin + 4)
        return struct.unpack_from(self.order + 'I', self.data, HEADER + begin)[0]


def build_columns(source: Source, topic: BagTopic, payloads: list[bytes], zero_ns: int) -> Columns:
    """Return the table of `payloads` (CDR), n >= 1; `zero_ns` is the stamp at which t_s is 0.

    Raises BagError when a message does not fit its definition or lacks a name.
    """
    n = len(payloads)
    stamp_ns = np.empty(n, dtype=np.int64)
    table = {
        name: np.empty((n, len(paths)) if isinstance(paths, tuple) else n)
        for name, paths in source.paths.items()
    }
    for rows, bytes_, layout in group_by_layout(payloads, topic.schema, topic.type):
        stamp_ns[rows] = _stamp_ns(source.stamp, bytes_, layout)
        for name, paths in source.paths.items():
            if isinstance(paths, tuple):
                columns = [column(bytes_, layout, path) for path in paths]
                table[name][rows] = np.stack(columns, axis=1)
            else:
                table[name][rows] = column(bytes_, layout, paths)
    if YAW in table:
        # math.atan2, as every receiver of the message uses: numpy's may differ in the last bit
        table[YAW] = np.array(
            [conversions.quaternion_to_heading(z, w) for z, w in table[YAW].tolist()]
        )
    return source.table(stamp_ns=stamp_ns, t_s=(stamp_ns - zero_ns) / NS_PER_S, **table)


def _stamp_ns(path, bytes_, layout):
    sec, nanosec = (column(bytes_, layout, f'{path}.{part}') for part in ('sec', 'nanosec'))
    if not (np.can_cast(sec.dtype, np.int32) and np.can_cast(nanosec.dtype, np.uint32)):
        raise BagError(f'{path} is of {sec.dtype} and {nanosec.dtype}; allowed int32 and uint32')
    return sec.astype(np.int64) * NS_PER_S + nanosec


def column(bytes_: np.ndarray, layout: Layout, path: str) -> np.ndarray:
    """Return a column (n,) by its path; 'effort[steer]' is at the index of 'steer' in `name`."""
    array, bracket, joint = path.partition('[')
    if bracket:
        count = sum(name.startswith('name[') for name in layout.strings)
        joints = [layout.strings[f'name[{i}]'] for i in range(count)]
        wanted = joint.rstrip(']')
        if wanted not in joints:
            raise BagError(f'no joint {wanted!r}; it has {", ".join(joints)}')
        path = f'{array}[{joints.index(wanted)}]'
    if path not in layout.numbers:
        raise BagError(f'no {path} in the message')
    return raw_column(bytes_, layout, path)
