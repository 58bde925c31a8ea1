"""Parameters as frozen dataclasses whose every field states its allowed range and unit.

    class Brakes(Struct):
        max_force_n: Annotated[float, Range(0.0, 30000.0, 'N')]
        kind: Annotated[str, Choice('disc', 'drum')]
        front_share: Annotated[float, Range(0.0, 1.0, '-')] | None

Dataclasses nest; `tuple[float, ...]` takes a list, the range holds for each element. A parameter
`| None` may be left out and is None then; with a parameter `on` in the same dataclass that is
true it may not. `NAME_min` may not exceed `NAME_max` of the same dataclass. Dataclasses hold no
other defaults: `build` and `load` reject a missing parameter. A misspelt parameter is always
rejected.

A parameter file may name another file as its `base` and then holds only what differs from it:

    /**:
      ros__parameters:
        base: mpcc.yaml               # beside this file, or a path relative to it
        priorities: {obstacle: 0.0}   # 1/m^2
"""

import dataclasses
import math
import os
import sys
import types
import typing
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

from msgs_yaml.strict_yaml import Item, YamlError, closest, read
from node_runtime import named_vector

if sys.version_info >= (3, 11):
    from typing import dataclass_transform
else:

    def dataclass_transform(**_):
        """Return a decorator that only type checkers heed."""
        return lambda cls: cls


T = TypeVar('T')
SCALARS = (bool, int, float, str)
BASE = 'base'
NO_UNIT = '-'  # of a Range whose numbers are shares or counts
LOWER_END, UPPER_END = '_min', '_max'  # of the names of a range's two ends
SWITCH = 'on'  # parameter of a group: the others are needed where it is true
_ANY = {bool: 'true or false', str: 'any text'}
_UNIONS = (typing.Union, types.UnionType)


class _Empty:
    """The value of a key with nothing after it, which `check` refuses; `null` leaves it out."""

    def __repr__(self):
        return 'nothing'


EMPTY = _Empty()


class ParameterError(ValueError):
    """A parameter is unknown, missing, of the wrong type or out of range."""


@dataclass_transform(frozen_default=True)
class Struct:
    """Base of parameter groups and of blocks of YAML files: a subclass is a frozen dataclass."""

    def __init_subclass__(cls, **options: Any):
        super().__init_subclass__(**options)
        dataclass(frozen=True)(cls)


@dataclass(frozen=True)
class Range:
    """Allowed range of a number, bounds included, and its unit."""

    low: float
    high: float
    unit: str

    @property
    def allowed(self) -> str:
        """The allowed values as text."""
        unit = '' if self.unit == NO_UNIT else f' {self.unit}'
        return f'{self.low:g} to {self.high:g}{unit}'

    def fault(self, kind: type, value: Any) -> str:
        """Return why a value is no such int or float, as `must be finite, is`, or ''."""
        if isinstance(value, bool) or not isinstance(value, int if kind is int else int | float):
            return f'must be a {"whole number" if kind is int else "number"}, is'
        # math.isfinite raises for a whole number beyond all floats
        if isinstance(value, float) and not math.isfinite(value):
            return 'must be finite, is'
        return '' if self.low <= value <= self.high else 'is'


@dataclass(frozen=True, init=False)
class Choice:
    """Allowed words of a text."""

    words: tuple[str, ...]

    def __init__(self, *words: str):
        object.__setattr__(self, 'words', words)

    @property
    def allowed(self) -> str:
        """The allowed values as text."""
        return ' or '.join(self.words)


# quantities that several packages take: what a scenario allows, nodes accept
ROAD_FRICTION = Range(0.05, 1.5, '-')  # scale of the grip of the road, 1 is dry asphalt
RUN_TIME = Range(0.5, 600.0, 's')  # the ranges of positions in topics.yaml follow from it
SPEED = Range(1.0, 100.0, 'm/s')  # desired along a path
START_SPEED = Range(0.0, SPEED.high, SPEED.unit)  # forwards, 0: at standstill
LATERAL_SPEED = Range(-50.0, 50.0, 'm/s')  # at the start, to the left positive
YAW_RATE = Range(-5.0, 5.0, 'rad/s')  # at the start, to the left positive


class Leaf(NamedTuple):
    """Type and allowed values of one parameter."""

    kind: type  # bool, int, float or str
    many: bool  # tuple of them
    rule: Range | Choice | None
    optional: bool = False  # None when it is left out

    @property
    def allowed(self) -> str:
        """The allowed values as text."""
        return self.rule.allowed if self.rule else _ANY[self.kind]


