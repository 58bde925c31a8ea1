"""Path and road edges read from serialised messages with numpy, and sent again under another stamp.

Message objects of 5000 poses or points take 30 to 100 ms to build or to read, up to two ticks of
the controller; their bytes take a millisecond, a tenth of it if the message is a repetition. They
are CDR, little endian (OMG DDSI-RTPS 2.2, chapter 10; alignments of XCDR1), with the layouts of
nav_msgs/Path and visualization_msgs/Marker in ROS 2 Jazzy.

The readers return None for every message that violates the contract or is laid out otherwise:
`decode` then raises the error that names the cause, if there is one.
"""

import struct
from typing import NamedTuple

import numpy as np

from msgs_yaml import conformance, contract, conversions
from msgs_yaml.conversions import NS_PER_S
from msgs_yaml.flat_fields import ENCAPSULATION
from msgs_yaml.flat_fields import STAMP as STAMP_STRUCT
from msgs_yaml.types import Reference, RoadEdges

REFERENCE = '/scenario/reference'
ROAD_EDGES = '/scenario/road_edges'
STAMP = [('sec', '<i4'), ('nanosec', '<u4')]
_FRAME = contract.load().topics[REFERENCE].frame
# length and characters, with the closing zero
FRAME = np.void(struct.pack('<I', len(_FRAME) + 1) + _FRAME.encode() + b'\0')
if FRAME.itemsize % 8:  # other lengths need padding before every pose
    raise contract.ContractError(
        f'{REFERENCE}: the frame {_FRAME!r} has {len(_FRAME)} characters; allowed 3, 11, 19, ...'
    )
HEAD = np.dtype(
    [('encapsulation', 'V4'), ('stamp', STAMP), ('frame', FRAME.dtype), ('poses', '<u4')]
)
POSE = np.dtype([('stamp', STAMP), ('frame', FRAME.dtype), ('pose', 'V56')])
_FIRST_DOUBLE = HEAD.itemsize + POSE.fields['pose'][1]  # without the padding that aligns it
PADDING = slice(_FIRST_DOUBLE, _FIRST_DOUBLE + 4)  # the poses behind the first one need none
_LEAST_BYTES = HEAD.itemsize + 4
_POSITION, _ORIENTATION = 'poses[*].pose.position', 'poses[*].pose.orientation'
_POSE_PATHS = *(f'{_POSITION}.{a}' for a in 'xyz'), *(f'{_ORIENTATION}.{a}' for a in 'xyzw')
_EXACT_NS = 2**53  # longer durations are no exact double
SIDES = ('left', 'right')
_LINE_STRIP, _ADD = 4, 0
_KIND = struct.Struct('<iii')  # id, type, action
_POSE_AND_SCALE, _COLOR_AND_LIFETIME = 10 * 8, 4 * 4 + 8  # bytes
_COLOR, _UV = 4 * 4, 2 * 4
_UINT32 = struct.Struct('<I')


def reference_size(poses: int) -> int:
    """Return the size of a serialised path of so many poses [bytes]."""
    return _LEAST_BYTES + poses * POSE.itemsize


def read_reference(raw: bytes) -> Reference | None:
    """Return what `decode.reference` returns of the message, to the last bit; None as above."""
    parts, topic = _head_and_poses(raw), contract.load().topics[REFERENCE]
    if parts is None:
        return None
    _, head, poses = parts
    allowed = topic.sizes['poses']
    has_frames = head['frame'][0] == FRAME and bool((poses['frame'] == FRAME).all())
    if not has_frames or not allowed.low <= len(poses) <= allowed.high:
        return None
    stamps = np.concatenate((head['stamp'], poses['stamp']))
    stamps_ns = _nanoseconds(stamps)
    durations_ns = stamps_ns[1:] - stamps_ns[0]
    if (stamps_ns[1:] == stamps_ns[1]).all():  # no desired speeds; a stamp of 0 may be far away
        durations_ns[:] = 0
    columns = np.ascontiguousarray(poses['pose']).view('<f8').reshape(-1, 7).T
    values = dict(zip(_POSE_PATHS, np.ascontiguousarray(columns)))
    # nanoseconds may be more than a second: the sum can be positive where the seconds are not
    if np.any(stamps['sec'] < 0) or stamps_ns[0] == 0 or np.abs(durations_ns).max() >= _EXACT_NS:
        return None
    if not conformance.obeys(REFERENCE, {path: values[path] for path in topic.fields}).all():
        return None
    t = durations_ns / NS_PER_S
    if np.any(np.diff(t) <= 0.0) and np.any(t):
        return None
    quaternions = values[f'{_ORIENTATION}.z'], values[f'{_ORIENTATION}.w']
    psi = np.unwrap(conversions.quaternions_to_headings(*quaternions))
    X, Y = values[f'{_POSITION}.x'], values[f'{_POSITION}.y']
    return Reference(int(stamps_ns[0]), X, Y, psi, t - t[0])


