"""ROS messages to values, checked against the contract first.

Messages may come from rclpy, rosbags or mcap_ros2: only their attributes are used. Every function
raises DecodeError, which names the field and what is allowed, and is the inverse of the function
of the same name in `encode`.
"""

import math
import struct
from collections import Counter
from functools import partial
from itertools import pairwise
from types import SimpleNamespace
from typing import Any

import numpy as np

from msgs_yaml import conformance, contract, conversions, flat_fields, point_cloud, types

_CDR_ORDERS = {b'\x00\x01': '<iI', b'\x00\x00': '>iI'}
_STAMP_OFFSET = 4  # after the encapsulation header
# visualization_msgs/Marker
_ARROW, _CYLINDER, _LINE_STRIP, _SPHERE_LIST = 0, 3, 4, 7
_ADD, _DELETE, _DELETEALL = 0, 2, 3
_EDGES = '/scenario/road_edges'
_OBSTACLES = '/scenario/obstacles'
_OBJECTS = {'obstacle': (_CYLINDER, _SPHERE_LIST), 'velocity': (_ARROW,)}
_PREDICTIONS = '/scenario/predictions'
_ROUNDING = 1e-6  # of a number of 32 bits, relative


class DecodeError(ValueError):
    """A message violates the contract."""


def _flat(topic, msg):
    """Return the value of a topic of `flat_fields.TYPES`."""
    _check(topic, msg)
    fields = flat_fields.load(topic)
    return fields.to_value(conversions.stamp_to_ns(msg.header.stamp), fields.numbers_of(msg))


# each takes a message of its topic and returns the value
odometry = partial(_flat, '/vehicle/odometry')
estimate = partial(_flat, '/estimator/odometry')
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


