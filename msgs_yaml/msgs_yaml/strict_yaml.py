"""YAML read strictly: values of a schema of dataclasses, and errors with file, line and key.

    class Square(Struct):
        side_m: Annotated[float, Range(0.0, 10.0, 'm')]
        colour: Literal['red', 'blue'] = 'red'

    parse_value(Square, read(path))

A field is a number with its `Range`, a text, free or with a `Choice` or `Pattern`, a truth, a
`Literal`, another dataclass, a list `tuple[X, ...]`, a pair `tuple[X, Y]`, a mapping `dict[str, X]`
of any keys, `dict[Literal['a', 'b'], X]` or `{'from': X, 'to': Y}` of exactly these, a union of
dataclasses, which is resolved by their first field, or a class that reads the node itself, by its
class method `from_item(item)`. A field with a default, or `| None`, may be left out. A dataclass
may have a method `faults()` that yields what is wrong beyond its fields: (keys that lead, text).

The flat parameters of nodes, which may also come from ROS, have the same fields
(`node_runtime.parameters`). A file has no aliases, as ROS has none: with them a short one can
expand to gigabytes.
"""

import dataclasses
import difflib
import math
import re
import sys
import types
import typing
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cache, lru_cache
from pathlib import Path
from typing import Any, Literal, NamedTuple

import yaml

if sys.version_info >= (3, 11):
    from typing import dataclass_transform
else:

    def dataclass_transform(**_):
        """Return a decorator that only type checkers heed."""
        return lambda cls: cls


MAX_DEPTH = 32  # composing recurses, in libyaml on the stack of the process
MAX_ELEMENTS = 100_000  # of a list
MAX_SHOWN = 60  # characters of a wrong value that an error repeats
NO_UNIT = '-'  # of a Range whose numbers are shares or counts
UNIONS = (typing.Union, types.UnionType)
_CACHED_CHARACTERS = 100_000
# libyaml parses ten times faster than Python, but PyYAML may be built without it
_FAST = getattr(yaml, 'CSafeLoader', None)
_PLAIN = (None, '')  # how PyYAML and libyaml mark a value without quotes
# a file may hold thousands of numbers, and PyYAML is slow at each
_WHOLE = re.compile(r'[-+]?(?:0|[1-9]\d{0,17})')
# YAML 1.1 reads 1e-6 as text; ROS reads it as a number
_NUMBER = re.compile(r'[-+]?(?:(?:\d+\.\d*|\.\d+)(?:[eE][-+]?\d+)?|\d+[eE][-+]?\d+)')
_TEXT = 'tag:yaml.org,2002:str'
_KEY_PART = re.compile(r'\[(\d+)\]|([^.\[\]]+)')
_KINDS = {bool: 'true or false', int: 'a whole number', float: 'a number', str: 'a text'}
_ANY = {bool: 'true or false', str: 'any text'}


class InputError(Exception):
    """What somebody gave cannot be used; the message, one line, says what, why, and what helps."""


class YamlError(InputError, ValueError):
    """A mistake in a YAML file; the text begins with file:line, or the file if it is not read."""


class _Refused(yaml.MarkedYAMLError):
    """A YAML text that is not read."""


class _Empty:
    """The value of a key with nothing after it, which no field allows; `null` leaves it out."""

    def __repr__(self):
        return 'nothing'


EMPTY = _Empty()


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
            return f'must be {_KINDS[kind]}, is'
        if self.low <= value <= self.high:
            return ''
        # math.isfinite raises for a whole number beyond all floats
        is_finite = isinstance(value, int) or math.isfinite(value)
        return 'is' if is_finite else 'must be finite, is'


@dataclass(frozen=True, init=False)
class Choice:
    """Allowed words of a text."""

    words: tuple[str, ...]

    def __init__(self, *words: str):
        object.__setattr__(self, 'words', words)

    @property
    def allowed(self) -> str:
        """The allowed values as text."""
        return ' or '.join(map(str, self.words))

    def allows(self, value: str) -> bool:
        """Return whether a text is one of the words."""
        return value in self.words


@dataclass(frozen=True)
class Pattern:
    """Allowed texts: a regular expression and its meaning in words."""

    expression: str
    allowed: str

    def allows(self, value: str) -> bool:
        """Return whether a text matches."""
        return re.fullmatch(self.expression, value) is not None