def restamp_reference(raw: bytes, stamp_ns: int) -> bytes:
    """Return a serialised path under another stamp, those of its poses shifted by the same time.

    Poses stamped 0 stay so. Raises ValueError if the layout is another.
    """
    parts = _head_and_poses(raw)
    if parts is None:
        raise ValueError(f'{len(raw)} bytes are no serialised {REFERENCE}')
    packed, head, poses = parts
    shift_ns = stamp_ns - int(_nanoseconds(head['stamp'])[0])
    for stamps in (head['stamp'], poses['stamp']):
        before_ns = _nanoseconds(stamps)
        after_ns = np.where(before_ns, before_ns + shift_ns, 0)
        stamps['sec'], stamps['nanosec'] = np.divmod(after_ns, NS_PER_S)
    return bytes(packed[: PADDING.start]) + raw[PADDING] + bytes(packed[PADDING.start :])


def _head_and_poses(raw):
    """Return a copy of a path without its padding, and its head (1,) and poses (n,) in it.

    So all poses are alike. None if the layout is another.
    """
    number, rest = divmod(len(raw) - _LEAST_BYTES, POSE.itemsize)
    if number <= 0 or rest or raw[: len(ENCAPSULATION)] != ENCAPSULATION:
        return None
    packed = bytearray(raw)
    del packed[PADDING]
    head = np.frombuffer(packed, HEAD, count=1)
    poses = np.frombuffer(packed, POSE, offset=HEAD.itemsize)
    return (packed, head, poses) if head['poses'][0] == number else None


def _nanoseconds(stamps):
    return stamps['sec'].astype(np.int64) * NS_PER_S + stamps['nanosec']


class _Line(NamedTuple):
    """The fields of a serialised marker that matter for a road edge."""

    stamp_offset: int  # in the message
    sec: int  # of its stamp
    stamp_ns: int
    frame: str
    ns: str
    type: int
    action: int
    points: np.ndarray  # (n, 3) m


def read_road_edges(raw: bytes) -> RoadEdges | None:
    """Return what `decode.road_edges` returns of the message, to the last bit; None as above."""
    lines, topic = _lines(raw), contract.load().topics[ROAD_EDGES]
    if lines is None or {line.ns for line in lines} != set(SIDES):
        return None
    allowed, first_ns = topic.sizes['markers[*].points'], lines[0].stamp_ns
    for line in lines:
        # nanoseconds may be more than a second
        if line.sec < 0 or not line.stamp_ns == first_ns > 0 or line.frame != topic.frame:
            return None
        if (line.type, line.action) != (_LINE_STRIP, _ADD):
            return None
        if not allowed.low <= len(line.points) <= allowed.high:
            return None
    sides = {line.ns: np.ascontiguousarray(line.points[:, :2]) for line in lines}
    for side, points in sides.items():
        numbers = {f'markers[{side}].points[*].{a}': x for a, x in zip('xy', points.T)}
        if not conformance.obeys(ROAD_EDGES, numbers).all():
            return None
    return RoadEdges(first_ns, sides['left'], sides['right'])


def restamp_road_edges(raw: bytes, stamp_ns: int) -> bytes:
    """Return serialised edges under another stamp; raise ValueError if the layout is another."""
    lines = _lines(raw)
    if lines is None:
        raise ValueError(f'{len(raw)} bytes are no serialised {ROAD_EDGES}')
    buffer = bytearray(raw)
    for line in lines:
        STAMP_STRUCT.pack_into(buffer, line.stamp_offset, *conversions.split_stamp(stamp_ns))
    return bytes(buffer)


