"""Definitions of messages, and CDR (XCDR version 1, as Fast DDS sends it) decoded by them. No ROS.

Texts ('ros2msg') and hashes come from the installed message packages (share/<package>/msg). A text
has the order of rosbag2: the message, then every type it needs, depth first, sorted by name, each
once, under a line of 80 equal signs. The decoder reads the text that a bag carries, and trusts
nothing: a definition from a damaged or hostile bag can only raise BagError.

A message becomes a named tuple with the fields of the definition, which `msgs_yaml.decode` accepts
like a ROS message. The tests compare it with rosbags, which executes Python that it generates from
the definition.
"""

import json
import re
import struct
from collections import namedtuple
from functools import lru_cache
from typing import NamedTuple

from bags.errors import BagError
from msgs_yaml import share

HEADER = 4  # bytes of encapsulation; alignment counts from its end
# of numbers, for `struct`
CODES = {
    'bool': '?', 'byte': 'B', 'char': 'B', 'int8': 'b', 'uint8': 'B', 'int16': 'h', 'uint16': 'H',
    'int32': 'i', 'uint32': 'I', 'int64': 'q', 'uint64': 'Q', 'float32': 'f', 'float64': 'd',
}  # fmt: skip
FORMATS = {  # by the first bytes of a message, which say the order of its bytes
    head: {base: struct.Struct(order + code) for base, code in CODES.items()}
    for head, order in {b'\x00\x00': '>', b'\x00\x01': '<'}.items()
}
PRIMITIVES = {*CODES, 'string', 'wstring'}
SEPARATOR = '=' * 80
FIELD = re.compile(
    r'(?P<base>[\w/]+)(?:<=\d+)?'
    r'(?P<array>\[(?:(?P<bound><=)?(?P<length>[1-9]\d{0,8}))?\])?\s+(?P<name>\w+)',
    re.ASCII,
)
TYPE = re.compile(r'\w+/(?:msg/)?\w+', re.ASCII)
DEEPEST = 32  # messages in messages; those of ROS have 5


class Field(NamedTuple):
    """One field of a message."""

    name: str
    base: str  # a primitive or 'package/Name'
    is_array: bool
    length: int | None  # of an array of fixed length


# the field that ROS 2 gives a message without fields, one byte in CDR
FILLER = Field('structure_needs_at_least_one_member', 'uint8', False, None)


def schema_text(type_name: str) -> str:
    """Return the definition of `type_name` ('package/msg/Name') with all it depends on.

    Raises FileNotFoundError, naming the places searched, when a package is not installed.
    """
    return _expand(type_name, seen=set())


def type_hash(type_name: str) -> str:
    """Return the hash of REP 2011 ('RIHS01_...') that the generator of messages computed.

    Raises FileNotFoundError when the package is not installed.
    """
    entries = json.loads(_read(type_name, 'json'))['type_hashes']
    return {entry['type_name']: entry['hash_string'] for entry in entries}[type_name]


def _read(type_name, kind):
    package, *_, name = type_name.split('/')
    return share.path(package, 'msg', f'{name}.{kind}').read_text(encoding='utf-8')


def _expand(type_name, seen):
    parts = [_read(type_name, 'msg')]
    for base in sorted({field.base for field in _fields(parts[0], type_name)} - PRIMITIVES):
        if base not in seen:
            seen.add(base)
            parts += [f'\n{SEPARATOR}\nMSG: {base}\n', _expand(base, seen)]
    return ''.join(parts)


@lru_cache(maxsize=64)
def _types(text, type_name):
    """Return what makes a message from its values, and its fields, of `type_name` (key '').

    And of all types it needs (key 'package/Name'). Raises BagError for a line that is no field, and
    for a type that is missing, contains itself, is nested too deeply or has wide characters, which
    are not supported.
    """
    first, *others = re.split(rf'^{SEPARATOR}\nMSG: ', text, flags=re.MULTILINE)
    types = {'': _fields(first, type_name)}
    for section in others:
        name, _, body = section.partition('\n')
        types[name.strip().replace('/msg/', '/')] = _fields(body, name.strip())
    for fields in types.values():
        for field in fields:
            if field.base not in PRIMITIVES and field.base not in types:
                raise BagError(f'definition of {type_name}: {field.base} is not in it')
            if field.base == 'wstring':
                raise BagError(f'definition of {type_name}: {field.name} has wide characters')

    done = set()

    def visit(name, above):
        if name in above:
            raise BagError(f'definition of {type_name}: {name} contains itself')
        if len(above) > DEEPEST:
            raise BagError(f'definition of {type_name}: {name} is nested too deeply')
        if name not in done:
            for field in types[name]:
                if field.base not in PRIMITIVES:
                    visit(field.base, {*above, name})
            done.add(name)

    visit('', set())
    # a field with a reserved name such as `from` is renamed: no decoder needs it
    return {
        name: (namedtuple('Message', [f.name for f in fields], rename=True)._make, fields)
        for name, fields in types.items()
    }


def _fields(text, type_name):
    """Return the fields in the text of one type, from which other types may have their package."""
    if not TYPE.fullmatch(type_name):
        raise BagError(f'{type_name!r} is no message type; allowed package/msg/Name')
    fields = []
    for line in text.splitlines():
        code = line.partition('#')[0].strip()
        match = FIELD.match(code)
        if code and not match:
            raise BagError(f'{line!r} is no field of a message')
        # a constant has the form of a field and then '='
        if not code or code[match.end() :].lstrip().startswith('='):
            continue
        base = match['base']
        if base not in PRIMITIVES:
            package, slash, name = base.replace('/msg/', '/').rpartition('/')
            base = f'{package if slash else type_name.split("/")[0]}/{name}'
        fixed = match['length'] if match['length'] and not match['bound'] else None
        fields.append(Field(match['name'], base, match['array'] is not None, fixed and int(fixed)))
    return tuple(fields) or (FILLER,)


class Layout:
    """A message, and where its parts are: offsets into its bytes.

    Paths are such as 'pose.pose.position.x' and 'name[0]'.
    """

    def __init__(self, data: bytes, text: str, type_name: str, is_noted: bool = True):
        """Read CDR with its encapsulation header; `text` is the definition of `type_name`.

        Without `is_noted` there is only the value. Raises BagError for all but plain CDR, and when
        the bytes do not fit the definition.
        """
        formats = FORMATS.get(bytes(data[:2]))
        if formats is None or len(data) < HEADER:
            raise BagError(f'not plain CDR: it starts with {bytes(data[:HEADER]).hex(" ")!r}')
        self.numbers: dict[str, tuple[int, str]] = {}  # path -> (offset, numpy type)
        self.strings: dict[str, str] = {}  # path -> text
        self.fixed = list(range(HEADER))  # offsets of what determines the others: lengths, texts
        self._data, self._position, self._is_noted = data, HEADER, is_noted
        self._types, self._formats = _types(text, type_name), formats
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
