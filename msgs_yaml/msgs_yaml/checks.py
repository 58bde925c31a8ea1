"""The single checks of a topic, each a function of a message that returns its violations.

Everything that depends on the topic only is prepared when the check is made.
"""

import math
from collections.abc import Callable
from functools import lru_cache
from typing import Any, NamedTuple

from msgs_yaml import paths, words
from msgs_yaml.contract import WORD, Field, Topic

_JOINT_ARRAYS = ('position', 'velocity', 'effort')
_REMEMBERED_KEYS = 4096


class Violation(NamedTuple):
    """One breach of the contract."""

    topic: str
    field: str  # path in the message
    found: Any
    allowed: str

    def __str__(self):
        return f'{self.topic}: {self.field} is {self.found}; allowed {self.allowed}'


Check = Callable[[Any], list[Violation]]


def size(topic: Topic, path: str) -> Check:
    """Check the lengths of the arrays a path leads to."""
    get, limit = paths.getter(path), topic.sizes[path]
    allowed = f'{limit.low} to {limit.high} elements'

    def run(message):
        lengths = map(len, get(message))
        outside = [n for n in lengths if not limit.low <= n <= limit.high]
        return [Violation(topic.name, path, f'{n} long', allowed) for n in outside]

    return run


def joints(topic: Topic) -> Check:
    """Check the names of a JointState, and that every array has one number per name."""
    names = list(topic.joints)

    def run(message):
        if len(message.name) != len(names) or list(message.name) != names:
            found = f'{len(message.name)} long: {", ".join(message.name[: len(names)])}'
            return [Violation(topic.name, 'name', found, ', '.join(names))]
        lengths = {array: len(getattr(message, array)) for array in _JOINT_ARRAYS}
        return [
            Violation(topic.name, array, f'{length} long', f'{len(names)} elements')
            for array, length in lengths.items()
            if length != len(names)
        ]

    return run


def finite_joints(topic: Topic) -> Check:
    """Check the unused places of a JointState too: NaN there breaks plots and viewers."""

    def run(message):
        return [
            Violation(topic.name, array, 'not finite', 'finite numbers')
            for array in _JOINT_ARRAYS
            if not all(map(math.isfinite, getattr(message, array)))
        ]

    return run


def header(topic: Topic, path: str) -> Check:
    """Check frame and stamp of the headers a path leads to; ROS takes 0 as no time."""
    get = paths.getter(path)

    def run(message):
        violations = []
        for one in get(message):
            if one.frame_id != topic.frame:
                found, allowed = repr(one.frame_id), repr(topic.frame)
                violations.append(Violation(topic.name, f'{path}.frame_id', found, allowed))
            if one.stamp.sec < 0 or one.stamp.sec == 0 == one.stamp.nanosec:
                found = f'{one.stamp.sec}.{one.stamp.nanosec:09d} s'
                violations.append(Violation(topic.name, f'{path}.stamp', found, 'above 0 s'))
        return violations

    return run


def child_frame(topic: Topic) -> Check:
    """Check the child frame of an Odometry."""

    def run(message):
        found = message.child_frame_id
        if found == topic.child_frame:
            return []
        return [Violation(topic.name, 'child_frame_id', repr(found), repr(topic.child_frame))]

    return run


def field(topic: Topic, path: str) -> Check:
    """Check the range of every number a path leads to; NaN is in no range."""
    get = _joint_getter(topic, path) if topic.joints else paths.getter(path)
    low, high = topic.fields[path].low, topic.fields[path].high
    label, allowed = _label(path, topic.fields[path])

    def run(message):
        bad = [value for value in get(message) if not low <= value <= high]
        return [Violation(topic.name, label, bad[0], allowed)] if bad else bad

    return run


def values(topic: Topic) -> Check:
    """Check keys and numbers of every KeyValue of a DiagnosticArray."""
    patterns = {paths.parse(path)[1].selector: path for path in topic.fields}

    @lru_cache(_REMEMBERED_KEYS)
    def path_of(key):
        return next((p for pattern, p in patterns.items() if paths.fits(key, pattern)), None)

    def run(message):
        pairs = [pair for status in message.status for pair in status.values]
        return [v for pair in pairs for v in _pair(topic, path_of(pair.key), pair)]

    return run


def _pair(topic, path, pair):
    if path is None:
        return [Violation(topic.name, f'key {pair.key!r}', 'unknown', 'the keys of topics.yaml')]
    one = topic.fields[path]
    if one.unit == WORD:
        return []
    value = words.read(pair.value)
    if not isinstance(value, str) and one.low <= value <= one.high:
        return []
    label, allowed = _label(pair.key, one)
    return [Violation(topic.name, label, value, allowed)]


def _label(path, one: Field):
    return f'{path} ({one.symbol})', f'{one.low:g} to {one.high:g} {one.unit}'


def _joint_getter(topic, path):
    (step,) = paths.parse(path)
    place = topic.joints.index(step.selector)
    return lambda message: (getattr(message, step.attribute)[place],)
