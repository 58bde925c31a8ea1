"""Damage to messages: what becomes of the bytes of one, now or later.

CHANGES are functions that change a message in place; `make_effect` returns what a relay does.
"""

import array
import copy
import math
from collections.abc import Callable, Iterator
from functools import partial
from itertools import count
from typing import Any

from rclpy.serialization import deserialize_message, serialize_message

WILD = 1e12  # beyond every range of the contract
WRONG_FRAME = 'somewhere_else'
LONG_TEXT = 100_000  # characters
MANY = 100_000  # elements
MANY_NESTED = 2_000  # elements that contain arrays themselves
THOUSAND = 1000
NS_PER_S = 1_000_000_000
HUGE_EVERY = 50  # messages: a DDS writer cannot handle more

# (bytes, type, whether the fault is on) -> what leaves instead of a message: delay [s], bytes
Effect = Callable[[bytes, type, bool], list[tuple[float, bytes]]]


def nested_messages(message: Any) -> Iterator[Any]:
    """Yield a message and every message inside it."""
    yield message
    for name in message.get_fields_and_field_types():
        value = getattr(message, name)
        for item in value if isinstance(value, list) else (value,):
            if hasattr(item, 'get_fields_and_field_types'):
                yield from nested_messages(item)


def set_numbers(message: Any, number: float) -> None:
    """Set every float, and every text that represents a number."""
    for part in nested_messages(message):
        for name, kind in part.get_fields_and_field_types().items():
            value = getattr(part, name)
            if isinstance(value, float):
                setattr(part, name, number)
            elif isinstance(value, array.array) and value.typecode in 'fd':
                setattr(part, name, array.array(value.typecode, [number] * len(value)))
            elif hasattr(value, 'dtype'):
                value[:] = number
            elif name == 'value' and kind == 'string':
                part.value = str(number)


def set_frames(message: Any) -> None:
    """Set every frame_id and child_frame_id to another frame."""
    for part in nested_messages(message):
        for name in ('frame_id', 'child_frame_id'):
            if hasattr(part, name):
                setattr(part, name, WRONG_FRAME)


def shift_stamps(message: Any, shift_s: float) -> None:
    """Shift every stamp; stamps do not become negative."""
    for part in nested_messages(message):
        if part.get_fields_and_field_types().keys() == {'sec', 'nanosec'}:
            moved = max(0, part.sec * NS_PER_S + part.nanosec + round(shift_s * NS_PER_S))
            part.sec, part.nanosec = divmod(moved, NS_PER_S)


def enlarge(message: Any) -> None:
    """Enlarge a message: many more elements, or a long frame_id where it has none."""
    if hasattr(message, 'poses'):
        message.poses = _repeated(message.poses, MANY)
    elif hasattr(message, 'markers'):
        message.markers = _repeated(message.markers, MANY_NESTED)
    elif hasattr(message, 'status'):
        message.status[0].values = _repeated(message.status[0].values, MANY_NESTED)
    elif hasattr(message, 'effort'):
        for name in ('name', 'position', 'velocity', 'effort'):
            setattr(message, name, _repeated(getattr(message, name), MANY))
    else:
        message.header.frame_id = 'x' * LONG_TEXT


def _repeated(elements, count):
    return (elements * (count // max(len(elements), 1) + 1))[:count]


def multiply_obstacles(message: Any) -> None:
    """Replace the obstacles by a thousand copies of the first one."""
    copies = [copy.deepcopy(message.markers[0]) for _ in range(THOUSAND)]
    for number, marker in enumerate(copies):
        marker.id = number
    message.markers = copies


def cut_middle(message: Any) -> None:
    """Remove the middle third of a path."""
    third = len(message.poses) // 3
    message.poses = message.poses[:third] + message.poses[2 * third :]


def bend(message: Any) -> None:
    """Rotate the second half of a path about its first point by 90 degrees to the left."""
    middle = len(message.poses) // 2
    corner = message.poses[middle].pose.position
    x, y = corner.x, corner.y
    for stamped in message.poses[middle:]:
        at = stamped.pose.position
        at.x, at.y = x - (at.y - y), y + (at.x - x)
        q = stamped.pose.orientation
        q.z, q.w = (q.z + q.w) / math.sqrt(2), (q.w - q.z) / math.sqrt(2)


def keep_first_pose(message: Any) -> None:
    """Remove all poses of a path but the first."""
    message.poses = message.poses[:1]


CHANGES: dict[str, Callable[[Any], None]] = {
    'nan': lambda message: set_numbers(message, math.nan),
    'inf': lambda message: set_numbers(message, math.inf),
    'wild': lambda message: set_numbers(message, WILD),
    'frame': set_frames,
    'thousand': multiply_obstacles,
    'path_gap': cut_middle,
    'path_kink': bend,
    'path_one_point': keep_first_pose,
}


def swap() -> Effect:
    """Return an effect that swaps each pair of messages."""
    waiting: list[bytes] = []

    def swapped(raw, kind, is_active):
        waiting.append(raw)
        if is_active and len(waiting) == 1:
            return []
        pair = [*waiting[::-1]] if is_active else [*waiting]
        waiting.clear()
        return [(0.0, one) for one in pair]

    return swapped


def enlarging(every: int) -> Effect:
    """Return an effect that sends a huge message instead of `every` messages.

    It is made once, which takes longer than a tick.
    """
    huge, number = [], count(1)

    def enlarged(raw, kind, is_active):
        if not is_active:
            return [(0.0, raw)]
        huge.extend([] if huge else [_changed(enlarge, raw, kind)])
        return [] if next(number) % every else [(0.0, huge[0])]

    return enlarged


def make_effect(
    do: str, delay_s: float = 0.0, shift_s: float = 0.0, rate_hz: float = 0.0
) -> Effect:
    """Return the effect of a word of the catalogue on a topic of some rate."""
    if do == 'reorder':
        return swap()
    if do == 'huge':
        return enlarging(HUGE_EVERY if rate_hz > 100.0 else 1)
    sent = {
        'delay': lambda raw, kind: [(delay_s, raw)],
        'drop': lambda raw, kind: [],
        'duplicate': lambda raw, kind: 2 * [(0.0, raw)],
        'torn': lambda raw, kind: [(0.0, raw[: len(raw) // 2])],
        'empty': lambda raw, kind: [(0.0, serialize_message(kind()))],
    }
    change = CHANGES | {'stamp': partial(shift_stamps, shift_s=shift_s)}
    during = sent.get(do) or (lambda raw, kind: [(0.0, _changed(change[do], raw, kind))])
    return lambda raw, kind, is_active: during(raw, kind) if is_active else [(0.0, raw)]


def _changed(change, raw, kind):
    message = deserialize_message(raw, kind)
    change(message)
    return serialize_message(message)