def stop_plan(msg: Any) -> types.StopPlan:
    """Return the set-points of /controller/stop_plan; their times increase."""
    topic, joints = '/controller/stop_plan', contract.load().topics['/controller/command'].joints
    _check(topic, msg)
    if tuple(msg.joint_names) != joints:
        given, allowed = (', '.join(names) for names in (msg.joint_names, joints))
        raise DecodeError(f'{topic}: joint_names is {given}; allowed {allowed}')
    since_ns = [conversions.stamp_to_ns(point.time_from_start) for point in msg.points]
    for i, (before, after) in enumerate(pairwise([0, *since_ns])):
        if after <= before:
            raise DecodeError(
                f'{topic}: points[{i}].time_from_start is {conversions.ns_to_s(after):.9f} s; '
                f'allowed above {conversions.ns_to_s(before):.9f} s, that of the point before it'
            )
    rows = [(p.positions[0], p.effort[1], p.effort[2]) for p in msg.points]
    t = np.array(since_ns) / conversions.NS_PER_S
    return types.StopPlan(conversions.stamp_to_ns(msg.header.stamp), t, *np.array(rows).T.copy())


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
    """Return the obstacles of /scenario/obstacles, in the order of their shapes.

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
    shapes, arrows = used['obstacle'], used['velocity']
    for number in arrows.keys() - shapes.keys():
        lost = f'velocity {number}: belongs to no obstacle; allowed same id'
        refused.append(types.Refusal('velocity', lost))
    if refused and not shapes:
        raise DecodeError(f'{_OBSTACLES}: {refused[0].reason}')
    items = tuple(_obstacle(shape, arrows.get(number)) for number, shape in shapes.items())
    return types.Obstacles(stamp_ns, items, tuple(refused))


def predictions(msg: Any) -> types.Predictions:
    """Return the predictions of /scenario/predictions, by id, each with its branches in order.

    The prediction of an obstacle that breaks the contract is refused, the others are used. Raises
    DecodeError for another layout, frame or stamp.
    """
    _check(_PREDICTIONS, msg, conformance.check_form)
    stamp_ns, points = conversions.stamp_to_ns(msg.header.stamp), point_cloud.read(msg)
    order = np.lexsort((points['branch'], points['id']))  # stable: a branch keeps its points' order
    points = {name: column[order] for name, column in points.items()}
    ids, p = points['id'], points['probability']
    begins = np.diff(ids * 256 + points['branch'], prepend=-1) != 0  # of a branch
    refused: dict[int, types.Refusal] = {}
    with np.errstate(over='ignore', invalid='ignore'):  # of numbers that are refused
        for bad, kind, reason in _prediction_faults(points, begins):
            numbers, first = np.unique(ids[bad], return_index=True)
            for number, row in zip(numbers.tolist(), np.flatnonzero(bad)[first]):
                text = reason.format(**{name: column[row] for name, column in points.items()})
                refused.setdefault(number, types.Refusal(kind, f'prediction {number}: {text}'))
    XY = np.array([[points['var_x'], points['cov_xy']], [points['cov_xy'], points['var_y']]])
    by_id: dict[int, list[types.Branch]] = {}
    starts = np.flatnonzero(begins)
    for begin, end in zip(starts, [*starts[1:], len(ids)]):
        line = (points[name][begin:end] for name in ('t', 'x', 'y'))
        branch = types.Branch(
            stamp_ns, float(p[begin]), *line, XY[:, :, begin:end].transpose(2, 0, 1)
        )
        by_id.setdefault(int(ids[begin]), []).append(branch)
    used = {number: tuple(b) for number, b in by_id.items() if number not in refused}
    return types.Predictions(stamp_ns, used, tuple(refused.values()))


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
    if marker.type not in _OBJECTS[marker.ns]:
        allowed = ', '.join(map(str, _OBJECTS[marker.ns]))
        return 'type', f'type is {marker.type}; allowed {allowed}'
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
    if marker.type == _SPHERE_LIST:
        q = marker.pose.orientation
        if not len(marker.points):
            return 'shape', 'it has no points; allowed 1 or more, the centres of its discs'
        if q.x or q.y or not (abs(q.z) <= 1.0 and abs(q.w) <= 1.0):
            turn = q.x, q.y, q.z, q.w
            return 'shape', f'its orientation is {turn}; allowed a turn about z'
    return '', ''


def _prediction_faults(points, begins):
    """Yield what may be wrong with sorted points: which rows (n,) are, a word, and the reason.

    begins  (n,), whether a row is the first one of its branch
    """
    for path, field in contract.load().topics[_PREDICTIONS].fields.items():
        name = path.removeprefix('data[').rstrip(']')
        bad = ~((field.low <= points[name]) & (points[name] <= field.high))
        value = f'{name} ({field.symbol}) is {{{name}}}'
        yield bad, 'field', f'{value}; allowed {field.low:g} to {field.high:g} {field.unit}'
    p, t = points['probability'], points['t']
    late = ~begins & (np.diff(t, prepend=0.0) <= 0.0)
    yield late, 'times', 't is {t} s in branch {branch}; allowed above the t of the point before'
    other = ~begins & (np.diff(p, prepend=0.0) != 0.0)
    yield other, 'probability', 'probability is {probability}; allowed one for a branch'
    _, obstacle = np.unique(points['id'], return_inverse=True)
    total = np.bincount(obstacle, p * begins, minlength=1)[obstacle]
    above = total > 1.0 + 256 * _ROUNDING
    yield above, 'probability', 'its branches have more than 1 in sum; allowed 0 to 1'
    # a little more: one that is singular may not be so any more when it is rounded
    var_x, var_y = (points[k] * (1.0 + _ROUNDING) + _ROUNDING**2 for k in ('var_x', 'var_y'))
    wide = points['cov_xy'] ** 2 > var_x * var_y
    allowed = 'allowed up to the root of {var_x} x {var_y} either way'
    yield wide, 'covariance', f'cov_xy is {{cov_xy}} m^2; {allowed}'


def _obstacle(shape, arrow):
    vX = vY = 0.0
    if arrow is not None:
        tail, tip = arrow.points
        vX, vY = float(tip.x) - float(tail.x), float(tip.y) - float(tail.y)
    position, q = shape.pose.position, shape.pose.orientation
    X, Y, radius = float(position.x), float(position.y), 0.5 * float(shape.scale.x)
    others: tuple[tuple[float, float], ...] = ()
    if shape.type == _SPHERE_LIST:
        psi = conversions.quaternion_to_heading(float(q.z), float(q.w))
        cos, sin = math.cos(psi), math.sin(psi)
        places = [(cos * p.x - sin * p.y, sin * p.x + cos * p.y) for p in shape.points]
        first_X, first_Y = places[0]
        X, Y = X + first_X, Y + first_Y
        others = tuple((float(x - first_X), float(y - first_Y)) for x, y in places[1:])
    return types.Obstacle(int(shape.id), X, Y, radius, vX, vY, others)