class Leaf(NamedTuple):
    """Type and allowed values of a field that holds no block."""

    kind: type  # bool, int, float or str
    many: bool  # tuple of them
    rule: Range | Choice | Pattern | None
    optional: bool = False  # None when it is left out

    @property
    def allowed(self) -> str:
        """The allowed values as text."""
        return self.rule.allowed if self.rule else _ANY[self.kind]

    def fault(self, value: Any, shown: str = '') -> str:
        """Return what is wrong with a value, or ''; `shown` is the text that stands for it.

        As in `must be a number, is 'x'; allowed 0 to 1 m`.
        """
        if value is None and self.optional:
            return ''
        if value is EMPTY:
            return f'has no value; allowed {self.allowed}'
        if self.many and (isinstance(value, str | bytes) or not isinstance(value, Iterable)):
            return f'must be a list, is {value!r}; allowed {self.allowed}'
        if self.many:
            return next(filter(None, map(self._replace(many=False).fault, value)), '')
        what, hint = 'is', ''
        if isinstance(self.rule, Range):
            what = self.rule.fault(self.kind, value)
        elif not isinstance(value, self.kind) or isinstance(value, bool) != (self.kind is bool):
            what = f'must be {_KINDS[self.kind]}, is'
        elif self.rule is None or self.rule.allows(value):
            what = ''
        elif isinstance(self.rule, Choice) and isinstance(value, str):
            hint = closest(value, self.rule.words)
        return what and f'{what} {shown or repr(value)}{hint}; allowed {self.allowed}'

    def convert(self, value: Any) -> Any:
        """Return a value without fault in the type of the field."""
        if value is None and self.optional:
            return None
        return tuple(map(self.kind, value)) if self.many else self.kind(value)


@lru_cache(maxsize=1024)
def leaf_of(hint: Any) -> Leaf | None:
    """Return what a type hint allows, None for one that is no leaf."""
    if typing.get_origin(hint) in UNIONS:
        kinds = [kind for kind in typing.get_args(hint) if kind is not types.NoneType]
        leaf = leaf_of(kinds[0]) if len(kinds) == 1 else None
        return leaf and leaf._replace(optional=True)
    if typing.get_origin(hint) is Literal:
        words = typing.get_args(hint)
        return Leaf(type(words[0]), False, Choice(*words))
    base, rule = hint, None
    if typing.get_origin(hint) is typing.Annotated:
        base, rule = hint.__origin__, hint.__metadata__[0]
    element, *ellipsis = typing.get_args(base) or (base,)
    many = typing.get_origin(base) is tuple and ellipsis == [Ellipsis]
    kind = element if many else base
    rules = {float: Range, int: Range, str: (Choice, Pattern, types.NoneType), bool: types.NoneType}
    return Leaf(kind, many, rule) if isinstance(rule, rules.get(kind, ())) else None


@cache
def field_types(schema: type) -> Mapping[str, Any]:
    """Return the resolved type hints of a schema dataclass, with their ranges."""
    return typing.get_type_hints(schema, include_extras=True)


@cache
def defaults(schema: type) -> Mapping[str, Any]:
    """Return the default of each field that may be left out."""
    hints = field_types(schema).items()
    given = {name: None for name, hint in hints if types.NoneType in typing.get_args(hint)}
    for field in dataclasses.fields(schema):
        if field.default is not dataclasses.MISSING:
            given[field.name] = field.default
        elif field.default_factory is not dataclasses.MISSING:
            given[field.name] = field.default_factory()
    return given


def describe_allowed(hint: Any) -> str:
    """Return the allowed values of a single value as text; '' for blocks and lists."""
    leaf = leaf_of(hint)
    return leaf.allowed if leaf and not leaf.many else ''


