"""Message definitions out of the text that a bag carries ('ros2msg'): types and their fields."""

import re
from functools import lru_cache
from typing import NamedTuple

from bags.errors import BagError
from bags.storage.definitions import PRIMITIVES, SEPARATOR, split

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


# what ROS 2 puts into a message without fields, one byte on the wire
FILLER = Field('structure_needs_at_least_one_member', 'uint8', False, None)


@lru_cache(maxsize=64)
def parse(text: str, type_name: str) -> dict[str, tuple[Field, ...]]:
    """Fields of `type_name` (under '') and of all types it needs (under 'package/Name').

    Raises BagError naming the line that is no field, or the type that is missing, in itself, too
    deep in others, or of wide characters, which nothing here reads.
    """
    package = _package(type_name)
    first, *others = re.split(rf'^{SEPARATOR}\nMSG: ', text, flags=re.MULTILINE)
    types = {'': _fields(first, package)}
    for section in others:
        name, _, body = section.partition('\n')
        types['/'.join(split(name.strip()))] = _fields(body, _package(name.strip()))
    for fields in types.values():
        for field in fields:
            if field.base not in PRIMITIVES and field.base not in types:
                raise BagError(f'definition of {type_name}: {field.base} is not in it')
            if field.base == 'wstring':
                raise BagError(f'definition of {type_name}: {field.name} has wide characters')
    _refuse_circles(types, type_name)
    return types


def _package(type_name):
    if not TYPE.fullmatch(type_name):
        raise BagError(f'{type_name!r} is no message type; allowed package/msg/Name')
    return split(type_name)[0]


def _refuse_circles(types, type_name):
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


def _fields(text, package):
    fields = []
    for line in text.splitlines():
        code = line.partition('#')[0].strip()
        found = FIELD.match(code)
        if code and not found:
            raise BagError(f'{line!r} is no field of a message')
        # a constant has the form of a field and then '='
        if not code or code[found.end() :].lstrip().startswith('='):
            continue
        base = found['base']
        if base not in PRIMITIVES:
            base = '/'.join(split(base)) if '/' in base else f'{package}/{base}'
        fixed = found['length'] if found['length'] and not found['bound'] else None
        fields.append(Field(found['name'], base, found['array'] is not None, fixed and int(fixed)))
    return tuple(fields) or (FILLER,)
