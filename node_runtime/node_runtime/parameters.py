"""Parameters as frozen dataclasses whose every field states its allowed range and unit.

    @dataclass(frozen=True)
    class Brakes:
        max_force_n: Annotated[float, Range(0.0, 30000.0, 'N')]
        kind: Annotated[str, Choice('disc', 'drum')]
        front_share: Annotated[float, Range(0.0, 1.0, '-')] | None

Dataclasses nest; `tuple[float, ...]` takes a list, the range holds for each element. A parameter
`| None` may be left out and is None then. Dataclasses hold no other defaults: `build` and `load`
refuse a missing parameter. A node started with a partial file takes what is missing from the file
of its package (`overrides.resolve`) and logs what it took. A misspelt parameter is always refused.
"""

import dataclasses
import math
import types
import typing
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

from msgs_yaml.strict_yaml import YamlError, closest, read

T = TypeVar('T')
SCALARS = (bool, int, float, str)
_UNIONS = (typing.Union, types.UnionType)


class ParameterError(ValueError):
    """A parameter is unknown, missing, of the wrong type or out of range."""


@dataclass(frozen=True)
class Range:
    """Allowed range of a number, bounds included, and its unit."""

    low: float
    high: float
    unit: str


@dataclass(frozen=True, init=False)
class Choice:
    """Allowed words."""

    words: tuple[str, ...]

    def __init__(self, *words: str):
        object.__setattr__(self, 'words', words)


class Leaf(NamedTuple):
    """What a single parameter may be."""

    kind: type  # bool, int, float or str
    many: bool  # tuple of them
    rule: Range | Choice | None
    optional: bool = False  # None when it is left out

    @property
    def allowed(self) -> str:
        """The allowed range in words."""
        if isinstance(self.rule, Range):
            return f'{self.rule.low:g} to {self.rule.high:g} {self.rule.unit}'
        if isinstance(self.rule, Choice):
            return ' or '.join(self.rule.words)
        return {bool: 'true or false', str: 'any text'}[self.kind]


def leaves(cls: type) -> dict[str, Leaf]:
    """Return every parameter of a dataclass under its dotted name.

    Raises TypeError for a field that states no type or range of the forms above.
    """
    found = {}
    for name, hint in typing.get_type_hints(cls, include_extras=True).items():
        if dataclasses.is_dataclass(hint):
            found.update({f'{name}.{inner}': leaf for inner, leaf in leaves(hint).items()})
        else:
            found[name] = _leaf(f'{cls.__name__}.{name}', hint)
    return found


def _leaf(where, hint):
    alternatives = typing.get_args(hint) if typing.get_origin(hint) in _UNIONS else ()
    if len(alternatives) == 2 and alternatives[1] is types.NoneType:
        return _leaf(where, alternatives[0])._replace(optional=True)
    rules = typing.get_args(hint)[1:] if typing.get_origin(hint) is typing.Annotated else ()
    base = typing.get_args(hint)[0] if rules else hint
    many = typing.get_origin(base) is tuple and typing.get_args(base)[1:] == (Ellipsis,)
    kind = typing.get_args(base)[0] if many else base
    rule = rules[0] if rules else None
    wanted = {float: (Range,), int: (Range,), str: (Choice, types.NoneType), bool: types.NoneType}
    if kind not in SCALARS or not isinstance(rule, wanted[kind]):
        raise TypeError(f'{where}: {hint} is no parameter; numbers need a Range(low, high, unit)')
    return Leaf(kind, many, rule)


def build(cls: type[T], mapping: Mapping[str, Any], source: str) -> T:
    """Build a parameter dataclass from a nested mapping, strictly.

    Raises ParameterError `<source>: <dotted.key>: <what>; allowed <range> <unit>`.
    """
    return build_from(cls, mapping, lambda key: source)


