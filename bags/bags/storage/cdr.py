"""Decode CDR (XCDR version 1, as Fast DDS sends it) by the definition text in a bag. No ROS.

A message becomes a named tuple with the fields of the definition, which `msgs_yaml.decode` accepts
like a ROS message. The tests compare it with rosbags, which executes Python that it generates from
the definition. Here a definition from a damaged or hostile bag can only raise BagError.
"""

import struct
from collections import namedtuple
from contextlib import contextmanager
from functools import cache, lru_cache, partial

from bags.errors import BagError
from bags.storage.message_definitions import parse_definition

HEADER = 4  # bytes of encapsulation; alignment counts from its end
ALIGNMENT = 8  # the largest
CODES = {
    'bool': '?', 'byte': 'B', 'char': 'B', 'int8': 'b', 'uint8': 'B', 'int16': 'h', 'uint16': 'H',
    'int32': 'i', 'uint32': 'I', 'int64': 'q', 'uint64': 'Q', 'float32': 'f', 'float64': 'd',
}  # fmt: skip
ORDERS = {b'\x00\x00': '>', b'\x00\x01': '<'}


class Layout:
    """Where the parts of a message are: offsets into its bytes.

    Paths are such as 'pose.pose.position.x' and 'name[0]'.
    """

    def __init__(self, data: bytes, text: str, type_name: str):
        """Read CDR with its encapsulation header; `text` is the definition of `type_name`.

        Raises BagError for all but plain CDR, and when the bytes do not fit the definition.
        """
        order = _byte_order(data)
        self.numbers: dict[str, tuple[int, str]] = {}  # path -> (offset, numpy type)
        self.strings: dict[str, str] = {}  # path -> text
        self.fixed = list(range(HEADER))  # offsets of what determines the others: lengths, texts
        self._data, self._position = data, HEADER
        self._types, self._formats = parse_definition(text, type_name), _formats(order)
        with _misfits_as_bag_error(data, type_name):
            self._message('', '')

    def _message(self, base, path):
        for field in self._types[base]:
            if not field.is_array:
                self._value(field.base, path + field.name)
                continue
            n = self._length() if field.length is None else field.length
            _check_length(n, self._data)
            for i in range(n):
                self._value(field.base, f'{path}{field.name}[{i}]')

    def _value(self, base, path):
        if base in CODES:
            form = self._formats[base]
            self.numbers[path] = _align(self._position, form.size), form.format
            _, self._position = _read_number(form, self._data, self._position)
        elif base == 'string':
            n, begin = self._length(), self._position
            self.strings[path], self._position = _read_text(n, self._data, begin)
            self.fixed += range(begin, begin + n)
        else:
            self._message(base, f'{path}.')

    def _length(self):
        """Return a count, or the length of a text."""
        n, self._position = _read_number(self._formats['uint32'], self._data, self._position)
        self.fixed += range(self._position - 4, self._position)
        return n


def decode(data: bytes, text: str, type_name: str) -> tuple:
    """Return a message, CDR with its encapsulation header, as a named tuple.

    `text` is the definition of `type_name`. Raises BagError as Layout does.
    """
    read = _compile(text, type_name, _byte_order(data))
    with _misfits_as_bag_error(data, type_name):
        return read(data, HEADER)[0]


def _byte_order(data):
    order = ORDERS.get(bytes(data[:2]))
    if order is None or len(data) < HEADER:
        raise BagError(f'not plain CDR: it starts with {bytes(data[:HEADER]).hex(" ")!r}')
    return order


@contextmanager
def _misfits_as_bag_error(data, type_name):
    try:
        yield
    except (struct.error, UnicodeDecodeError) as error:
        raise BagError(f'{type_name}: {len(data)} bytes do not fit its definition') from error


# Below, a reader is a function of the bytes and a position in them; it returns the value there and
# the position behind it.


def _align(position, size):
    """Return the first multiple of `size`, a power of two, counted from the end of the header."""
    return HEADER + (position - HEADER + size - 1 & -size)


def _check_length(n, data):
    if n > len(data):
        raise struct.error('more items than bytes')


def _read_number(form, data, position):
    position = _align(position, form.size)
    return form.unpack_from(data, position)[0], position + form.size


def _read_text(n, data, begin):
    end = begin + n
    if end > len(data):
        raise struct.error('string longer than the message')
    # the length counts the closing zero byte
    return str(data[begin : begin + max(n - 1, 0)], 'utf-8'), end


@lru_cache(maxsize=64)
def _compile(text, type_name, order):
    """Return the reader of a message."""
    types, formats = parse_definition(text, type_name), _formats(order)
    count = formats['uint32']

    def read_text(data, position):
        n, position = _read_number(count, data, position)
        return _read_text(n, data, position)

    # of the types a message consists of, each once: a hostile definition may use one very often
    @cache
    def reader(base):
        if base == 'string':
            return read_text
        if base in CODES:
            return partial(_read_number, formats[base])
        fields = types[base]
        # a field with a reserved name such as `from` is renamed: no decoder needs it
        make = namedtuple('Message', [field.name for field in fields], rename=True)._make
        if all(field.base in CODES and not field.is_array for field in fields):
            return _numbers_reader(order, [CODES[field.base] for field in fields], make)
        readers = [array_reader(f) if f.is_array else reader(f.base) for f in fields]

        def read(data, position):
            values = []
            for read_field in readers:
                value, position = read_field(data, position)
                values.append(value)
            return make(values), position

        return read

    def array_reader(field):
        read_item, form = reader(field.base), formats.get(field.base)

        def read(data, position):
            n = field.length
            if n is None:
                n, position = _read_number(count, data, position)
            _check_length(n, data)
            if form and n:
                begin = _align(position, form.size)
                values = struct.unpack_from(f'{order}{n}{CODES[field.base]}', data, begin)
                return list(values), begin + n * form.size
            items = []
            for _ in range(n):
                item, position = read_item(data, position)
                items.append(item)
            return items, position

        return read

    return reader('')


def _numbers_reader(order, codes, make):
    """Return the reader of a message of numbers only, which reads all of them at once."""
    forms = []
    for begin in range(ALIGNMENT):
        text, end = order, begin
        for code in codes:
            size = struct.calcsize(order + code)
            padding = -end % size
            text, end = f'{text}{padding}x{code}', end + padding + size
        forms.append(struct.Struct(text))

    def read(data, position):
        form = forms[(position - HEADER) % ALIGNMENT]
        return make(form.unpack_from(data, position)), position + form.size

    return read


@lru_cache
def _formats(order):
    return {base: struct.Struct(order + code) for base, code in CODES.items()}
