"""Reads a serialised /scenario/reference with numpy, and sends it again under another stamp.

Message objects of 5000 poses take 100 ms and more to make or to read, two ticks of the controller;
their bytes take a millisecond. They are CDR, little-endian, one pose after the other (OMG DDSI-RTPS
2.2, 10; alignments of XCDR1).
"""

from typing import NamedTuple

import numpy as np

from msgs_yaml import contract, yaw
from msgs_yaml.checked import UNIT_TOLERANCE
from msgs_yaml.stamp import NS_PER_S
from msgs_yaml.types import Reference

TOPIC = '/scenario/reference'
LITTLE_ENDIAN = b'\x00\x01\x00\x00'
STAMP = [('sec', '<i4'), ('nanosec', '<u4')]
FRAME = 'V8'  # its length and three letters with a zero: `map`
POSE = 'V56'
# the first pose begins off the grid of doubles
HEAD = np.dtype(
    [
        ('encapsulation', 'V4'),
        ('stamp', STAMP),
        ('frame', FRAME),
        ('poses', '<u4'),
        ('first_stamp', STAMP),
        ('first_frame', FRAME),
        ('padding', 'V4'),
        ('first_pose', POSE),
    ]
)
REST = np.dtype([('stamp', STAMP), ('frame', FRAME), ('pose', POSE)])
_FLOATS = ('position.x', 'position.y', 'position.z', *(f'orientation.{axis}' for axis in 'xyzw'))
_PREFIX = 'poses[*].pose.'
_EXACT = 2**53  # ns: longer durations are no exact double


class Parts(NamedTuple):
    """A serialised path: everything up to the first pose, and the other poses."""

    head: np.void  # HEAD
    rest: np.ndarray  # (n - 1,) REST


def size(poses: int) -> int:
    """Return the bytes of a path of so many poses."""
    return HEAD.itemsize + (poses - 1) * REST.itemsize


def parts(raw: bytes) -> Parts | None:
    """Return views into a serialised path; None when it is not laid out as described here."""
    if len(raw) < HEAD.itemsize or (len(raw) - HEAD.itemsize) % REST.itemsize:
        return None
    if raw[: len(LITTLE_ENDIAN)] != LITTLE_ENDIAN:
        return None
    head = np.frombuffer(raw, HEAD, count=1)[0]
    rest = np.frombuffer(raw, REST, offset=HEAD.itemsize)
    return Parts(head, rest) if head['poses'] == len(rest) + 1 else None


def stamps_ns(found: Parts) -> np.ndarray:
    """Return every stamp of a path [ns], shape (n + 1,): that of the message, then of each pose."""
    return _ns(_stamps(found))


def read(raw: bytes) -> Reference | None:
    """Return what `decode.reference` returns of the message, to the last bit.

    None for every message that breaks the contract, and for what is laid out otherwise:
    `decode.reference` then says what is wrong, if anything is.
    """
    found = parts(raw)
    if found is None or not _has_form(found):
        return None
    stamps = _stamps(found)
    ns = _ns(stamps)
    durations_ns = ns[1:] - ns[0]
    poses = np.concatenate((found.head['first_pose'].reshape(1), found.rest['pose']))
    values = dict(zip(_FLOATS, np.ascontiguousarray(poses.view('<f8').reshape(-1, 7).T)))
    # nanoseconds may be more than a second: the sum can be positive where the seconds are not
    if np.any(stamps['sec'] < 0) or np.any(ns == 0):
        return None
    if np.abs(durations_ns).max() >= _EXACT or not _in_range(values):
        return None
    t = durations_ns / NS_PER_S
    if np.any(np.diff(t) <= 0.0):
        return None
    turns = zip(values['orientation.z'].tolist(), values['orientation.w'].tolist())
    psi = np.unwrap([yaw.from_quaternion(z, w) for z, w in turns])
    return Reference(int(ns[0]), values['position.x'], values['position.y'], psi, t - t[0])


def restamped(raw: bytes, stamp_ns: int) -> bytes:
    """Return a serialised path under another stamp; those of its poses are moved as far.

    Raises ValueError for what is laid out otherwise.
    """
    buffer = bytearray(raw)
    found = parts(buffer)
    if found is None:
        raise ValueError(f'{len(raw)} bytes are no serialised {TOPIC}')
    head = np.frombuffer(buffer, HEAD, count=1)
    ns = stamps_ns(found) - int(stamps_ns(found)[0]) + stamp_ns
    places = (head['stamp'], head['first_stamp'], found.rest['stamp'])
    for place, shifted in zip(places, np.split(ns, (1, 2))):
        place['sec'], place['nanosec'] = np.divmod(shifted, NS_PER_S)
    return bytes(buffer)


def _stamps(found):
    first = np.array([found.head['stamp'], found.head['first_stamp']])
    return np.concatenate((first, found.rest['stamp']))


def _ns(stamps):
    return stamps['sec'].astype(np.int64) * NS_PER_S + stamps['nanosec']


def _has_form(found):
    topic = contract.load().topics[TOPIC]
    frame = np.void((len(topic.frame) + 1).to_bytes(4, 'little') + topic.frame.encode() + b'\x00')
    allowed = topic.sizes['poses']
    return (
        frame.dtype == np.dtype(FRAME)
        and allowed.low <= found.head['poses'] <= allowed.high
        and found.head['frame'] == found.head['first_frame'] == frame
        and bool((found.rest['frame'] == frame).all())
    )


def _in_range(values):
    fields = contract.load().topics[TOPIC].fields
    for path, field in fields.items():
        column = values[path.removeprefix(_PREFIX)]
        if not np.all((field.low <= column) & (column <= field.high)):
            return False
    square = sum(values[f'orientation.{axis}'] ** 2 for axis in 'xyzw')
    return bool(np.all(np.abs(square - 1.0) <= UNIT_TOLERANCE))
