"""Does a message obey the contract? Sizes, names, frames, stamps and ranges; fast and ROS-free.

Works on messages of rclpy, rosbags and mcap_ros2 alike.
"""

from functools import cache
from typing import Any, NamedTuple

from msgs_yaml import checks, contract
from msgs_yaml.checks import Check, Violation
from msgs_yaml.contract import Topic

_HEADERS = {
    'nav_msgs/msg/Path': ('header', 'poses[*].header'),
    'visualization_msgs/msg/MarkerArray': ('markers[*].header',),
    'rosgraph_msgs/msg/Clock': (),
}


def check(topic: str, message: Any) -> list[Violation]:
    """Return every breach of the contract in a message of a topic.

    Raises KeyError for a topic that the contract does not know.
    """
    return check_form(topic, message) or _run(_prepared(topic).fields, message)


def check_form(topic: str, message: Any) -> list[Violation]:
    """Return what is wrong with sizes, names, frames and stamps, whatever the numbers are.

    Sizes come first, and alone if one is wrong: an absurdly long message costs no time.
    """
    prepared = _prepared(topic)
    for one in prepared.sizes:
        violations = one(message)
        if violations:
            return violations
    return _run(prepared.form, message)


class _Prepared(NamedTuple):
    sizes: tuple[Check, ...]
    form: tuple[Check, ...]
    fields: tuple[Check, ...]


def _run(several, message):
    return [violation for one in several for violation in one(message)]


@cache
def _prepared(name):
    topic = contract.load().topics[name]
    return _Prepared(tuple(_sizes(topic)), tuple(_form(topic)), tuple(_fields(topic)))


def _sizes(topic: Topic):
    # outer arrays before the arrays inside them
    for path in sorted(topic.sizes, key=len):
        yield checks.size(topic, path)
    if topic.joints:
        yield checks.joints(topic)


def _form(topic: Topic):
    for path in _HEADERS.get(topic.type, ('header',)):
        yield checks.header(topic, path)
    if topic.child_frame is not None:
        yield checks.child_frame(topic)


def _fields(topic: Topic):
    if topic.type == contract.DIAGNOSTICS:
        yield checks.values(topic)
        return
    if topic.joints:
        yield checks.finite_joints(topic)
    for path in topic.fields:
        yield checks.field(topic, path)
