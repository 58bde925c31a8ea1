"""Typed values from a YAML node: a schema of frozen dataclasses, read strictly.

A field is a number with its `Range`, a text with its `Pattern`, a `Literal`, another dataclass,
a list `tuple[X, ...]`, a pair `tuple[X, Y]`, or a union of dataclasses, which are told apart by
their first field. A field with a default may be left out.
"""

import dataclasses
import math
import re
import types
import typing
from dataclasses import dataclass

import yaml

from msgs_yaml.strict_yaml import Item, YamlError, closest
from node_runtime.parameters import Range

MAX_ELEMENTS = 100_000
MAX_SHOWN = 60  # characters of a wrong value that an error repeats
_NUMBER = re.compile(r'[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?')
_PLAIN = (None, '')  # how PyYAML and libyaml mark a value without quotes
_WHOLE = re.compile(r'[-+]?\d{1,18}')


@dataclass(frozen=True)
class Pattern:
    """Allowed texts: a regular expression and what it means in words."""

    expression: str
    words: str


def value(hint, item: Item):
    """Return the value that a type hint describes; raise YamlError when the node is none."""
    origin, arguments = typing.get_origin(hint), typing.get_args(hint)
    if dataclasses.is_dataclass(hint):
        return _block(hint, item)
    if origin in (types.UnionType, typing.Union):
        return _block(_alternative(arguments, item), item)
    if origin is tuple:
        return _list(arguments, item)
    if origin is typing.Literal:
        return _literal(arguments, item)
    base, rule = arguments
    return _number(base, rule, item) if isinstance(rule, Range) else _text(rule, item)


def hints(cls) -> dict:
    """Return the resolved type hints of a schema dataclass, with their ranges."""
    return typing.get_type_hints(cls, include_extras=True)


def defaults(cls) -> dict:
    """Return the default of each field that may be left out."""
    given = dataclasses.fields(cls)
    return {f.name: f.default for f in given if f.default is not dataclasses.MISSING}


def allowed(hint) -> str:
    """Return in words what a single value may be; '' for blocks and lists."""
    if typing.get_origin(hint) is typing.Literal:
        return ' or '.join(map(repr, typing.get_args(hint)))
    if typing.get_origin(hint) is not typing.Annotated:
        return ''
    rule = typing.get_args(hint)[1]
    if isinstance(rule, Pattern):
        return rule.words
    return f'{rule.low:g} to {rule.high:g} {rule.unit}'


def _block(cls, item):
    members, known, may_miss = item.items(), hints(cls), defaults(cls)
    for name, member in members.items():
        if name not in known:
            raise member.error(f'unknown key{closest(name, known)}; allowed {", ".join(known)}')
    values = {}
    for name, hint in known.items():
        if name in members:
            values[name] = value(hint, members[name])
        elif name not in may_miss:
            key = f'{item.key}.{name}' if item.key else name
            raise item._replace(key=key).error(f'is missing{_then(allowed(hint))}')
    return cls(**values)


def _alternative(classes, item):
    members = item.items()
    tells = {next(iter(hints(cls))): cls for cls in classes}
    given = [name for name in tells if name in members]
    if len(given) != 1:
        found = f'has {" and ".join(given)}' if given else f'has none of {", ".join(tells)}'
        meant = '' if given else ''.join(closest(name, tells) for name in members)
        raise item.error(f'{found}{meant}; allowed exactly one of {", ".join(tells)}')
    return tells[given[0]]


def _list(arguments, item):
    if len(item.node.value) > MAX_ELEMENTS:
        raise item.error(f'has {len(item.node.value)} elements; allowed at most {MAX_ELEMENTS}')
    elements = item.elements()
    if arguments[-1] is Ellipsis:
        return tuple(value(arguments[0], element) for element in elements)
    if len(elements) != len(arguments):
        raise item.error(f'has {len(elements)} elements; allowed exactly {len(arguments)}')
    return tuple(value(hint, element) for hint, element in zip(arguments, elements))


def _literal(words, item):
    found = _scalar(item)
    if not any(type(found) is type(word) and found == word for word in words):
        raise item.error(f'is {_shown(item)}; allowed {" or ".join(map(repr, words))}')
    return found


def _number(base, rule, item):
    found = _scalar(item)
    wanted = int if base is int else int | float
    then = f'; allowed {rule.low:g} to {rule.high:g} {rule.unit}'
    if isinstance(found, bool) or not isinstance(found, wanted):
        kind = 'whole number' if base is int else 'number'
        raise item.error(f'must be a {kind}, is {_shown(item)}{then}')
    if isinstance(found, float) and not math.isfinite(found):
        raise item.error(f'must be finite, is {_shown(item)}{then}')
    if not rule.low <= found <= rule.high:
        raise item.error(f'is out of range with {_shown(item)}{then}')
    return base(found)


def _text(rule, item):
    found = _scalar(item)
    if not isinstance(found, str) or not re.fullmatch(rule.expression, found):
        raise item.error(f'is {_shown(item)}; allowed {rule.words}')
    return found


def _scalar(item):
    """Return the plain value of a single node."""
    node = item.node
    if not isinstance(node, yaml.ScalarNode):
        raise item.error(f'must be a single value, is a {node.id}')
    # numbers come in thousands, and PyYAML takes its time over each
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


def _then(words):
    return f'; allowed {words}' if words else ''
