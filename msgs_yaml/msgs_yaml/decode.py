"""ROS messages to values, checked against the contract first.

Messages may come from rclpy, rosbags or mcap_ros2: only their attributes are used. Every function
raises DecodeError, which names the field and what is allowed, and is the inverse of the function
of the same name in `encode`.
"""

import struct
from collections import Counter
from functools import partial
from types import SimpleNamespace
from typing import Any

import numpy as np

from msgs_yaml import conformance, contract, conversions, flat_fields, types

_CDR_ORDERS = {b'\x00\x01': '<iI', b'\x00\x00': '>iI'}
_STAMP_OFFSET = 4  # after the encapsulation header
# visualization_msgs/Marker
_ARROW, _CYLINDER, _LINE_STRIP = 0, 3, 4
_ADD, _DELETE, _DELETEALL = 0, 2, 3
_EDGES = '/scenario/road_edges'
_OBSTACLES = '/scenario/obstacles'
_OBJECTS = {'obstacle': _CYLINDER, 'velocity': _ARROW}


class DecodeError(ValueError):
    """A message violates the contract."""


def _flat(topic, msg):
    """Return the value of a topic of `flat_fields.TYPES`."""
    _check(topic, msg)
    fields = flat_fields.load(topic)
    return fields.to_value(conversions.stamp_to_ns(msg.header.stamp), fields.numbers_of(msg))


# each takes a message and returns the value of `types` that is named alike
odometry = partial(_flat, '/vehicle/odometry')
imu = partial(_flat, '/vehicle/imu')
actuators = partial(_flat, '/vehicle/actuators')
wheels = partial(_flat, '/vehicle/wheels')
inertial = partial(_flat, '/sensors/inertial')
chassis = partial(_flat, '/sensors/chassis')
gnss = partial(_flat, '/sensors/gnss')
command = partial(_flat, '/controller/command')


def reference(msg: Any) -> types.Reference:
    """Return the path of /scenario/reference; pose stamps increase, or all are the same."""
    stamp_ns, X, Y, psi, t = _path('/scenario/reference', msg)
    if np.any(np.diff(t) <= 0.0) and np.any(t != t[0]):
        i = int(np.argmax(np.diff(t) <= 0.0)) + 1
        raise DecodeError(
            f'/scenario/reference: poses[{i}].header.stamp is {t[i]:.9f} s after the first pose; '
            f'allowed above {t[i - 1]:.9f} s, the pose before it'
        )
    return types.Reference(stamp_ns, X, Y, np.unwrap(psi), t - t[0])


def prediction(msg: Any) -> types.Prediction:
    """Return the plan of /controller/prediction."""
    stamp_ns, X, Y, psi, t = _path('/controller/prediction', msg)
    return types.Prediction(stamp_ns, X, Y, np.unwrap(psi), t)


def road_edges(msg: Any) -> types.RoadEdges:
    """Return the edges of /scenario/road_edges."""
    _check(_EDGES, msg)
    lines = {}
    for marker in msg.markers:
        if marker.ns not in ('left', 'right'):
            raise DecodeError(f'{_EDGES}: ns is {marker.ns!r}; allowed left, right')
        if marker.type != _LINE_STRIP:
            allowed = f'{_LINE_STRIP} with ns {marker.ns}'
            raise DecodeError(f'{_EDGES}: type is {marker.type}; allowed {allowed}')
        if marker.action != _ADD:
            raise DecodeError(f'{_EDGES}: action is {marker.action}; allowed {_ADD} (ADD)')
        lines[marker.ns] = np.array([(float(p.x), float(p.y)) for p in marker.points])
    if len(lines) != 2:
        raise DecodeError(f'{_EDGES}: markers are both {msg.markers[0].ns!r}; allowed left, right')
    stamps = {conversions.stamp_to_ns(marker.header.stamp) for marker in msg.markers}
    if len(stamps) != 1:
        raise DecodeError(f'{_EDGES}: markers have {len(stamps)} stamps; allowed one for all')
    return types.RoadEdges(stamps.pop(), lines['left'], lines['right'])


def obstacles(msg: Any) -> types.Obstacles:
    """Return the obstacles of /scenario/obstacles, in the order of their cylinders.

    An object that breaks the contract is refused, the others are used. Raises DecodeError if there
    are objects and none of them can be used: that would read as a free road.
    """
    most = contract.load().topics[_OBSTACLES].sizes['markers'].high
    markers, refused = [*msg.markers[:most]], []
    if len(msg.markers) > most:
        refused.append(types.Refusal('number', f'more than {most} markers: the first are used'))
    added = [marker for marker in markers if marker.action not in (_DELETE, _DELETEALL)]
    stamps = Counter(conversions.stamp_to_ns(m.header.stamp) for m in added or markers)
    stamp_ns = stamps.most_common(1)[0][0] if stamps else 0
    used: dict[str, dict[int, Any]] = {ns: {} for ns in _OBJECTS}
    # marker by marker takes four times as long: only to find those that break the contract
    suspected = conformance.check(_OBSTACLES, SimpleNamespace(markers=added))
    for marker in added:
        alone = SimpleNamespace(markers=[marker])
        violations = conformance.check(_OBSTACLES, alone) if suspected else []
        kind, reason = _fault(marker, used, stamp_ns, violations)
        if kind:
            refused.append(types.Refusal(kind, f'{marker.ns} {marker.id}: {reason}'))
        else:
            used[marker.ns][int(marker.id)] = marker
    cylinders, arrows = used['obstacle'], used['velocity']
    for number in arrows.keys() - cylinders.keys():
        lost = f'velocity {number}: belongs to no obstacle; allowed same id'
        refused.append(types.Refusal('velocity', lost))
    if refused and not cylinders:
        raise DecodeError(f'{_OBSTACLES}: {refused[0].reason}')
    items = tuple(_obstacle(c, arrows.get(number)) for number, c in cylinders.items())
    return types.Obstacles(stamp_ns, items, tuple(refused))


