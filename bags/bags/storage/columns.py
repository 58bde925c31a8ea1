"""The messages of a run as stamps, as values of `msgs_yaml.types`, and as columns of numbers.

header_stamps_ns   the stamps of messages, without decoding them
decode_message     one message as a value, checked against the contract
build_columns      thousands of messages of one topic as columns, at once

Columns have one row per message, names with units, SI, ISO 8855 axes. Every table begins with
`stamp_ns` (int64, ROS time) and `t_s` (float64, seconds since the zero of the run: its first
odometry). Columns have shape (n,), those of the wheels (n, 4) in the order front-left, front-right,
rear-left, rear-right. Positions and yaw, in (-pi, pi], are in the frame map, velocities and
accelerations in base_link at the centre of gravity, tyre forces in the tyre frame. The tables of
TOPICS have the columns of topics.yaml (`msgs_yaml.flat_fields`); that of any other topic has one
more column, `values`: a tuple of values of `msgs_yaml.types`.

Odometry, Imu and JointState with constant names occupy the same bytes in every message of a topic.
Their layout is computed once per group of equal messages; numpy then reads a number of all of them
as one strided column.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any

import numpy as np

from bags.errors import BagError
from bags.storage import cdr
from bags.storage.cdr import HEADER, Layout
from bags.storage.rosbag2_metadata import BagTopic
from msgs_yaml import decode, flat_fields
from msgs_yaml.conversions import NS_PER_S, quaternions_to_headings
from msgs_yaml.decode import DecodeError, stamp_ns_of

TOPICS = tuple(flat_fields.TYPES)  # those whose columns are numbers
MARKER_ARRAY = 'visualization_msgs/msg/MarkerArray'
MARKER_COUNT_BYTES, STAMP_BYTES = 4, 8
YAW = 'yaw_rad'
DECODERS = {
    '/scenario/reference': decode.reference,
    '/scenario/road_edges': decode.road_edges,
    '/scenario/obstacles': decode.obstacles,
    '/scenario/predictions': decode.predictions,
    '/vehicle/odometry': decode.odometry,
    '/vehicle/actuators': decode.actuators,
    '/vehicle/imu': decode.imu,
    '/vehicle/wheels': decode.wheels,
    '/sensors/inertial': decode.inertial,
    '/sensors/chassis': decode.chassis,
    '/sensors/gnss': decode.gnss,
    '/estimator/odometry': decode.estimate,
    '/controller/command': decode.command,
    '/controller/prediction': decode.prediction,
    '/controller/stop_plan': decode.stop_plan,
    '/controller/why': decode.why,
    '/diagnostics': decode.health,
    '/clock': decode.clock,
    '/vehicle/run_start': decode.run_start,
}
# of `decode_message`: DecodeError, a ValueError, for a broken contract; the others where the
# definition in the bag lacks a field or gives it another type
DECODE_ERRORS = (BagError, ValueError, AttributeError, TypeError, LookupError, ArithmeticError)


class Columns:
    """The table of a topic; its columns are attributes, in the order of `names`."""

    stamp_ns: np.ndarray
    t_s: np.ndarray

    def __init__(self, stamp_ns: np.ndarray, t_s: np.ndarray, **others: Any):
        vars(self).update(stamp_ns=stamp_ns, t_s=t_s, **others)

    def __getattr__(self, name: str) -> Any:
        raise AttributeError(f'no column {name}; there are {", ".join(vars(self))}')

    def __iter__(self) -> Iterator[Any]:
        return iter(vars(self).values())

    def items(self) -> Iterator[tuple[str, Any]]:
        """Return the columns with their names."""
        return iter(vars(self).items())

    def __repr__(self) -> str:
        return f'Columns({len(self.stamp_ns)} rows: {", ".join(vars(self))})'


def names(topic: str) -> tuple[str, ...]:
    """Return the columns of one of TOPICS; KeyError for another topic."""
    return ('stamp_ns', 't_s', *flat_fields.load(topic).columns)


def stamp_reader(type_name: str) -> Callable[[bytes], int]:
    """Return a function stamp_ns(data) for a type.

    A MarkerArray has the stamp of its first marker; every other type of the contract begins with
    its stamp. The function raises `msgs_yaml.decode.DecodeError` for a message without one.
    """
    if type_name != MARKER_ARRAY:
        return stamp_ns_of
    begin = HEADER + MARKER_COUNT_BYTES
    return lambda data: stamp_ns_of(data[:HEADER] + data[begin : begin + STAMP_BYTES])


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


def decode_message(topic: BagTopic, payload: bytes) -> Any:
    """Return the value of a message (CDR with its encapsulation header) of a topic in DECODERS.

    Raises one of DECODE_ERRORS when it breaks the contract or does not fit its definition.
    """
    return DECODERS[topic.name](cdr.decode(payload, topic.schema, topic.type))


def decode_each(topic: BagTopic, payloads: Iterable[bytes]) -> dict[bytes, Any]:
    """Return by message its value, or the error of DECODE_ERRORS; equal ones are decoded once."""
    values = {}
    for payload in dict.fromkeys(payloads):
        try:
            values[payload] = decode_message(topic, payload)
        except DECODE_ERRORS as error:
            values[payload] = error
    return values


def group_by_layout(payloads: list[bytes], text: str, type_name: str):
    """Yield (row numbers, (n, bytes) array of uint8, first Layout) of messages of equal layout."""
    lengths = np.fromiter(map(len, payloads), dtype=np.int64, count=len(payloads))
    for length in dict.fromkeys(lengths.tolist()):
        rows = np.flatnonzero(lengths == length)
        # one join of the payloads, then no copy per message
        bytes_ = np.frombuffer(b''.join([payloads[i] for i in rows]), dtype=np.uint8)
        bytes_ = bytes_.reshape(len(rows), length)
        while len(rows):
            layout = Layout(payloads[rows[0]], text, type_name)
            same = (bytes_[:, layout.fixed] == bytes_[0, layout.fixed]).all(axis=1)
            if same.all():
                yield rows, bytes_, layout
                break
            yield rows[same], bytes_[same], layout
            rows, bytes_ = rows[~same], bytes_[~same]


def build_columns(topic: BagTopic, payloads: list[bytes], zero_ns: int) -> Columns:
    """Return the table of `payloads` (CDR), n >= 1; `zero_ns` is the stamp at which t_s is 0.

    Raises BagError when a message does not fit its definition or lacks a name.
    """
    paths = flat_fields.load(topic.name).columns
    stamp_ns = np.empty(len(payloads), dtype=np.int64)
    table = {name: np.empty((len(payloads), len(group))) for name, group in paths.items()}
    for rows, bytes_, layout in group_by_layout(payloads, topic.schema, topic.type):
        sec, nanosec = stamp_columns(bytes_, layout)
        if not (np.can_cast(sec.dtype, np.int32) and np.can_cast(nanosec.dtype, np.uint32)):
            kinds = f'{sec.dtype} and {nanosec.dtype}'
            raise BagError(f'header.stamp is of {kinds}; allowed int32 and uint32')
        stamp_ns[rows] = sec.astype(np.int64) * NS_PER_S + nanosec
        for name, group in paths.items():
            table[name][rows] = np.stack([column(bytes_, layout, path) for path in group], axis=1)
    for name, numbers in table.items():
        if name == YAW:
            table[name] = quaternions_to_headings(*numbers.T)
        elif numbers.shape[1] <= 2:
            table[name] = numbers[:, 0]
    return Columns(stamp_ns, (stamp_ns - zero_ns) / NS_PER_S, **table)


def stamp_columns(bytes_: np.ndarray, layout: Layout) -> tuple[np.ndarray, np.ndarray]:
    """Return the seconds and nanoseconds (n,) of the stamp in every message, in their own types."""
    sec, nanosec = (column(bytes_, layout, f'header.stamp.{part}') for part in ('sec', 'nanosec'))
    return sec, nanosec


def column(bytes_: np.ndarray, layout: Layout, path: str) -> np.ndarray:
    """Return one number of every message, (n,), in its own type.

    'effort[steer]' is at the index of 'steer' in `name`.
    """
    array, bracket, joint = path.rstrip(']').partition('[')
    if bracket and path not in layout.numbers:
        joints = [text for name, text in layout.strings.items() if name.startswith('name[')]
        if joint not in joints:
            raise BagError(f'no joint {joint!r}; it has {", ".join(joints)}')
        path = f'{array}[{joints.index(joint)}]'
    if path not in layout.numbers:
        raise BagError(f'no {path} in the message')
    offset, kind = layout.numbers[path]
    width = np.dtype(kind).itemsize
    return np.ascontiguousarray(bytes_[:, offset : offset + width]).view(kind)[:, 0]
