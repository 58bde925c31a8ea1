"""Check a message against the contract: sizes, names, frames, stamps and ranges. Fast, no ROS.

Works on messages of rclpy, rosbags and mcap_ros2 alike. Each check is a function of a message that
returns its violations; what depends on the topic only is computed once, when the check is built.
"""

import math
from collections.abc import Callable
from fnmatch import fnmatchcase
from functools import cache, lru_cache, partial
from typing import Any, NamedTuple

from msgs_yaml import contract, conversions, field_paths
from msgs_yaml.contract import JOINT_ARRAYS, WORD, Field

POSE_HEADERS = 'poses[*].header'
_HEADERS = {
    'nav_msgs/msg/Path': ('header', POSE_HEADERS),
    'visualization_msgs/msg/MarkerArray': ('markers[*].header',),
    'rosgraph_msgs/msg/Clock': (),
    'builtin_interfaces/msg/Time': (),
}
_CACHED_KEYS = 4096


class Violation(NamedTuple):
    """One violation of the contract."""

    topic: str
    field: str  # path in the message
    value: Any
    allowed: str

    def __str__(self):
        return f'{self.topic}: {self.field} is {self.value}; allowed {self.allowed}'


Check = Callable[[Any], list[Violation]]


def check(topic: str, message: Any) -> list[Violation]:
    """Return every violation of the contract in a message of a topic.

    Raises KeyError for a topic that is not in the contract.
    """
    return check_form(topic, message) or _run(_checks(topic).fields, message)


def check_form(topic: str, message: Any) -> list[Violation]:
    """Return the violations in sizes, names, frames and stamps, whatever the numbers are.

    If a size is wrong, nothing else is checked: an absurdly long message costs no time.
    """
    checks = _checks(topic)
    for check_size in checks.sizes:
        violations = check_size(message)
        if violations:
            return violations
    return _run(checks.form, message)


class _Checks(NamedTuple):
    sizes: list[Check]
    form: list[Check]
    fields: list[Check]


def _run(checks, message):
    return [violation for rule in checks for violation in rule(message)]


@cache
def _checks(name):
    topic = contract.load().topics[name]
    # outer arrays before the arrays inside them
    sizes = [partial(_size, topic, p, field_paths.getter(p)) for p in sorted(topic.sizes, key=len)]
    headers = _HEADERS.get(topic.type, ('header',))
    form = [partial(_header, topic, path, field_paths.getter(path)) for path in headers]
    if topic.child_frame is not None:
        form.append(partial(_child_frame, topic))
    if topic.type == contract.DIAGNOSTICS:
        return _Checks(sizes, form, [_diagnostic_values(topic)])
    make_getter = partial(_joint_getter, topic) if topic.joints else field_paths.getter
    fields = [partial(_range, topic, path, make_getter(path)) for path in topic.fields]
    if topic.joints:
        sizes.append(partial(_joint_names, topic, list(topic.joints)))
        fields.insert(0, partial(_finite_joints, topic))
    return _Checks(sizes, form, fields)


def _size(topic, path, get, message):
    """Check the lengths of the arrays a path leads to."""
    limit = topic.sizes[path]
    outside = [n for n in map(len, get(message)) if not limit.low <= n <= limit.high]
    allowed = f'{limit.low} to {limit.high} elements'
    return [Violation(topic.name, path, f'{n} long', allowed) for n in outside]


def _joint_names(topic, names, message):
    """Check the names of a JointState, and that every array has one number per name."""
    if len(message.name) != len(names) or list(message.name) != names:
        given = f'{len(message.name)} long: {", ".join(message.name[: len(names)])}'
        return [Violation(topic.name, 'name', given, ', '.join(names))]
    lengths = {array: len(getattr(message, array)) for array in JOINT_ARRAYS}
    return [
        Violation(topic.name, array, f'{length} long', f'{len(names)} elements')
        for array, length in lengths.items()
        if length != len(names)
    ]


def _finite_joints(topic, message):
    """Check the unused numbers of a JointState too: NaN in them disturbs plots and viewers."""
    return [
        Violation(topic.name, array, 'not finite', 'finite numbers')
        for array in JOINT_ARRAYS
        if not all(map(math.isfinite, getattr(message, array)))
    ]


def _header(topic, path, get, message):
    """Check frame and stamp of the headers a path leads to; ROS reads a stamp of 0 as no time.

    The poses of a planner may leave both out: the frame is then that of the message.
    """
    violations, is_pose = [], path == POSE_HEADERS
    for header in get(message):
        if header.frame_id != topic.frame and not (is_pose and not header.frame_id):
            frames = repr(header.frame_id), repr(topic.frame)
            violations.append(Violation(topic.name, f'{path}.frame_id', *frames))
        is_zero = header.stamp.sec == 0 == header.stamp.nanosec
        if header.stamp.sec < 0 or (is_zero and not is_pose):
            stamp = f'{header.stamp.sec}.{header.stamp.nanosec:09d} s'
            violations.append(Violation(topic.name, f'{path}.stamp', stamp, 'above 0 s'))
    return violations


def _child_frame(topic, message):
    """Check the child frame of an Odometry."""
    frame = message.child_frame_id
    if frame == topic.child_frame:
        return []
    return [Violation(topic.name, 'child_frame_id', repr(frame), repr(topic.child_frame))]


def _range(topic, path, get, message):
    """Check the range of every number a path leads to; NaN is in no range."""
    field = topic.fields[path]
    low, high = field.low, field.high
    outside = [value for value in get(message) if not low <= value <= high]
    return [_out_of_range(topic, path, field, outside[0])] if outside else outside


def _joint_getter(topic, path):
    (step,) = field_paths.parse(path)
    index = topic.joints.index(step.selector)
    return lambda message: (getattr(message, step.attribute)[index],)


def _diagnostic_values(topic) -> Check:
    """Check keys and numbers of every KeyValue of a DiagnosticArray."""
    patterns = {field_paths.parse(path)[1].selector: path for path in topic.fields}

    @lru_cache(_CACHED_KEYS)
    def path_of(key):
        return next((p for pattern, p in patterns.items() if fnmatchcase(key, pattern)), None)

    def run(message):
        pairs = [pair for status in message.status for pair in status.values]
        return [v for pair in pairs for v in _check_pair(topic, path_of(pair.key), pair)]

    return run


def _check_pair(topic, path, pair):
    if path is None:
        return [Violation(topic.name, f'key {pair.key!r}', 'unknown', 'the keys of topics.yaml')]
    field = topic.fields[path]
    if field.unit == WORD:
        return []
    value = conversions.text_to_value(pair.value)
    if not isinstance(value, str) and field.low <= value <= field.high:
        return []
    return [_out_of_range(topic, pair.key, field, value)]


def _out_of_range(topic, path, field: Field, value):
    allowed = f'{field.low:g} to {field.high:g} {field.unit}'
    return Violation(topic.name, f'{path} ({field.symbol})', value, allowed)
