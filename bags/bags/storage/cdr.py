"""Decode CDR (XCDR version 1, as Fast DDS sends it) by the definition text in a bag. No ROS.

A message becomes a named tuple with the fields of the definition, which `msgs_yaml.decode` accepts
like a ROS message. The tests compare it with rosbags, which executes Python that it generates from
the definition. Here a definition from a damaged or hostile bag can only raise BagError.
"""

import struct
from collections import namedtuple
from functools import lru_cache

from bags.errors import BagError
from bags.storage.message_definitions import CODES, parse_definition

HEADER = 4  # bytes of encapsulation; alignment counts from its end
ORDERS = {b'\x00\x00': '>', b'\x00\x01': '<'}


class Layout:
    """A message, and where its parts are: offsets into its bytes.

    Paths are such as 'pose.pose.position.x' and 'name[0]'.
    """

    def __init__(self, data: bytes, text: str, type_name: str, is_noted: bool = True):
        """Read CDR with its encapsulation header; `text` is the definition of `type_name`.

        Without `is_noted` there is only the value. Raises BagError for all but plain CDR, and when
        the bytes do not fit the definition.
        """
        order = ORDERS.get(bytes(data[:2]))
        if order is None or len(data) < HEADER:
            raise BagError(f'not plain CDR: it starts with {bytes(data[:HEADER]).hex(" ")!r}')
        self.numbers: dict[str, tuple[int, str]] = {}  # path -> (offset, numpy type)
        self.strings: dict[str, str] = {}  # path -> text
        self.fixed = list(range(HEADER))  # offsets of what determines the others: lengths, texts
        self._data, self._position, self._is_noted = data, HEADER, is_noted
        self._types, self._formats = _types(text, type_name), _formats(order)
        try:
            self.value = self._message('', '')
        except (struct.error, UnicodeDecodeError) as error:
            raise BagError(f'{type_name}: {len(data)} bytes do not fit its definition') from error

    def _message(self, base, path):
        make, fields = self._types[base]
        values = []
        for name, item, is_array, length in fields:
            below = path + name if self._is_noted else ''
            if not is_array:
                values.append(self._value(item, below))
                continue
            n = self._length() if length is None else length
            if n > len(self._data):
                raise struct.error('more items than bytes')
            if self._is_noted:
                values.append([self._value(item, f'{below}[{i}]') for i in range(n)])
            else:
                values.append([self._value(item, '') for _ in range(n)])
        return make(values)

    def _value(self, base, path):
        if base in CODES:
            form = self._formats[base]
            value = self._number(form)
            if self._is_noted:
                self.numbers[path] = self._position - form.size, form.format
            return value
        if base != 'string':
            return self._message(base, f'{path}.' if path else '')
        n, begin = self._length(), self._position
        self._position += n
        if self._position > len(self._data):
            raise struct.error('string longer than the message')
        # the length counts the closing zero byte
        text = str(self._data[begin : begin + max(n - 1, 0)], 'utf-8')
        if self._is_noted:
            self.strings[path] = text
            self.fixed += range(begin, begin + n)
        return text

    def _number(self, form):
        # the first multiple of its size, a power of two, counted from the end of the header
        begin = HEADER + (self._position - HEADER + form.size - 1 & -form.size)
        self._position = begin + form.size
        return form.unpack_from(self._data, begin)[0]

    def _length(self):
        """Return a count, or the length of a text."""
        n = self._number(self._formats['uint32'])
        if self._is_noted:
            self.fixed += range(self._position - 4, self._position)
        return n


def decode(data: bytes, text: str, type_name: str) -> tuple:
    """Return a message, CDR with its encapsulation header, as a named tuple.

    `text` is the definition of `type_name`. Raises BagError as Layout does.
    """
    return Layout(data, text, type_name, is_noted=False).value


@lru_cache(maxsize=64)
def _types(text, type_name):
    """Return what makes a message of each type from its values, and the fields of the type."""
    types = {}
    for base, fields in parse_definition(text, type_name).items():
        # a field with a reserved name such as `from` is renamed: no decoder needs it
        make = namedtuple('Message', [field.name for field in fields], rename=True)._make
        types[base] = make, fields
    return types


@lru_cache
def _formats(order):
    return {base: struct.Struct(order + code) for base, code in CODES.items()}
