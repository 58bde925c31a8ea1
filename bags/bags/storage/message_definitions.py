"""Message definitions as text with all dependencies ('ros2msg'), their hashes, and their parser.

Texts and hashes come from the installed message packages (share/<package>/msg). A text has the
order of rosbag2: the message, then every type it needs, depth first, sorted by name, each once,
under a line of 80 equal signs. The parser reads the text that a bag carries, and trusts nothing.
"""

import json
import re
from functools import lru_cache
from typing import NamedTuple

from bags.errors import BagError
from msgs_yaml import share

# of numbers, for `struct`
CODES = {
    'bool': '?', 'byte': 'B', 'char': 'B', 'int8': 'b', 'uint8': 'B', 'int16': 'h', 'uint16': 'H',
    'int32': 'i', 'uint32': 'I', 'int64': 'q', 'uint64': 'Q', 'float32': 'f', 'float64': 'd',
}  # fmt: skip
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


def split_type(type_name: str) -> tuple[str, str]:
    """Return package and message name of 'package/msg/Name' or 'package/Name'."""
    package, *_, name = type_name.split('/')
    return package, name


def schema_text(type_name: str) -> str:
    """Return the definition of `type_name` ('package/msg/Name') with all it depends on.

    Raises FileNotFoundError, naming the places searched, when a package is not installed.
    """
    return _expand(*split_type(type_name), seen=set())


def type_hash(type_name: str) -> str:
    """Return the hash of REP 2011 ('RIHS01_...') that the generator of messages computed.

    Raises FileNotFoundError when the package is not installed.
    """
    package, name = split_type(type_name)
    path = share.path(package, 'msg', f'{name}.json')
    hashes = json.loads(path.read_text(encoding='utf-8'))['type_hashes']
    return {entry['type_name']: entry['hash_string'] for entry in hashes}[type_name]


def _expand(package, name, seen):
    text = share.path(package, 'msg', f'{name}.msg').read_text(encoding='utf-8')
    parts = [text]
    for dependency in sorted({field.base for field in _fields(text, package)} - PRIMITIVES):
        if dependency not in seen:
            seen.add(dependency)
            parts += [f'\n{SEPARATOR}\nMSG: {dependency}\n', _expand(*split_type(dependency), seen)]
    return ''.join(parts)


@lru_cache(maxsize=64)
def parse_definition(text: str, type_name: str) -> dict[str, tuple[Field, ...]]:
    """Return the fields of `type_name` (key '') and of all types it needs (key 'package/Name').

    Raises BagError for a line that is no field, and for a type that is missing, contains itself, is
    nested too deeply or has wide characters, which are not supported.
    """
    package = _package(type_name)
    first, *others = re.split(rf'^{SEPARATOR}\nMSG: ', text, flags=re.MULTILINE)
    types = {'': _fields(first, package)}
    for section in others:
        name, _, body = section.partition('\n')
        types['/'.join(split_type(name.strip()))] = _fields(body, _package(name.strip()))
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
    return types


def _package(type_name):
    if not TYPE.fullmatch(type_name):
        raise BagError(f'{type_name!r} is no message type; allowed package/msg/Name')
    return split_type(type_name)[0]


def _fields(text, package):
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
            base = '/'.join(split_type(base)) if '/' in base else f'{package}/{base}'
        fixed = match['length'] if match['length'] and not match['bound'] else None
        fields.append(Field(match['name'], base, match['array'] is not None, fixed and int(fixed)))
    return tuple(fields) or (FILLER,)
