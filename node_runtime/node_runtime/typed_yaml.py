"""YAML nodes as typed values of a schema: frozen dataclasses, read strictly.

    class Square(Struct):
        side_m: Annotated[float, Range(0.0, 10.0, 'm')]
        colour: Annotated[str, Pattern('[a-z]+', 'small letters')] = 'red'

    parse_value(Square, item)

A field is a number with its `Range`, a text with its `Pattern`, a `Literal`, another dataclass, a
list `tuple[X, ...]`, a pair `tuple[X, Y]`, a union of dataclasses, which is resolved by their first
field, or a class that reads the node itself, by its class method `from_item(item)`. A field with a
default may be left out. Every error names file, line, dotted key, and what is allowed. Flat
parameters of nodes, which may also come from ROS, are those of `parameters`.
"""

import dataclasses
import re
import types
import typing
from dataclasses import dataclass
from typing import Any

import yaml

from msgs_yaml.strict_yaml import Item, YamlError, closest
from node_runtime.parameters import Range

MAX_ELEMENTS = 100_000
MAX_SHOWN = 60  # characters of a wrong value that an error repeats
_NUMBER = re.compile(r'[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?')
_WHOLE = re.compile(r'[-+]?\d{1,18}')
_PLAIN = (None, '')  # how PyYAML and libyaml mark a value without quotes


@dataclass(frozen=True)
class Pattern:
    """Allowed texts: a regular expression and its meaning in words."""

    expression: str
    allowed: str


def field_types(schema: type) -> dict[str, typing.Any]:
    """Return the resolved type hints of a schema dataclass, with their ranges."""
    return typing.get_type_hints(schema, include_extras=True)


def defaults(schema: type) -> dict[str, typing.Any]:
    """Return the default of each field that may be left out."""
    fields = dataclasses.fields(schema)
    return {f.name: f.default for f in fields if f.default is not dataclasses.MISSING}


def describe_allowed(hint: Any) -> str:
    """Return the allowed values of a single value as text; '' for blocks and lists."""
    if typing.get_origin(hint) is typing.Literal:
        return ' or '.join(map(repr, typing.get_args(hint)))
    if typing.get_origin(hint) is not typing.Annotated:
        return ''
    return typing.get_args(hint)[1].allowed


def parse_value(hint: Any, item: Item) -> Any:
    """Return the value of a node as the type hint describes it. Raises YamlError."""
    origin, arguments = typing.get_origin(hint), typing.get_args(hint)
    if dataclasses.is_dataclass(hint):
        return _parse_block(hint, item)
    if hasattr(hint, 'from_item'):
        return hint.from_item(item)
    if origin in (types.UnionType, typing.Union):
        return _parse_block(_select_alternative(arguments, item), item)
    if origin is tuple:
        return _parse_list(arguments, item)
    scalar, allowed = _parse_scalar(item), describe_allowed(hint)
    if origin is typing.Literal:
        if not any(type(scalar) is type(word) and scalar == word for word in arguments):
            raise item.error(f'is {_shown(item)}; allowed {allowed}')
        return scalar
    base, rule = arguments
    if isinstance(rule, Range):
        fault = rule.fault(base, scalar)
        if fault:
            raise item.error(f'{fault} {_shown(item)}; allowed {allowed}')
        return base(scalar)
    if not isinstance(scalar, str) or not re.fullmatch(rule.expression, scalar):
        raise item.error(f'is {_shown(item)}; allowed {allowed}')
    return scalar


def _parse_block(schema, item):
    members, fields, optional = item.items(), field_types(schema), defaults(schema)
    for name, member in members.items():
        if name not in fields:
            raise member.error(f'unknown key{closest(name, fields)}; allowed {", ".join(fields)}')
    values = {}
    for name, hint in fields.items():
        if name in members:
            values[name] = parse_value(hint, members[name])
        elif name not in optional:
            key = f'{item.key}.{name}' if item.key else name
            allowed = describe_allowed(hint)
            what = f'is missing; allowed {allowed}' if allowed else 'is missing'
            raise item._replace(key=key).error(what)
    return schema(**values)


def _select_alternative(schemas, item):
    by_first_field = {next(iter(field_types(schema))): schema for schema in schemas}
    members = item.items()
    present = [name for name in by_first_field if name in members]
    if len(present) == 1:
        return by_first_field[present[0]]
    names = ', '.join(by_first_field)
    if present:
        what = f'has {" and ".join(present)}'
    else:
        what = f'has none of {names}' + ''.join(closest(name, by_first_field) for name in members)
    raise item.error(f'{what}; allowed exactly one of {names}')


def _parse_list(arguments, item):
    if len(item.node.value) > MAX_ELEMENTS:
        raise item.error(f'has {len(item.node.value)} elements; allowed at most {MAX_ELEMENTS}')
    elements = item.elements()
    if arguments[-1] is Ellipsis:
        return tuple(parse_value(arguments[0], element) for element in elements)
    if len(elements) != len(arguments):
        raise item.error(f'has {len(elements)} elements; allowed exactly {len(arguments)}')
    return tuple(parse_value(hint, element) for hint, element in zip(arguments, elements))


def _parse_scalar(item):
    node = item.node
    if not isinstance(node, yaml.ScalarNode):
        raise item.error(f'must be a single value, is a {node.id}')
    # a file may hold thousands of numbers, and PyYAML is slow at each
    if node.style in _PLAIN and _WHOLE.fullmatch(node.value):
        return int(node.value)
    if node.style in _PLAIN and _NUMBER.fullmatch(node.value):
        return float(node.value)
    try:
        return item.value()
    except YamlError:
        raise
    except (yaml.YAMLError, ValueError) as error:
        raise item.error(f'is no value: {error}') from None


def _shown(item):
    text = item.node.value
    return repr(text if len(text) <= MAX_SHOWN else f'{text[:MAX_SHOWN]}...')
