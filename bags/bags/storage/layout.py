"""Where the numbers of a message lie, so that thousands of equal ones are read as one array.

Odometry, Imu and JointState with constant names occupy the same bytes in every message of a
topic. The layout is found once per group of equal messages; numpy then views a number of all of
them as one strided column.
"""

import struct
from typing import NamedTuple

import numpy as np

from bags.errors import BagError
from bags.storage.cdr import CODES, HEADER, aligned, byte_order
from bags.storage.definition_text import parse


class Layout(NamedTuple):
    """Offsets into one message: of numbers by their path, as in 'pose.pose.position.x'."""

    numbers: dict[str, tuple[int, str]]  # path -> (offset, numpy type)
    strings: dict[str, str]  # path -> text
    fixed: np.ndarray  # offsets of the bytes that make the layout: lengths and texts


def of(data: bytes, text: str, type_name: str) -> Layout:
    """Return the layout of one message; BagError when the bytes do not fit the definition."""
    walk = _Walk(data, parse(text, type_name))
    try:
        walk.message('', '')
    except (struct.error, UnicodeDecodeError) as error:
        raise BagError(f'{type_name}: {len(data)} bytes do not fit its definition') from error
    return Layout(walk.numbers, walk.strings, np.array(walk.fixed, dtype=np.intp))


def groups(payloads: list[bytes], text: str, type_name: str):
    """Yield (row numbers, (n, bytes) array of uint8, Layout) of messages with equal layout."""
    lengths = np.fromiter(map(len, payloads), dtype=np.int64, count=len(payloads))
    for length in dict.fromkeys(lengths.tolist()):
        rows = np.flatnonzero(lengths == length)
        # one join of the payloads, then no copy per message
        bytes_ = np.frombuffer(b''.join([payloads[i] for i in rows]), dtype=np.uint8)
        bytes_ = bytes_.reshape(len(rows), length)
        while len(rows):
            found = of(payloads[rows[0]], text, type_name)
            same = (bytes_[:, found.fixed] == bytes_[0, found.fixed]).all(axis=1)
            if same.all():
                yield rows, bytes_, found
                break
            yield rows[same], bytes_[same], found
            rows, bytes_ = rows[~same], bytes_[~same]


def column(bytes_: np.ndarray, layout: Layout, path: str) -> np.ndarray:
    """One number of every message, (n,), in its own type."""
    offset, kind = layout.numbers[path]
    width = np.dtype(kind).itemsize
    return np.ascontiguousarray(bytes_[:, offset : offset + width]).view(kind)[:, 0]


class _Walk:
    """One pass over a message, noting where everything is."""

    def __init__(self, data, types):
        self.data, self.types, self.order = data, types, byte_order(data)
        self.position = 0
        self.numbers, self.strings, self.fixed = {}, {}, list(range(HEADER))

    def message(self, base, path):
        for field in self.types[base]:
            name = f'{path}.{field.name}' if path else field.name
            if not field.is_array:
                self.one(field.base, name)
                continue
            n = self.length() if field.length is None else field.length
            if n > len(self.data):
                raise struct.error('more items than bytes')
            for i in range(n):
                self.one(field.base, f'{name}[{i}]')

    def one(self, base, path):
        if base in CODES:
            code = CODES[base]
            begin = aligned(self.position, struct.calcsize(code))
            self.position = begin + struct.calcsize(code)
            if self.position > len(self.data) - HEADER:
                raise struct.error('beyond the end')
            self.numbers[path] = (HEADER + begin, self.order + code)
        elif base == 'string':
            n = self.length()
            begin = HEADER + self.position
            self.position += n
            if self.position > len(self.data) - HEADER:
                raise struct.error('beyond the end')
            self.fixed += range(begin, begin + n)
            self.strings[path] = self.data[begin : begin + max(n - 1, 0)].decode('utf-8')
        else:
            self.message(base, path)

    def length(self):
        """A count or the length of a text; its bytes belong to the layout."""
        begin = aligned(self.position, 4)
        self.position = begin + 4
        self.fixed += range(HEADER + begin, HEADER + begin + 4)
        return struct.unpack_from(self.order + 'I', self.data, HEADER + begin)[0]
