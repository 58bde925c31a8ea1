"""Path and road edges read from serialised messages with numpy, and sent again under another stamp.

Message objects of 5000 poses or points take 30 to 100 ms to build or to read, up to two ticks of
the controller; their bytes take a millisecond, a tenth of it if the message is a repetition. They
are CDR, little endian (OMG DDSI-RTPS 2.2, chapter 10; alignments of XCDR1), with the layouts of
nav_msgs/Path and visualization_msgs/Marker in ROS 2 Jazzy.

The readers return None for every message that violates the contract or is laid out otherwise:
`decode` then raises the error that names the cause, if there is one.
"""

import struct

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
# the fields of a visualization_msgs/Marker in order, by the letters of `struct`; `*`: a sequence
_MARKER = (
    *(('stamp', 'iI'), ('frame', '*s'), ('ns', '*s'), ('kind', '3i'), ('pose and scale', '10d')),
    *(('color', '4f'), ('lifetime', 'iI'), ('frame_locked', '?'), ('points', '*3d')),
    *(('colors', '*4f'), ('texture_resource', '*s'), ('texture stamp', 'iI')),
    *(('texture frame', '*s'), ('texture format', '*s'), ('texture data', '*B')),
    *(('uv_coordinates', '*2f'), ('text', '*s'), ('mesh_resource', '*s'), ('mesh_file', '*s')),
    *(('mesh data', '*B'), ('mesh_use_embedded_materials', '?')),
)
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


def read_road_edges(raw: bytes) -> RoadEdges | None:
    """Return what `decode.road_edges` returns of the message, to the last bit; None as above."""
    markers, topic = _markers(raw), contract.load().topics[ROAD_EDGES]
    if markers is None or {marker['ns'] for marker in markers} != set(SIDES):
        return None
    allowed, sides, stamps_ns = topic.sizes['markers[*].points'], {}, set()
    for marker in markers:
        sec, nanosec = marker['stamp']
        stamps_ns.add(sec * NS_PER_S + nanosec)
        # nanoseconds may be more than a second
        if sec < 0 or stamps_ns == {0} or len(stamps_ns) > 1 or marker['frame'] != topic.frame:
            return None
        if marker['kind'][1:] != (_LINE_STRIP, _ADD):
            return None
        points = np.frombuffer(marker['points'], '<f8').reshape(-1, 3)
        if not allowed.low <= len(points) <= allowed.high:
            return None
        sides[marker['ns']] = np.ascontiguousarray(points[:, :2])
    for side, points in sides.items():
        numbers = {f'markers[{side}].points[*].{a}': x for a, x in zip('xy', points.T)}
        if not conformance.obeys(ROAD_EDGES, numbers).all():
            return None
    return RoadEdges(*stamps_ns, sides['left'], sides['right'])


def restamp_road_edges(raw: bytes, stamp_ns: int) -> bytes:
    """Return serialised edges under another stamp; raise ValueError if the layout is another."""
    markers = _markers(raw)
    if markers is None:
        raise ValueError(f'{len(raw)} bytes are no serialised {ROAD_EDGES}')
    buffer = bytearray(raw)
    for marker in markers:
        STAMP_STRUCT.pack_into(buffer, marker['begin'], *conversions.split_stamp(stamp_ns))
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


def _markers(raw):
    """Return the fields of the two markers of a message; None if it does not consist of these.

    Each has its place in `begin`; strings are decoded, other sequences are bytes.
    """
    begin = len(ENCAPSULATION) + _UINT32.size
    if raw[:begin] != ENCAPSULATION + _UINT32.pack(len(SIDES)):
        return None
    markers = []
    try:
        for _ in SIDES:
            marker, begin = _read_marker(raw, begin)
            markers.append(marker)
    except (ValueError, struct.error):
        return None
    return markers


def _read_marker(raw, offset):
    """Return the fields of a marker and the offset behind it; raise ValueError for other bytes."""

    def aligned(size):
        return offset + -(offset - len(ENCAPSULATION)) % size

    marker = {'begin': aligned(STAMP_STRUCT.size // 2)}
    for name, form in _MARKER:
        count, element = 1, struct.Struct(f'<{form.removeprefix("*")}')
        if form.startswith('*'):
            offset = aligned(_UINT32.size)
            (count,) = _UINT32.unpack_from(raw, offset)
            offset += _UINT32.size
        begin = aligned(struct.calcsize(form[-1])) if count else offset
        offset = begin + count * element.size
        if offset > len(raw):
            raise ValueError(f'the message ends at byte {len(raw)}')
        if form == '*s':
            text = bytes(raw[begin:offset])
            if text[-1:] not in (b'', b'\x00'):
                raise ValueError(f'the string at byte {begin} has no closing zero')
            marker[name] = text[:-1].decode()
        elif form.startswith('*'):
            marker[name] = raw[begin:offset]
        else:
            marker[name] = element.unpack_from(raw, begin)
        if form == '?' and raw[begin] > 1:
            raise ValueError(f'{raw[begin]} is no boolean')
    return marker, offset
