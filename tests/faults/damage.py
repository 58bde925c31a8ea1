"""What may happen to a message on its way: each kind is a function of the message, in place."""

import array
import copy
import math
from collections.abc import Callable, Iterator
from typing import Any

WILD = 1e12  # no number of the contract is that large
WRONG_FRAME = 'somewhere_else'
WORD = 'soon'
LONG_TEXT = 100_000  # characters
MANY = 100_000  # elements
MANY_NESTED = 20_000  # of those that hold messages with arrays of their own
THOUSAND = 1000
NS_PER_S = 1_000_000_000


def parts(message: Any) -> Iterator[Any]:
    """Yield a message and every message inside it."""
    yield message
    for name in message.get_fields_and_field_types():
        value = getattr(message, name)
        for one in value if isinstance(value, list) else (value,):
            if hasattr(one, 'get_fields_and_field_types'):
                yield from parts(one)


def set_numbers(message: Any, number: float) -> None:
    """Set every number with a fraction, and every text that stands for one."""
    for part in parts(message):
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


def set_words(message: Any) -> None:
    """Put a word where the text may stand for a number."""
    for part in parts(message):
        if part.get_fields_and_field_types().get('value') == 'string':
            part.value = WORD


def set_frames(message: Any) -> None:
    """Give every header, and what else names one, another frame."""
    for part in parts(message):
        for name in ('frame_id', 'child_frame_id'):
            if hasattr(part, name):
                setattr(part, name, WRONG_FRAME)


def shift_stamps(message: Any, shift_s: float) -> None:
    """Move every stamp; none becomes negative."""
    for part in parts(message):
        if part.get_fields_and_field_types().keys() == {'sec', 'nanosec'}:
            moved = max(0, part.sec * NS_PER_S + part.nanosec + round(shift_s * NS_PER_S))
            part.sec, part.nanosec = divmod(moved, NS_PER_S)


def swell(message: Any) -> None:
    """Make it absurdly large: more of its elements, or a long name where it has none."""
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


def thousand(message: Any) -> None:
    """Turn the first obstacle into a thousand."""
    copies = [copy.deepcopy(message.markers[0]) for _ in range(THOUSAND)]
    for number, one in enumerate(copies):
        one.id = number
    message.markers = copies


def gap(message: Any) -> None:
    """Take the middle out of a path."""
    third = len(message.poses) // 3
    message.poses = message.poses[:third] + message.poses[2 * third :]


def kink(message: Any) -> None:
    """Turn the second half of a path to the left by a right angle, in one point."""
    middle = len(message.poses) // 2
    corner = message.poses[middle].pose.position
    x, y = corner.x, corner.y
    for stamped in message.poses[middle:]:
        at = stamped.pose.position
        at.x, at.y = x - (at.y - y), y + (at.x - x)
        q = stamped.pose.orientation
        q.z, q.w = (q.z + q.w) / math.sqrt(2), (q.w - q.z) / math.sqrt(2)


def one_point(message: Any) -> None:
    """Leave the first pose of a path only."""
    message.poses = message.poses[:1]


CHANGES: dict[str, Callable[[Any], None]] = {
    'nan': lambda message: set_numbers(message, math.nan),
    'inf': lambda message: set_numbers(message, math.inf),
    'wild': lambda message: set_numbers(message, WILD),
    'word': set_words,
    'frame': set_frames,
    'huge': swell,
    'thousand': thousand,
    'path_gap': gap,
    'path_kink': kink,
    'path_one_point': one_point,
}