def leaves(cls: type) -> dict[str, Leaf]:
    """Return every parameter of a dataclass under its dotted name.

    Raises TypeError for a field that states no type or range of the forms above.
    """
    by_name = {}
    for name, hint in typing.get_type_hints(cls, include_extras=True).items():
        if dataclasses.is_dataclass(hint):
            by_name.update({f'{name}.{inner}': leaf for inner, leaf in leaves(hint).items()})
        else:
            by_name[name] = _leaf(f'{cls.__name__}.{name}', hint)
    return by_name


def _leaf(field, hint):
    if typing.get_origin(hint) in _UNIONS:
        kinds = [kind for kind in typing.get_args(hint) if kind is not types.NoneType]
        if len(kinds) == 1:
            return _leaf(field, kinds[0])._replace(optional=True)
    base, rule = hint, None
    if typing.get_origin(hint) is typing.Annotated:
        base, rule = hint.__origin__, hint.__metadata__[0]
    element, *ellipsis = typing.get_args(base) or (base,)
    many = typing.get_origin(base) is tuple and ellipsis == [Ellipsis]
    kind = element if many else base
    rules = {float: (Range,), int: (Range,), str: (Choice, types.NoneType), bool: types.NoneType}
    if kind not in SCALARS or not isinstance(rule, rules[kind]):
        raise TypeError(f'{field}: {hint} is no parameter; numbers need a Range(low, high, unit)')
    return Leaf(kind, many, rule)


def build(cls: type[T], mapping: Mapping[str, Any], source: Callable[[str], str] | str | Path) -> T:
    """Build a parameter dataclass from a nested mapping, strictly.

    `source`, or source(dotted_key), is where a value comes from. Raises ParameterError
    `<source>: <dotted.key>: <what>; allowed <range> <unit>`.
    """
    if not callable(source):
        return build(cls, mapping, lambda key: source)
    known = leaves(cls)
    given = flatten_mapping(mapping)
    for key in given:
        if key not in known:
            what = describe_group(key, known) or f'unknown parameter{closest(key, known)}'
            raise ParameterError(f'{source(key)}: {key}: {what}')
    for key, leaf in known.items():
        if key not in given and not leaf.optional:
            raise ParameterError(f'{source(key)}: {key}: is missing; allowed {leaf.allowed}')
    values = {key: check(leaf, given.get(key), key, source) for key, leaf in known.items()}
    _check_switched_on(values, known, source)
    _check_ends(values, known, source)
    return named_vector.build(cls, values.values())


def describe_group(key: str, known: Iterable[str]) -> str:
    """Return what is wrong with the name of a group in place of a parameter, '' for others."""
    members = [name for name in known if name.startswith(f'{key}.')]
    if not members:
        return ''
    return f'is a group, not a parameter; allowed {", ".join(members)}'


def _check_switched_on(values, known, source):
    """Raise ParameterError for a group that is on and lacks one of its parameters."""
    groups = [k.removesuffix(SWITCH) for k in values if k.endswith(f'.{SWITCH}') and values[k]]
    for group in groups:
        for key in values:
            if key.startswith(group) and values[key] is None:
                raise ParameterError(
                    f'{source(group + SWITCH)}: {key}: is missing, and {group}{SWITCH} is true; '
                    f'allowed {known[key].allowed}'
                )


def _check_ends(values, known, source):
    """Raise ParameterError for a range whose lower end is above its upper one."""
    for key, low in values.items():
        upper = key.removesuffix(LOWER_END) + UPPER_END
        if not key.endswith(LOWER_END) or upper not in values:
            continue
        high = values[upper]
        if low is not None and high is not None and low > high:
            raise ParameterError(
                f'{source(key)}: {key}: is {low:g}, above {upper}, {high:g}; '
                f'allowed {dataclasses.replace(known[key].rule, high=high).allowed}'
            )


def check(leaf: Leaf, value: Any, key: str, source: Callable[[str], str]) -> Any:
    """Return a value in the type of its parameter; raise ParameterError if it is not allowed."""
    if value is None and leaf.optional:
        return None

    def error(what):
        return ParameterError(f'{source(key)}: {key}: {what}; allowed {leaf.allowed}')

    if value is EMPTY:
        raise error('has no value')
    if not leaf.many:
        return _scalar(leaf, value, error)
    if isinstance(value, str | bytes) or not isinstance(value, typing.Iterable):
        raise error(f'must be a list, is {value!r}')
    return tuple(_scalar(leaf, element, error) for element in value)


