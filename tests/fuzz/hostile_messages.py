"""Hostile messages: valid messages with errors in one or more fields."""

import array
import copy
import math
import struct
from typing import Any

from hypothesis import strategies as st

from node_runtime import ros

NUMBERS = (math.nan, math.inf, -math.inf, 0.0, -0.0, 1e308, -1e308, 5e-324, 1e12, -1.0, 0.5)
WHOLE = (0, 1, -1, 2, 3, 255, 2**31 - 1, -(2**31), 2**32 - 1, 10**9)
WIDTHS = {'uint8': 'B', 'int8': 'b', 'uint32': 'I', 'int32': 'i', 'octet': 'B', 'byte': 'B'}
TEXTS = ('', 'map', 'base_link', 'x' * 300, 'left', 'velocity', 'nan', '\x01', 'ü', 'steer')
COUNTS = (0, 1, 2, 3, 17, 401, 5001)
WRONG_COUNTS = (0, 1, 2, 255, 65535, 2**31 - 1, 2**32 - 1)  # of elements, where a word is that


def places(message: Any) -> list[tuple[Any, str]]:
    """Return every (message, field) in a message that holds no single message."""
    found = []
    for name in message.get_fields_and_field_types():
        value = getattr(message, name)
        if hasattr(value, 'get_fields_and_field_types'):
            found += places(value)
            continue
        found.append((message, name))
        if isinstance(value, list):
            found += [place for one in value if hasattr(one, 'SLOT_TYPES') for place in places(one)]
    return found


def edit_field(message: Any, place: int, choice: int) -> None:
    """Set one field to a wrong value; integers wrap as their type does."""
    everywhere = places(message)
    part, name = everywhere[place % len(everywhere)]
    kind = part.get_fields_and_field_types()[name]
    setattr(part, name, _wrong(getattr(part, name), kind, choice))


def _wrong(value, kind, choice):
    if isinstance(value, bool):
        return not value
    if isinstance(value, float):
        return NUMBERS[choice % len(NUMBERS)]
    if isinstance(value, int):
        low = struct.pack('<q', WHOLE[choice % len(WHOLE)])
        return struct.unpack_from(f'<{WIDTHS[kind]}', low)[0]
    if isinstance(value, str):
        return TEXTS[choice % len(TEXTS)]
    if isinstance(value, bytes):
        return bytes([choice % 256])
    if isinstance(value, array.array) and choice % 2 and len(value):
        edited = array.array(value.typecode, value)
        whole, number = value.typecode == 'B', NUMBERS[choice % len(NUMBERS)]
        edited[choice % len(value)] = choice // 2 % 256 if whole else number
        return edited
    if hasattr(value, 'dtype'):  # of fixed size
        edited = value.copy()
        edited[choice % len(edited)] = NUMBERS[choice % len(NUMBERS)]
        return edited
    count = COUNTS[choice % len(COUNTS)]
    return (value * (count // max(len(value), 1) + 1))[:count]


def corrupt_bytes(raw: bytes, at: int, wrong: int, keep: int) -> bytes:
    """Return serialised bytes with one wrong word, cut off after `keep` bytes."""
    data = bytearray(raw)
    place = 4 + at % max(len(data) - 8, 1) // 4 * 4
    struct.pack_into('<I', data, place, WRONG_COUNTS[wrong % len(WRONG_COUNTS)])
    return bytes(data[: keep % (2 * len(data)) + 1])


def changes() -> st.SearchStrategy[list | tuple | bytes]:
    """Return a strategy of changes of any message, see `changed`."""
    number, place = st.integers(0, 99999), st.integers(0, 9999)
    edits = st.lists(st.tuples(place, place), min_size=1, max_size=4)
    return st.one_of(edits, st.tuples(number, number, number), st.binary(max_size=64))


def changed(message: Any, change: list | tuple | bytes) -> bytes:
    """Return the bytes of a message after a change; the message itself stays.

    A list edits fields, a tuple corrupts the bytes, bytes replace the message.
    """
    if isinstance(change, bytes):
        return change
    if isinstance(change, tuple):
        return corrupt_bytes(ros.serialize(message), *change)
    message = copy.deepcopy(message)
    for place, choice in change:
        edit_field(message, place, choice)
    return ros.serialize(message)