def repeated_ns(topic: str, new: bytes, old: bytes | None) -> int:
    """Return the stamp [ns] of a path or of edges that are the old ones at another time, else 0.

    Both are sent four times per second, and comparing bytes is faster than reading them. Of a path
    all stamps have moved by the same time. 0 also for messages with another layout.
    """
    if old is None or len(new) != len(old):
        return 0
    restamp, offset = _RESTAMP[topic]
    try:
        stamp_ns = int(_nanoseconds(np.frombuffer(new, STAMP, count=1, offset=offset))[0])
        expected = restamp(old, stamp_ns)
    except ValueError:
        return 0
    if topic == REFERENCE:  # a serialiser may leave in the padding what was in memory
        expected = expected[: PADDING.start] + bytes(new[PADDING]) + expected[PADDING.stop :]
    return stamp_ns if stamp_ns > 0 and expected == new else 0


# how each topic is restamped, and where its first stamp is
_RESTAMP = {
    REFERENCE: (restamp_reference, len(ENCAPSULATION)),
    ROAD_EDGES: (restamp_road_edges, len(ENCAPSULATION) + _UINT32.size),
}


def _lines(raw):
    """Return the two markers of a message; None if it does not consist of these."""
    try:
        reader = _Reader(raw)
        if reader.count() != len(SIDES):
            return None
        return [_read_line(reader) for _ in SIDES]
    except ValueError:
        return None


def _read_line(reader):
    stamp_offset = reader.align(4)
    sec, nanosec = reader.unpack(STAMP_STRUCT, 4)
    frame, ns = reader.text(), reader.text()
    _, kind, action = reader.unpack(_KIND, 4)
    reader.skip(_POSE_AND_SCALE, 8)
    reader.skip(_COLOR_AND_LIFETIME, 4)
    reader.boolean()  # frame_locked
    count = reader.count()
    begin = reader.skip(24 * count, 8)
    points = np.frombuffer(reader.raw, '<f8', 3 * count, begin).reshape(-1, 3)
    reader.skip(_COLOR * reader.count(), 4)
    reader.text()  # texture_resource
    reader.skip(STAMP_STRUCT.size, 4)  # texture
    reader.text()
    reader.text()
    reader.skip(reader.count())
    reader.skip(_UV * reader.count(), 4)  # uv_coordinates
    reader.text()  # text
    reader.text()  # mesh_resource
    reader.text()  # mesh_file
    reader.skip(reader.count())
    reader.boolean()  # mesh_use_embedded_materials
    stamp_ns = sec * NS_PER_S + nanosec
    return _Line(stamp_offset, sec, stamp_ns, frame, ns, kind, action, points)


class _Reader:
    """Reads a serialised message from its start; raises ValueError for other bytes."""

    def __init__(self, raw):
        if raw[: len(ENCAPSULATION)] != ENCAPSULATION:
            raise ValueError('the message is not little-endian CDR')
        self.raw = raw
        self._offset = len(ENCAPSULATION)

    def align(self, size):
        """Advance to the next multiple of `size`; return the offset."""
        self._offset += -(self._offset - len(ENCAPSULATION)) % size
        return self._offset

    def skip(self, size, alignment=1):
        """Advance by so many bytes, aligned unless 0; return the offset of the first."""
        begin = self.align(alignment) if size else self._offset
        if begin + size > len(self.raw):
            raise ValueError(f'the message ends at byte {len(self.raw)}')
        self._offset = begin + size
        return begin

    def unpack(self, form, alignment):
        return form.unpack_from(self.raw, self.skip(form.size, alignment))

    def count(self):
        """Return the length of a sequence."""
        return self.unpack(_UINT32, _UINT32.size)[0]

    def text(self):
        """Return a string; raise ValueError if it has no closing zero or is no UTF-8."""
        size = self.count()
        begin = self.skip(size)
        encoded = bytes(self.raw[begin : begin + size])
        if encoded[-1:] not in (b'', b'\x00'):
            raise ValueError(f'the string at byte {begin} has no closing zero')
        return encoded[:-1].decode()

    def boolean(self):
        """Advance by a truth; raise ValueError for another number."""
        value = self.raw[self.skip(1)]
        if value > 1:
            raise ValueError(f'{value} is no boolean')
