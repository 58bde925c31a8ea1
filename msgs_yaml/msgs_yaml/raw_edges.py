"""Reads a serialised /scenario/road_edges with numpy, and sends it again under another stamp.

Message objects of two lines with 5000 points each take 30 ms to make or to read; their bytes take
less than one. The layout of a marker is that of visualization_msgs/Marker in ROS 2 Jazzy.
"""

import struct
from typing import NamedTuple

import numpy as np

from msgs_yaml import cdr, contract
from msgs_yaml.stamp import NS_PER_S, split
from msgs_yaml.types import RoadEdges

TOPIC = '/scenario/road_edges'
SIDES = ('left', 'right')
_LINE_STRIP, _ADD = 4, 0
_KIND = struct.Struct('<iii')  # id, type, action
_POSE_AND_SCALE, _COLOR_AND_LIFETIME = 10 * 8, 4 * 4 + 8
_POINT, _COLOR, _UV = 3 * 8, 4 * 4, 2 * 4


class Line(NamedTuple):
    """What matters of a marker."""

    stamp_at: int  # where its stamp begins in the message
    sec: int  # of its stamp
    stamp_ns: int
    frame: str
    ns: str
    type: int
    action: int
    points: np.ndarray  # (n, 3) m


def read(raw: bytes) -> RoadEdges | None:
    """Return what `decode.road_edges` returns of the message, to the last bit.

    None for every message that breaks the contract, and for what is laid out otherwise:
    `decode.road_edges` then says what is wrong, if anything is.
    """
    found = lines(raw)
    if found is None or not _has_form(found):
        return None
    sides = {line.ns: np.ascontiguousarray(line.points[:, :2]) for line in found}
    fields = contract.load().topics[TOPIC].fields
    for side, points in sides.items():
        for column, axis in zip(points.T, 'xy'):
            field = fields[f'markers[{side}].points[*].{axis}']
            if not np.all((field.low <= column) & (column <= field.high)):
                return None
    return RoadEdges(found[0].stamp_ns, sides['left'], sides['right'])


def restamped(raw: bytes, stamp_ns: int) -> bytes:
    """Return serialised edges under another stamp; ValueError for what is laid out otherwise."""
    found = lines(raw)
    if found is None:
        raise ValueError(f'{len(raw)} bytes are no serialised {TOPIC}')
    buffer = bytearray(raw)
    for line in found:
        cdr.STAMP.pack_into(buffer, line.stamp_at, *split(stamp_ns))
    return bytes(buffer)


def lines(raw: bytes) -> list[Line] | None:
    """Return the two markers of a message; None when these are not what it consists of."""
    try:
        reader = cdr.Reader(raw)
        if reader.count() != len(SIDES):
            return None
        return [_line(reader) for _ in SIDES]
    except (cdr.CdrError, UnicodeDecodeError):
        return None


def _line(reader):
    stamp_at = reader.align(4)
    sec, nanosec = reader.unpack(cdr.STAMP, 4)
    frame, ns = reader.text(), reader.text()
    _, kind, action = reader.unpack(_KIND, 4)
    reader.skip(_POSE_AND_SCALE, 8)
    reader.skip(_COLOR_AND_LIFETIME, 4)
    reader.boolean()  # frame_locked
    points = reader.floats(3 * reader.count()).reshape(-1, 3)
    reader.skip(_COLOR * reader.count(), 4)
    reader.text()  # texture_resource
    reader.skip(cdr.STAMP.size, 4)  # texture
    reader.text()
    reader.text()
    reader.skip(reader.count())
    reader.skip(_UV * reader.count(), 4)  # uv_coordinates
    reader.text()  # text
    reader.text()  # mesh_resource
    reader.text()  # mesh_file
    reader.skip(reader.count())
    reader.boolean()  # mesh_use_embedded_materials
    return Line(stamp_at, sec, sec * NS_PER_S + nanosec, frame, ns, kind, action, points)


def _has_form(found):
    topic = contract.load().topics[TOPIC]
    allowed = topic.sizes['markers[*].points']
    first_ns = found[0].stamp_ns
    return sorted(line.ns for line in found) == sorted(SIDES) and all(
        line.stamp_ns == first_ns > 0
        and line.sec >= 0  # nanoseconds may be more than a second
        and line.frame == topic.frame
        and (line.type, line.action) == (_LINE_STRIP, _ADD)
        and allowed.low <= len(line.points) <= allowed.high
        for line in found
    )
