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
import os
from collections.abc import Callable, Iterable, Mapping
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

from msgs_yaml.strict_yaml import Choice as Choice  # with these parameters are declared
from msgs_yaml.strict_yaml import (
    InputError,
    Item,
    Leaf,
    Range,
    YamlError,
    closest,
    field_types,
    leaf_of,
    parse_value,
    read,
)
from msgs_yaml.strict_yaml import Struct as Struct
from node_runtime import named_vector

T = TypeVar('T')
BASE = 'base'
LOWER_END, UPPER_END = '_min', '_max'  # of the names of a range's two ends
SWITCH = 'on'  # parameter of a group: the others are needed where it is true


class ParameterError(InputError, ValueError):
    """A parameter is unknown, missing, of the wrong type or out of range."""


# quantities that several packages take: what a scenario allows, nodes accept
ROAD_FRICTION = Range(0.05, 1.5, '-')  # scale of the grip of the road, 1 is dry asphalt
RUN_TIME = Range(0.5, 600.0, 's')  # the ranges of positions in topics.yaml follow from it
SPEED = Range(1.0, 100.0, 'm/s')  # desired along a path
START_SPEED = Range(0.0, SPEED.high, SPEED.unit)  # forwards, 0: at standstill
LATERAL_SPEED = Range(-50.0, 50.0, 'm/s')  # at the start, to the left positive
YAW_RATE = Range(-5.0, 5.0, 'rad/s')  # at the start, to the left positive


def leaves(cls: type) -> dict[str, Leaf]:
    """Return every parameter of a dataclass under its dotted name.

    Raises TypeError for a field that states no type or range of the forms above.
    """
    by_name = {}
    for name, hint in field_types(cls).items():
        if dataclasses.is_dataclass(hint):
            by_name |= {f'{name}.{inner}': leaf for inner, leaf in leaves(hint).items()}
            continue
        by_name[name] = leaf_of(hint)
        if by_name[name] is None:
            what = 'is no parameter; numbers need a Range(low, high, unit)'
            raise TypeError(f'{cls.__name__}.{name}: {hint} {what}')
    return by_name


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
    _check_groups(values, known, source)
    return named_vector.build(cls, values.values())


def describe_group(key: str, known: Iterable[str]) -> str:
    """Return what is wrong with the name of a group in place of a parameter, '' for others."""
    members = [name for name in known if name.startswith(f'{key}.')]
    if not members:
        return ''
    return f'is a group, not a parameter; allowed {", ".join(members)}'


def _check_groups(values, known, source):
    """Raise ParameterError for a group that is on and lacks a parameter, and for odd range ends."""
    for key, value in values.items():
        group, _, name = key.rpartition('.')
        if name == SWITCH and group and value:
            for other in values:
                if other.startswith(f'{group}.') and values[other] is None:
                    raise ParameterError(
                        f'{source(key)}: {other}: is missing, and {key} is true; '
                        f'allowed {known[other].allowed}'
                    )
        upper = key.removesuffix(LOWER_END) + UPPER_END
        high = values.get(upper) if key.endswith(LOWER_END) else None
        if value is not None and high is not None and value > high:
            raise ParameterError(
                f'{source(key)}: {key}: is {value:g}, above {upper}, {high:g}; '
                f'allowed {dataclasses.replace(known[key].rule, high=high).allowed}'
            )


def check(leaf: Leaf, value: Any, key: str, source: Callable[[str], str]) -> Any:
    """Return a value in the type of its parameter; raise ParameterError if it is not allowed."""
    fault = leaf.fault(value)
    if fault:
        raise ParameterError(f'{source(key)}: {key}: {fault}')
    return leaf.convert(value)


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
    values, sources, comments, base = _own_parameters(read(path))
    based_on = _find_base(base, path, config) if base and parse_value(str, base) else None
    # a caller may change what it gets
    values = {k: [*v] if isinstance(v, list) else v for k, v in values.items()}
    own = ParameterFile(values, dict(sources), dict(comments), based_on)
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


@lru_cache(maxsize=64)
def _own_parameters(root):
    """Return values, sources, comments, the item of the base; the same as long as the text is."""
    node = next(iter(root.items())) if len(root.items()) == 1 else ''
    name = node if node.startswith('/') else '/**'
    parameters = root.members((name,))[name].members(('ros__parameters',))['ros__parameters']
    items, lines = leaf_items(parameters), root.path.read_text(encoding='utf-8').splitlines()
    base = items.pop(BASE, None)
    values = {key: item.value_or_empty() for key, item in items.items()}
    sources = {key: f'{root.path}:{item.line}' for key, item in items.items()}
    comments = {key: lines[item.line - 1].partition('#')[2].strip() for key, item in items.items()}
    return values, sources, comments, base


def _find_base(item: Item, path, config):
    name = parse_value(str, item)
    folders = [path.parent, *([config] if config and os.sep not in name else [])]
    for folder in folders:
        path = Path(os.path.normpath(folder / os.path.expanduser(name)))
        if os.path.isfile(path):  # false of a name that is too long, too
            return path
    raise item.error(f'there is no file {name} in {" or ".join(map(str, folders))}')


def leaf_items(item: Item, prefix: str = '') -> dict[str, Item]:
    """Return what is nested in an item, by dotted name, which is its key.

    Raises YamlError for one that appears twice, as when it is dotted and nested.
    """
    leaves_below = {}
    for name, member in item.items().items():
        nested = member.node.id == 'mapping'
        key = f'{prefix}{name}'
        member = member._replace(key=key)
        inner = leaf_items(member, f'{key}.') if nested else {key: member}
        for again in inner.keys() & leaves_below:
            raise inner[again].error('appears twice')
        leaves_below |= inner
    return leaves_below


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
