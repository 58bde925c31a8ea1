"""Check messages against the contract: sizes, names, frames, stamps, ranges and turns. No ROS.

check, check_form   one message of rclpy, rosbags or mcap_ros2, with the reason of every violation
obeys               the numbers of many messages, or of many elements of one, as arrays

What depends on the topic only is computed once, when its first message is checked.
"""

import math
from collections.abc import Iterator, Mapping
from fnmatch import fnmatchcase
from functools import cache, lru_cache
from typing import Any, NamedTuple

import numpy as np

from msgs_yaml import contract, conversions, field_paths, point_cloud
from msgs_yaml.contract import JOINT_ARRAYS, WORD, Field

UNIT_TOLERANCE = 1e-3  # of the squared length of a quaternion
POSE_HEADERS = 'poses[*].header'
ORIENTATION = '.orientation'
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


def check(topic: str, message: Any) -> list[Violation]:
    """Return every violation of the contract in a message of a topic.

    Raises KeyError for a topic that is not in the contract.
    """
    return check_form(topic, message) or [*_checks(topic).numbers(message)]


def check_form(topic: str, message: Any) -> list[Violation]:
    """Return the violations in sizes, names, frames and stamps, whatever the numbers are.

    If a size is wrong, nothing else is checked: an absurdly long message costs no time.
    """
    checks = _checks(topic)
    wrong_size = next(checks.sizes(message), None)
    return [wrong_size] if wrong_size else [*checks.headers(message)]


def obeys(topic: str, numbers: Mapping[str, np.ndarray]) -> np.ndarray:
    """Return for each of n rows whether its numbers are in their ranges, and its pose is turned.

    `numbers` are columns (n,) by their path in the contract. NaN is in no range.
    """
    fields = contract.load().topics[topic].fields
    valid = np.ones(len(next(iter(numbers.values()))), bool)
    for path, column in numbers.items():
        valid &= (fields[path].low <= column) & (column <= fields[path].high)
        if path.endswith(f'{ORIENTATION}.w'):
            with np.errstate(over='ignore'):  # numbers that are too large to square are wrong
                square = sum(numbers[f'{path[:-1]}{axis}'] ** 2 for axis in 'xyzw')
            valid &= np.abs(square - 1.0) <= UNIT_TOLERANCE
    return valid


class _Checks:
    """The checks of one topic; each yields the violations of a message."""

    def __init__(self, name):
        self._topic = topic = contract.load().topics[name]
        self._joints = topic.joints
        # outer arrays before the arrays inside them
        sizes = sorted(topic.sizes.items(), key=lambda item: len(item[0]))
        self._sizes = [(path, size, field_paths.getter(path)) for path, size in sizes]
        paths = _HEADERS.get(topic.type, ('header',))
        self._headers = [(path, field_paths.getter(path)) for path in paths]
        fields = {} if topic.type == contract.DIAGNOSTICS else topic.fields
        self._fields = [(path, field, self._getter(path)) for path, field in fields.items()]
        turns = [path[:-2] for path in fields if path.endswith(f'{ORIENTATION}.w')]
        self._turns = [(path, field_paths.getter(path)) for path in turns]
        self._patterns = {}  # of the keys of diagnostics
        if topic.type == contract.DIAGNOSTICS:
            self._patterns = {field_paths.parse(path)[1].selector: path for path in topic.fields}

        @lru_cache(_CACHED_KEYS)
        def path_of(key):
            patterns = self._patterns.items()
            return next((path for pattern, path in patterns if fnmatchcase(key, pattern)), None)

        self._path_of_key = path_of

    def _getter(self, path):
        is_cloud = self._topic.type == contract.POINT_CLOUD
        if not (self._joints or is_cloud):
            return field_paths.getter(path)
        (step,) = field_paths.parse(path)
        if is_cloud:
            return lambda message: point_cloud.read(message)[step.selector].tolist()
        index = self._joints.index(step.selector)
        return lambda message: (getattr(message, step.attribute)[index],)

    def _violation(self, path, value, allowed):
        return Violation(self._topic.name, path, value, allowed)

    def sizes(self, message) -> Iterator[Violation]:
        """Check the lengths of arrays, and the names of a JointState."""
        for path, (low, high), get in self._sizes:
            for length in map(len, get(message)):
                if not low <= length <= high:
                    yield self._violation(path, f'{length} long', f'{low} to {high} elements')
        joints = self._joints
        if joints and (len(message.name) != len(joints) or tuple(message.name) != joints):
            given = f'{len(message.name)} long: {", ".join(message.name[: len(joints)])}'
            yield self._violation('name', given, ', '.join(joints))
        for array in JOINT_ARRAYS if joints else ():
            length = len(getattr(message, array))
            if length != len(joints):
                yield self._violation(array, f'{length} long', f'{len(joints)} elements')
        if self._topic.type == contract.POINT_CLOUD:
            try:
                point_cloud.read(message)
            except ValueError as error:
                yield self._violation(*error.args)

    def headers(self, message) -> Iterator[Violation]:
        """Check frames and stamps; ROS reads a stamp of 0 as no time.

        The poses of a planner may leave both out: the frame is then that of the message.
        """
        frame = self._topic.frame
        for path, get in self._headers:
            is_pose = path == POSE_HEADERS
            for header in get(message):
                if header.frame_id != frame and not (is_pose and not header.frame_id):
                    yield self._violation(f'{path}.frame_id', repr(header.frame_id), repr(frame))
                is_zero = header.stamp.sec == 0 == header.stamp.nanosec
                if header.stamp.sec < 0 or (is_zero and not is_pose):
                    stamp = f'{header.stamp.sec}.{header.stamp.nanosec:09d} s'
                    yield self._violation(f'{path}.stamp', stamp, 'above 0 s')
        child = self._topic.child_frame
        if child is not None and message.child_frame_id != child:
            yield self._violation('child_frame_id', repr(message.child_frame_id), repr(child))

    def numbers(self, message) -> Iterator[Violation]:
        """Check the range of every number, NaN is in none, and that orientations are turns."""
        # the unused numbers of a JointState too: NaN in them disturbs plots and viewers
        for array in JOINT_ARRAYS if self._joints else ():
            if not all(map(math.isfinite, getattr(message, array))):
                yield self._violation(array, 'not finite', 'finite numbers')
        for path, field, get in self._fields:
            low, high = field.low, field.high
            outside = [value for value in get(message) if not low <= value <= high]
            if outside:
                yield self._out_of_range(path, field, outside[0])
        for path, get in self._turns:
            for q in get(message):
                square = q.x * q.x + q.y * q.y + q.z * q.z + q.w * q.w
                if not abs(square - 1.0) <= UNIT_TOLERANCE:
                    yield self._violation(path, f'of squared length {square:g}', 'length 1')
                    break
        for status in message.status if self._patterns else ():
            for pair in status.values:
                path = self._path_of_key(pair.key)
                if path is None:
                    yield self._violation(f'key {pair.key!r}', 'unknown', 'the keys of topics.yaml')
                    continue
                field, value = self._topic.fields[path], conversions.text_to_value(pair.value)
                if field.unit == WORD or (
                    not isinstance(value, str) and field.low <= value <= field.high
                ):
                    continue
                yield self._out_of_range(pair.key, field, value)

    def _out_of_range(self, path, field: Field, value):
        allowed = f'{field.low:g} to {field.high:g} {field.unit}'
        return self._violation(f'{path} ({field.symbol})', value, allowed)


_checks = cache(_Checks)