def why(msg: Any) -> types.Why:
    """Return the diagnostics of a tick from /controller/why."""
    ((stamp_ns, _, *status),) = _statuses('/controller/why', msg)
    return types.Why(stamp_ns, *status)


def health(msg: Any) -> tuple[types.Health, ...]:
    """Return every status of /diagnostics: one of a node of this system, any number of others."""
    return tuple(types.Health(*status) for status in _statuses('/diagnostics', msg))


def clock(msg: Any) -> int:
    """Return the time of /clock in nanoseconds; 0 stands for no time and raises DecodeError."""
    _check('/clock', msg)
    now_ns = conversions.stamp_to_ns(msg.clock)
    if not now_ns:
        raise DecodeError('/clock: clock (t) is 0 s: no time yet; allowed above 0 s')
    return now_ns


def run_start(msg: Any) -> int:
    """Return the start of the run of /vehicle/run_start in nanoseconds, 0 before it."""
    _check('/vehicle/run_start', msg)
    return conversions.stamp_to_ns(msg)


def stamp_ns_of(raw: bytes) -> int:
    """Return the header stamp of a serialised message whose first field is a Header."""
    form = _CDR_ORDERS.get(bytes(raw[:2]))
    if form is None or len(raw) < _STAMP_OFFSET + struct.calcsize(form):
        raise DecodeError(f'no CDR message with a header: {bytes(raw[:16])!r}')
    sec, nanosec = struct.unpack_from(form, raw, _STAMP_OFFSET)
    return sec * conversions.NS_PER_S + nanosec


def _check(topic: str, msg: Any, check=conformance.check) -> None:
    """Raise DecodeError with the first violation of the contract in a message."""
    violations = check(topic, msg)
    if violations:
        raise DecodeError(str(violations[0]))


def _path(topic, msg):
    """Return stamp, X, Y, psi, t; t in s after the stamp of the message."""
    _check(topic, msg)
    stamp_ns = conversions.stamp_to_ns(msg.header.stamp)
    rows = []
    for pose in msg.poses:
        position, q = pose.pose.position, pose.pose.orientation
        psi = conversions.quaternion_to_heading(float(q.z), float(q.w))
        t = conversions.ns_to_s(conversions.stamp_to_ns(pose.header.stamp) - stamp_ns)
        rows.append((float(position.x), float(position.y), psi, t))
    return stamp_ns, *np.array(rows).T.copy()


def _statuses(topic, msg):
    """Yield stamp, name, level, message and values of each status.

    Its numbers are not checked: a failed tick must stay readable.
    """
    _check(topic, msg, conformance.check_form)
    stamp_ns = conversions.stamp_to_ns(msg.header.stamp)
    for status in msg.status:
        # rclpy holds a byte, others an integer
        level = status.level[0] if isinstance(status.level, bytes) else int(status.level)
        values = {pair.key: conversions.text_to_value(pair.value) for pair in status.values}
        yield stamp_ns, status.name, level, status.message, values


def _fault(marker, used, stamp_ns, violations):
    """Return what is wrong with a marker of an obstacle, a word and a reason; '' twice if nothing.

    used         {ns: {id: marker}} of the markers before it
    violations   of the contract, in its fields and header
    """
    if marker.ns not in used:
        return 'ns', f'allowed ns {", ".join(used)}'
    if marker.type != _OBJECTS[marker.ns]:
        return 'type', f'type is {marker.type}; allowed {_OBJECTS[marker.ns]}'
    if marker.action != _ADD:
        return 'action', f'action is {marker.action}; allowed {_ADD} (ADD)'
    if violations:
        return 'field', str(violations[0]).removeprefix(f'{_OBSTACLES}: ')
    if conversions.stamp_to_ns(marker.header.stamp) != stamp_ns:
        return 'stamp', 'its stamp is not that of most markers; allowed one for all'
    if marker.id in used[marker.ns]:
        return 'id', 'another one before it has this id; allowed different ids'
    if marker.ns == 'obstacle' and marker.scale.x != marker.scale.y:
        x, y = marker.scale.x, marker.scale.y
        return 'shape', f'scale.y is {y}; allowed scale.x = {x}, obstacles are round'
    return '', ''


def _obstacle(cylinder, arrow):
    vX = vY = 0.0
    if arrow is not None:
        tail, tip = arrow.points
        vX, vY = float(tip.x) - float(tail.x), float(tip.y) - float(tail.y)
    position = cylinder.pose.position
    X, Y, radius = float(position.x), float(position.y), 0.5 * float(cylinder.scale.x)
    return types.Obstacle(int(cylinder.id), X, Y, radius, vX, vY)
