"""Strict YAML: every value has its file, line and key, so that errors can name them."""

import difflib
import re
from collections.abc import Iterable
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import yaml

# YAML 1.1 reads 1e-6 as text; ROS reads it as a number
_EXPONENT = re.compile(r'[-+]?(\d+\.?\d*|\.\d+)[eE][-+]?\d+')
# libyaml parses ten times faster than Python, but PyYAML may be built without it
_FAST = getattr(yaml, 'CSafeLoader', None)
_FAST_DEPTH = 100  # composing recurses, in libyaml on the stack of the process


class YamlError(ValueError):
    """A mistake in a YAML file; the text begins with file:line."""


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

    def items(self) -> dict[str, 'Item']:
        """Return the members of a mapping; raise YamlError on duplicates and odd keys."""
        if not isinstance(self.node, yaml.MappingNode):
            raise self.error(f'must be a mapping, is {_kind(self.node)}')
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

    def members(self, required: tuple[str, ...], optional: tuple[str, ...] = ()) -> dict:
        """Return the members of a mapping that has exactly these keys."""
        members = self.items()
        for name in members:
            if name not in required + optional:
                hint = closest(name, required + optional)
                raise members[name].error(f'unknown key{hint}')
        for name in required:
            if name not in members:
                raise self.error(f'key {name!r} is missing')
        return members

    def elements(self) -> list['Item']:
        """Return the elements of a list."""
        if not isinstance(self.node, yaml.SequenceNode):
            raise self.error(f'must be a list, is {_kind(self.node)}')
        nodes = self.node.value
        return [Item(self.path, f'{self.key}[{i}]', n) for i, n in enumerate(nodes)]

    def value(self) -> Any:
        """Return the plain Python value, mappings as dicts and lists as lists."""
        try:
            return self._value()
        except RecursionError:  # an alias of its own parent, or endless brackets
            raise self.error('is nested too deeply') from None

    def _value(self):
        if isinstance(self.node, yaml.MappingNode):
            return {name: item._value() for name, item in self.items().items()}
        if isinstance(self.node, yaml.SequenceNode):
            return [item._value() for item in self.elements()]
        if not self.node.style and _EXPONENT.fullmatch(self.node.value):
            return float(self.node.value)
        loader = yaml.SafeLoader('')
        try:
            return loader.construct_object(self.node)
        except yaml.MarkedYAMLError as error:  # a Python or unknown tag
            raise self.error(error.problem) from None
        except (ValueError, LookupError, AttributeError) as error:
            # what PyYAML raises for a tag that does not fit its value
            kind = self.node.tag.rpartition(':')[2]
            raise self.error(f'{self.node.value!r} is no {kind}: {error}') from None
        finally:
            loader.dispose()

    def number(self) -> float:
        """Return a number; infinity is one, NaN is not."""
        value = self.value()
        if isinstance(value, bool) or not isinstance(value, int | float) or value != value:
            raise self.error(f'must be a number, is {value!r}')
        try:
            return float(value)
        except OverflowError:
            raise self.error('is too large for a number') from None

    def whole(self, low: int) -> int:
        """Return a whole number that is not below `low`."""
        value = self.value()
        if isinstance(value, bool) or not isinstance(value, int) or value < low:
            raise self.error(f'must be a whole number >= {low}, is {value!r}')
        return value

    def text(self) -> str:
        """Return a text."""
        value = self.value()
        if not isinstance(value, str):
            raise self.error(f'must be a text, is {value!r}')
        return value

    def word(self, allowed: tuple[str, ...]) -> str:
        """Return one of the allowed words."""
        value = self.text()
        if value not in allowed:
            raise self.error(f'{value!r} is none of {", ".join(allowed)}{closest(value, allowed)}')
        return value


def read(path: Path) -> Item:
    """Return the root of a YAML file; raise YamlError when it is no YAML or empty."""
    path = Path(path)
    try:
        node = _compose(path.read_text(encoding='utf-8'))
    except yaml.MarkedYAMLError as error:
        line = error.problem_mark.line + 1 if error.problem_mark else 1
        raise YamlError(f'{path}:{line}: no valid YAML: {error.problem}') from None
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise YamlError(f'{path}:1: no valid YAML: {error}') from None
    except RecursionError:
        raise YamlError(f'{path}:1: is nested too deeply') from None
    if node is None:
        raise YamlError(f'{path}:1: the file is empty')
    return Item(path, '', node)


@lru_cache(maxsize=32)
def _compose(text):
    """Return the root node; the same few files are read again for every run of a program."""
    try:
        # libyaml takes tabs where YAML does not allow them
        if _FAST and '\t' not in text and not _nests_deeply(text):
            return yaml.compose(text, Loader=_FAST)
    except yaml.YAMLError:
        pass  # told in the words of the other parser, however PyYAML was built
    return yaml.compose(text, Loader=yaml.SafeLoader)


def _nests_deeply(text):
    """Return whether collections nest beyond _FAST_DEPTH; the events of a parser are flat."""
    depth = 0
    for event in yaml.parse(text, Loader=_FAST):
        depth += isinstance(event, yaml.CollectionStartEvent)
        depth -= isinstance(event, yaml.CollectionEndEvent)
        if depth > _FAST_DEPTH:
            return True
    return False


def closest(name: str, known: Iterable[str]) -> str:
    """Return '; did you mean ...?' for the known name closest to a misspelt one, or ''."""
    match = difflib.get_close_matches(name, list(known), n=1)
    return f'; did you mean {match[0]!r}?' if match else ''


def _kind(node):
    kinds = {yaml.MappingNode: 'a mapping', yaml.SequenceNode: 'a list'}
    return kinds.get(type(node), f'{node.value!r}')