def _scalar(leaf, value, error):
    if isinstance(leaf.rule, Range):
        fault = leaf.rule.fault(leaf.kind, value)
        if fault:
            raise error(f'{fault} {value!r}')
    elif not isinstance(value, leaf.kind):
        raise error(f'must be {"true or false" if leaf.kind is bool else "a text"}, is {value!r}')
    elif leaf.rule and value not in leaf.rule.words:
        raise error(f'is {value!r}{closest(value, leaf.rule.words)}')
    return leaf.kind(value)


class ParameterFile(NamedTuple):
    """The parameters of a file and its bases, by dotted name."""

    values: dict[str, Any]
    sources: dict[str, str]  # <file>:<line>
    comments: dict[str, str]  # behind the value
    base: Path | None

    def __repr__(self):
        return f'ParameterFile({len(self.values)} parameters, base={self.base})'


def load(cls: type[T], path: Path, config: Path | None = None) -> T:
    """Read a parameter file into a dataclass; see `read_file`.

    Raises ParameterError that names the file, the line and the dotted key.
    """
    file = read_file(path, config)
    return build(cls, file.values, lambda key: file.sources.get(key, str(path)))


def read_file(path: Path, config: Path | None = None) -> ParameterFile:
    """Read a ROS parameter file, `/**: {ros__parameters: {...}}`, and the files it is based on.

    Instead of `/**` it may have the name of a node, as `ros2 param dump` writes it. A base that is
    a bare name is looked for beside the file, then in the folder `config`; a path is relative to
    the file. Raises ParameterError `<file>:<line>: <key>: <what>`.
    """
    try:
        return _read_chain(Path(path), config, ())
    except YamlError as error:
        raise ParameterError(str(error)) from None


def _read_chain(path, config, derived):
    """Return a file and its bases; `derived` are the files that lead to it, the first one first."""
    root = read(path)
    node = next(iter(root.items())) if len(root.items()) == 1 else ''
    name = node if node.startswith('/') else '/**'
    parameters = root.members((name,))[name].members(('ros__parameters',))['ros__parameters']
    items = _leaf_items(parameters, '')
    lines = path.read_text().splitlines()
    base = items.pop(BASE, None)
    own = ParameterFile(
        {key: value_of(item) for key, item in items.items()},
        {key: f'{path}:{item.line}' for key, item in items.items()},
        {key: lines[item.line - 1].partition('#')[2].strip() for key, item in items.items()},
        _find_base(base, path, config) if base and base.text() else None,
    )
    if own.base is None:
        return own
    chain = (*derived, path)
    if own.base.resolve() in [file.resolve() for file in chain]:
        names = ' -> '.join(file.name for file in (*chain, own.base))
        raise base.error(f'the files are based on each other: {names}')
    inherited = _read_chain(own.base, config, chain)
    comments = {key: text for key, text in own.comments.items() if text}
    return ParameterFile(
        inherited.values | own.values,
        inherited.sources | own.sources,
        inherited.comments | comments,
        own.base,
    )


def value_of(item: Item) -> Any:
    """Return the value of a parameter; EMPTY where the text has none."""
    # the style of a plain scalar is None in PyYAML's parser, '' in libyaml's
    is_empty = item.node.id == 'scalar' and not item.node.value and not item.node.style
    return EMPTY if is_empty else item.value()


def _find_base(item: Item, path, config):
    name = item.text()
    folders = [path.parent, *([config] if config and os.sep not in name else [])]
    for folder in folders:
        path = Path(os.path.normpath(folder / os.path.expanduser(name)))
        if path.is_file():
            return path
    raise item.error(f'there is no file {name} in {" or ".join(map(str, folders))}')


def _leaf_items(item, prefix):
    leaf_items = {}
    for name, member in item.items().items():
        nested = member.node.id == 'mapping'
        key = f'{prefix}{name}'
        member = member._replace(key=key)
        leaf_items.update(_leaf_items(member, f'{key}.') if nested else {key: member})
    return leaf_items


def flatten(parameters: Any) -> dict[str, Any]:
    """Return every value of a parameter dataclass under its dotted name."""
    return flatten_mapping(dataclasses.asdict(parameters))


def flatten_mapping(mapping: Mapping[str, Any], prefix: str = '') -> dict[str, Any]:
    """Return a nested mapping as dotted keys; keys that are dotted already stay."""
    flat = {}
    for name, value in mapping.items():
        key = f'{prefix}{name}'
        nested = isinstance(value, Mapping)
        flat.update(flatten_mapping(value, f'{key}.') if nested else {key: value})
    return flat
