"""Decode CDR (XCDR version 1, as Fast DDS sends it) by the definition text in a bag. No ROS.

A message becomes a named tuple with the fields of the definition, which `msgs_yaml.decode` accepts
like a ROS message. The tests compare it with rosbags, which executes Python that it generates from
the definition. Here a definition from a damaged or hostile bag can only raise BagError.
"""

import struct
from collections import namedtuple
from functools import lru_cache

from bags.errors import BagError
from bags.storage.message_definitions import parse_definition

HEADER = 4  # bytes of encapsulation; alignment counts from its end
CODES = {
    'bool': '?', 'byte': 'B', 'char': 'B', 'int8': 'b', 'uint8': 'B', 'int16': 'h', 'uint16': 'H',
    'int32': 'i', 'uint32': 'I', 'int64': 'q', 'uint64': 'Q', 'float32': 'f', 'float64': 'd',
}  # fmt: skip
ORDERS = {b'\x00\x00': '>', b'\x00\x01': '<'}


class Message:
    """A message as `value`, and where its parts are: offsets into the bytes.

    Paths are such as 'pose.pose.position.x' and 'name[0]'.
    """

    def __init__(self, data: bytes, text: str, type_name: str):
        """Decode CDR with its encapsulation header; `text` is the definition of `type_name`.

        Raises BagError for all but plain CDR, and when the bytes do not fit the definition.
        """
        order = ORDERS.get(bytes(data[:2]))
        if order is None or len(data) < HEADER:
            raise BagError(f'not plain CDR: it starts with {bytes(data[:HEADER]).hex(" ")!r}')
        self.numbers: dict[str, tuple[int, str]] = {}  # path -> (offset, numpy type)
        self.strings: dict[str, str] = {}  # path -> text
        self.fixed = list(range(HEADER))  # offsets of what determines the others: lengths, texts
        self._data, self._position = data, HEADER
        self._types, self._formats = _compile(text, type_name), _formats(order)
        try:
            self.value = self._message('', '')
        except (struct.error, UnicodeDecodeError) as error:
            raise BagError(f'{type_name}: {len(data)} bytes do not fit its definition') from error

    def _message(self, base, path):
        fields, make = self._types[base]
        return make([self._field(field, path + field.name) for field in fields])

    def _field(self, field, path):
        if not field.is_array:
            return self._value(field.base, path)
        n = self._length() if field.length is None else field.length
        if n > len(self._data):
            raise struct.error('more items than bytes')
        return [self._value(field.base, f'{path}[{i}]') for i in range(n)]

    def _value(self, base, path):
        if base in CODES:
            form = self._formats[base]
            self.numbers[path] = self._align(form.size), form.format
            return self._number(form)
        if base != 'string':
            return self._message(base, f'{path}.')
        n, begin = self._length(), self._position
        self._position += n
        if self._position > len(self._data):
            raise struct.error('string longer than the message')
        self.fixed += range(begin, begin + n)
        # the length counts the closing zero byte
        self.strings[path] = str(self._data[begin : begin + max(n - 1, 0)], 'utf-8')
        return self.strings[path]

    def _length(self):
        """Return a count, or the length of a text."""
        begin = self._align(4)
        self.fixed += range(begin, begin + 4)
        return self._number(self._formats['uint32'])

    def _align(self, size):
        """Advance to the first multiple of `size`, a power of two; return the offset."""
        self._position = HEADER + (self._position - HEADER + size - 1 & -size)
        return self._position

    def _number(self, form):
        begin = self._position
        self._position += form.size
        return form.unpack_from(self._data, begin)[0]


def decode(data: bytes, text: str, type_name: str) -> tuple:
    """Return the message in `data` as a named tuple; see Message."""
    return Message(data, text, type_name).value


@lru_cache(maxsize=64)
def _compile(text, type_name):
    """Return the fields of each type, and what makes a named tuple of their values."""
    # a field with a reserved name such as `from` is renamed: no decoder needs it
    return {
        name: (fields, namedtuple('Message', [field.name for field in fields], rename=True)._make)
        for name, fields in parse_definition(text, type_name).items()
    }


@lru_cache
def _formats(order):
    return {base: struct.Struct(order + code) for base, code in CODES.items()}