class Item(NamedTuple):
    """One node of a YAML file."""

    path: Path
    key: str  # dotted, '' for the root
    node: yaml.Node
    key_node: yaml.Node | None = None  # None for the root and in lists

    @property
    def line(self) -> int:
        """Line of its key in the file, counted from 1."""
        return (self.key_node or self.node).start_mark.line + 1

    def error(self, what: str) -> YamlError:
        """Return an error `<file>:<line>: <key>: <what>`."""
        key = f'{self.key}: ' if self.key else ''
        return YamlError(f'{self.path}:{self.line}: {key}{what}')

    def error_at(self, key: str, what: str) -> YamlError:
        """Return the error about a dotted key below a root, such as `obstacles[1].x_m`.

        A key missing from the file gets the line of the block that would contain it.
        """
        item = self
        for index, name in _KEY_PART.findall(key):
            children = item.elements() if index else item.items()
            try:
                item = children[int(index) if index else name]
            except (KeyError, IndexError):
                break
        return item._replace(key=key).error(what)

    def items(self) -> dict[str, 'Item']:
        """Return the members of a mapping; raise YamlError on duplicates and odd keys."""
        if not isinstance(self.node, yaml.MappingNode):
            raise self.error(f'must be a mapping, is {_describe(self.node)}')
        members = {}
        for key_node, value_node in self.node.value:
            name = key_node.value
            if not isinstance(key_node, yaml.ScalarNode):
                raise self._replace(key_node=key_node).error('a key must be one word')
            key = f'{self.key}.{name}' if self.key else name
            member = Item(self.path, key, value_node, key_node)
            if name in members:
                raise member.error('appears twice')
            members[name] = member
        return members

    def members(self, required: Iterable[str], optional: Iterable[str] = ()) -> dict:
        """Return the members of a mapping that has exactly these keys."""
        members, known = self.items(), (*required, *optional)
        for name, member in members.items():
            if name not in known:
                raise member.error(f'unknown key{closest(name, known)}; allowed {", ".join(known)}')
        for name in required:
            if name not in members:
                raise self.error(f'key {name!r} is missing')
        return members

    def elements(self) -> list['Item']:
        """Return the elements of a list, at most MAX_ELEMENTS."""
        if not isinstance(self.node, yaml.SequenceNode):
            raise self.error(f'must be a list, is {_describe(self.node)}')
        nodes = self.node.value
        if len(nodes) > MAX_ELEMENTS:
            raise self.error(f'has {len(nodes)} elements; allowed at most {MAX_ELEMENTS}')
        return [Item(self.path, f'{self.key}[{i}]', n) for i, n in enumerate(nodes)]

    def value(self) -> Any:
        """Return the plain Python value, mappings as dicts and lists as lists."""
        if isinstance(self.node, yaml.MappingNode):
            return {name: item.value() for name, item in self.items().items()}
        if isinstance(self.node, yaml.SequenceNode):
            return [item.value() for item in self.elements()]
        if self.node.style in _PLAIN and _WHOLE.fullmatch(self.node.value):
            return int(self.node.value)
        if self.node.style in _PLAIN and _NUMBER.fullmatch(self.node.value):
            return float(self.node.value)
        if self.node.tag == _TEXT:
            return self.node.value
        loader = yaml.SafeLoader('')
        try:
            return loader.construct_object(self.node)
        except yaml.MarkedYAMLError as error:  # a Python or unknown tag
            raise self.error(error.problem) from None
        except (ValueError, LookupError, AttributeError) as error:
            # what PyYAML raises for a tag that does not fit its value
            kind = self.node.tag.rpartition(':')[2]
            raise self.error(f'{_describe(self.node)} is no {kind}: {error}') from None
        finally:
            loader.dispose()

    def value_or_empty(self) -> Any:
        """Return the value of a parameter or field; EMPTY where the text has none."""
        node = self.node
        is_empty = node.id == 'scalar' and not node.value and node.style in _PLAIN
        return EMPTY if is_empty else self.value()


def _describe(node, quoted=True):
    kinds = {yaml.MappingNode: 'a mapping', yaml.SequenceNode: 'a list'}
    if type(node) in kinds:
        return kinds[type(node)]
    text = node.value if len(node.value) <= MAX_SHOWN else f'{node.value[:MAX_SHOWN]}...'
    return repr(text) if quoted else text