def build_from(cls: type[T], mapping: Mapping[str, Any], source: Callable[[str], str]) -> T:
    """Like `build`; `source(dotted_key)` says where each value comes from."""
    known = leaves(cls)
    given = flatten_mapping(mapping)
    for key in given:
        if key not in known:
            raise ParameterError(f'{source(key)}: {key}: unknown parameter{closest(key, known)}')
    for key, leaf in known.items():
        if key not in given and not leaf.optional:
            raise ParameterError(f'{source(key)}: {key}: is missing; allowed {leaf.allowed}')
    values = {key: check(leaf, given.get(key), key, source) for key, leaf in known.items()}
    return _assemble(cls, values, '')


def _assemble(cls, values, prefix):
    arguments = {}
    for name, hint in typing.get_type_hints(cls).items():
        key = f'{prefix}{name}'
        nested = dataclasses.is_dataclass(hint)
        arguments[name] = _assemble(hint, values, f'{key}.') if nested else values[key]
    return cls(**arguments)


def check(leaf: Leaf, value: Any, key: str, source: Callable[[str], str]) -> Any:
    """Return a value as its parameter's type; raise ParameterError when it may not be that."""
    if value is None and leaf.optional:
        return None

    def refuse(what):
        return ParameterError(f'{source(key)}: {key}: {what}; allowed {leaf.allowed}')

    if not leaf.many:
        return _scalar(leaf, value, refuse)
    if isinstance(value, str | bytes) or not isinstance(value, typing.Iterable):
        raise refuse(f'must be a list, is {value!r}')
    return tuple(_scalar(leaf, element, refuse) for element in value)


def _scalar(leaf, value, refuse):
    is_whole = isinstance(value, int) and not isinstance(value, bool)
    right = {
        bool: isinstance(value, bool),
        int: is_whole,
        float: is_whole or isinstance(value, float),
        str: isinstance(value, str),
    }
    if not right[leaf.kind]:
        names = {bool: 'true or false', int: 'a whole number', float: 'a number', str: 'a text'}
        raise refuse(f'must be {names[leaf.kind]}, is {value!r}')
    if isinstance(leaf.rule, Range):
        # a whole number may be too large even to ask
        if isinstance(value, float) and not math.isfinite(value):
            raise refuse(f'must be finite, is {value!r}')
        if not leaf.rule.low <= value <= leaf.rule.high:
            raise refuse(f'is out of range with {value!r}')
    if isinstance(leaf.rule, Choice) and value not in leaf.rule.words:
        raise refuse(f'is {value!r}{closest(value, leaf.rule.words)}')
    return leaf.kind(value)


def load(cls: type[T], path: Path) -> T:
    """Read a ROS parameter file, `/**: {ros__parameters: {...}}`, into a dataclass.

    Raises ParameterError that names the file, the line and the dotted key.
    """
    values, lines = read_file(path)
    return build_from(
        cls, values, lambda key: f'{path}:{lines[key]}' if key in lines else f'{path}'
    )


def read_file(path: Path) -> tuple[dict[str, Any], dict[str, int]]:
    """Return the dotted values of a ROS parameter file and the line of each."""
    try:
        root = read(path).members(('/**',))['/**'].members(('ros__parameters',))
        items = _leaf_items(root['ros__parameters'], '')
        return {k: item.value() for k, item in items.items()}, {k: i.line for k, i in items.items()}
    except YamlError as error:
        raise ParameterError(str(error)) from None


def _leaf_items(item, prefix):
    found = {}
    for name, member in item.items().items():
        nested = member.node.id == 'mapping'
        key = f'{prefix}{name}'
        found.update(_leaf_items(member, f'{key}.') if nested else {key: member})
    return found


def flatten(parameters: Any) -> dict[str, Any]:
    """Return every value of a parameter dataclass under its dotted name."""
    return flatten_mapping(dataclasses.asdict(parameters))


def flatten_mapping(mapping: Mapping[str, Any], prefix: str = '') -> dict[str, Any]:
    """Return a nested mapping as dotted keys; keys that are dotted already stay."""
    found = {}
    for name, value in mapping.items():
        key = f'{prefix}{name}'
        nested = isinstance(value, Mapping)
        found.update(flatten_mapping(value, f'{key}.') if nested else {key: value})
    return found