def parse_value(hint: Any, item: Item) -> Any:
    """Return the value of a node as the type hint describes it. Raises YamlError."""
    origin, arguments = typing.get_origin(hint), typing.get_args(hint)
    if isinstance(hint, Mapping):
        return {name: parse_value(hint[name], own) for name, own in item.members(hint).items()}
    if dataclasses.is_dataclass(hint):
        return _parse_block(hint, item)
    if hasattr(hint, 'from_item'):
        return hint.from_item(item)
    if origin is dict:
        names, inside = arguments
        members = item.items() if names is str else item.members(typing.get_args(names))
        return {name: parse_value(inside, member) for name, member in members.items()}
    if origin is tuple:
        elements = item.elements()
        if arguments[-1] is Ellipsis:
            return tuple(parse_value(arguments[0], element) for element in elements)
        if len(elements) != len(arguments):
            raise item.error(f'has {len(elements)} elements; allowed exactly {len(arguments)}')
        return tuple(parse_value(inside, element) for inside, element in zip(arguments, elements))
    leaf = leaf_of(hint)
    if leaf is None:
        blocks = [kind for kind in arguments if kind is not type(None)]
        block = blocks[0] if len(blocks) == 1 else _select_alternative(blocks, item)
        return _parse_block(block, item)
    if not isinstance(item.node, yaml.ScalarNode):
        raise item.error(f'must be a single value, is a {item.node.id}; allowed {leaf.allowed}')
    value = item.value_or_empty()
    # as it is written, quoted if it is a text; what may be left out may not be null
    fault = leaf._replace(optional=False).fault(
        value, _describe(item.node, not isinstance(value, int | float))
    )
    if fault:
        raise item.error(fault)
    return leaf.convert(value)


def _parse_block(schema, item):
    fields, optional = field_types(schema), defaults(schema)
    members = item.members((), fields)
    values = {}
    for name, hint in fields.items():
        if name in members:
            values[name] = parse_value(hint, members[name])
        elif name in optional:
            values[name] = optional[name]
        else:
            key, allowed = f'{item.key}.{name}' if item.key else name, describe_allowed(hint)
            what = f'is missing; allowed {allowed}' if allowed else 'is missing'
            raise item._replace(key=key).error(what)
    block = schema(**values)
    for keys, what in getattr(block, 'faults', tuple)():
        for key in keys:
            item = item.items()[key]
        raise item.error(what)
    return block


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


def read(path: Path) -> Item:
    """Return the root of a YAML file; raise YamlError as `parse` does, and if it is not read."""
    try:
        return parse(Path(path).read_text(encoding='utf-8'), path)
    except UnicodeDecodeError as error:
        raise YamlError(f'{path}:1: no valid YAML: {error}') from None
    except OSError as error:
        raise YamlError(f'{path}: {error.strerror or error}') from None


def parse(text: str, source: Path | str) -> Item:
    """Return the root of a YAML text; `source` is the file name that errors show.

    Raises YamlError when the text is no YAML, is empty, nests too deeply or has aliases.
    """
    compose = _compose if len(text) <= _CACHED_CHARACTERS else _compose.__wrapped__
    try:
        node = compose(text)
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        line = mark.line + 1 if mark else 1
        what = '' if isinstance(error, _Refused) else 'no valid YAML: '
        raise YamlError(f'{source}:{line}: {what}{error.problem}') from None
    except (yaml.YAMLError, UnicodeError) as error:
        raise YamlError(f'{source}:1: no valid YAML: {error}') from None
    if node is None:
        raise YamlError(f'{source}:1: the file is empty')
    return Item(Path(source), '', node)


@lru_cache(maxsize=32)
def _compose(text):
    """Return the root node; the same few files are read again for every run of a program."""
    # libyaml takes tabs where YAML does not allow them
    if _FAST and '\t' not in text:
        try:
            _check_depth_and_aliases(text, _FAST)
            return yaml.compose(text, Loader=_FAST)
        except _Refused:
            raise
        except yaml.YAMLError:
            pass  # told in the words of the other parser, however PyYAML was built
    _check_depth_and_aliases(text, yaml.SafeLoader)
    return yaml.compose(text, Loader=yaml.SafeLoader)


def _check_depth_and_aliases(text, loader):
    # the parser's events are flat; composing them recurses and could exhaust the stack
    depth = 0
    for event in yaml.parse(text, Loader=loader):
        what = ''
        if isinstance(event, yaml.AliasEvent):
            what = f'aliases (*{event.anchor}) are not allowed'
        depth += isinstance(event, yaml.CollectionStartEvent)
        depth -= isinstance(event, yaml.CollectionEndEvent)
        if depth > MAX_DEPTH:
            what = f'nests deeper than {MAX_DEPTH} levels'
        if what:
            raise _Refused(problem=what, problem_mark=event.start_mark)


def closest(name: str, known: Iterable[str]) -> str:
    """Return '; did you mean ...?' for the known name closest to a misspelt one, or ''."""
    match = difflib.get_close_matches(name, list(known), n=1)
    return f'; did you mean {match[0]!r}?' if match else ''
