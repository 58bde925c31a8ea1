"""What can be set, as text: each parameter with type, unit, range, default and meaning.

Everything comes from where it is defined: type and range from the annotation of a field; its
meaning from the comment behind its value in the parameter file, else from the comment at the field;
that of a group from the docstring of its dataclass.
"""

import dataclasses
import inspect
import re
import textwrap
import typing
from collections.abc import Mapping
from functools import cache
from typing import Any, NamedTuple

from node_runtime import parameters
from node_runtime.parameters import ParameterFile, Range

LEFT_OUT = 'left out'
_FIELD = re.compile(r' {4}(\w+): ')
_KIND_NAMES = {bool: 'true or false', int: 'whole number', float: 'number', str: 'text'}
_SYMBOL = r'(?:ms|MB|Pa|kg|rad|deg|m|s|N)(?:\^\d)?'
# the unit at the head of a text such as `rad/s, 20 deg/s` or `m ahead of the CoG`
_UNIT = re.compile(
    rf'(-|1/m\^2|1/m|N/\(m/s\)\^2|{_SYMBOL}(?:[ /]{_SYMBOL}(?![A-Za-z]))*)(?=$|[ ,;:])[ ,;:]*'
)


class ParameterDoc(NamedTuple):
    """One parameter as a person needs it."""

    name: str  # dotted
    kind: str  # in words, as `list of number`
    unit: str  # `-` without a unit
    low: float | None  # of a number, in its unit
    high: float | None
    words: tuple[str, ...]  # of a text with a choice
    default: Any  # None where it is left out
    optional: bool  # whether it may be left out
    meaning: str

    @property
    def group(self) -> str:
        """The dotted name of the block that holds it, '' at the top."""
        return self.name.rpartition('.')[0]

    @property
    def allowed(self) -> str:
        """The allowed values as text, without the unit."""
        if self.low is None:
            return ' or '.join(self.words) or self.kind
        return f'{self.low:g} to {self.high:g}'

    @property
    def default_text(self) -> str:
        """The default as YAML would have it."""
        if self.default is None:
            return LEFT_OUT if self.optional else 'none: must be given'
        if isinstance(self.default, bool):
            return str(self.default).lower()
        if isinstance(self.default, list | tuple):
            return f'[{", ".join(f"{value:g}" for value in self.default)}]'
        return f'{self.default:g}' if isinstance(self.default, float) else str(self.default)


class GroupDoc(NamedTuple):
    """A block of parameters, the parameters directly in it, and what it is about."""

    name: str  # dotted, '' for the top
    meaning: str  # the first paragraph of the docstring
    parameters: tuple[ParameterDoc, ...]


def describe(cls: type, file: ParameterFile | None = None) -> tuple[GroupDoc, ...]:
    """Return every group of a parameter dataclass in the order of its fields, the top first.

    `file` holds the defaults and comments, from `parameters.read_file`; without it there are none.
    """
    values, comments = (file.values, file.comments) if file else ({}, {})
    return tuple(_groups(cls, '', values, comments, {}))


def _groups(cls, prefix, values: Mapping[str, Any], comments: Mapping[str, str], meanings):
    """Yield the groups; `meanings` are those of fields that another group of this class has."""
    hints = typing.get_type_hints(cls, include_extras=True)
    leaves, notes = parameters.leaves(cls), field_comments(cls)
    rows = []
    for name, hint in hints.items():
        if not dataclasses.is_dataclass(hint):
            full, leaf = f'{prefix}{name}', leaves[name]
            is_number = isinstance(leaf.rule, Range)
            unit, remark = split_unit(leaf.rule.unit) if is_number else ('', '')
            first = split_unit(comments.get(full, ''), unit)[1] or remark
            second = notes.get(name, '')
            # what one of them says of the other is left out
            if first.lower() in second.lower():
                meaning = second
            else:
                said = not second or second.lower() in first.lower()
                meaning = first if said else f'{first}; {second}'
            meanings[cls, name] = meaning = meaning or meanings.get((cls, name), '')
            rows.append(
                ParameterDoc(
                    full,
                    f'{"list of " if leaf.many else ""}{_KIND_NAMES[leaf.kind]}',
                    unit or '-',
                    leaf.rule.low if is_number else None,
                    leaf.rule.high if is_number else None,
                    () if is_number or leaf.rule is None else leaf.rule.words,
                    values.get(full),
                    leaf.optional,
                    meaning,
                )
            )
    paragraph = (cls.__doc__ or '').strip().partition('\n\n')[0]
    if rows:
        yield GroupDoc(prefix.rstrip('.'), ' '.join(paragraph.split()), tuple(rows))
    for name, hint in hints.items():
        if dataclasses.is_dataclass(hint):
            yield from _groups(hint, f'{prefix}{name}.', values, comments, meanings)


def split_unit(text: str, expected: str = '') -> tuple[str, str]:
    """Return the unit at the head of a text and the rest: ('m', 'ahead of the CoG').

    Without a unit that is '-' and the whole text. With an `expected` unit, another one is text.
    """
    match = _UNIT.match(text)
    if match is None or (expected and match[1] not in (expected, '-')):
        return '-', text
    return match[1], text[match.end() :]


@cache
def field_comments(cls: type) -> dict[str, str]:
    """Return by field of a dataclass the comment behind it or on the lines before it.

    Empty where the source is not at hand.
    """
    try:
        lines = inspect.getsource(cls).splitlines()
    except (OSError, TypeError):
        return {}
    comments, before, field = {}, [], ''
    for line in textwrap.dedent('\n'.join(lines)).splitlines():
        code, _, comment = line.partition('#')
        begins = _FIELD.match(code)
        if begins or (field and code.strip() and code[4:5] in ' )]'):
            field = begins[1] if begins else field
            words = [comments.get(field, ''), *before, comment.strip()]
            comments[field], before = ' '.join(filter(None, words)), []
        elif comment:
            before.append(comment.strip())
        else:
            before, field = [], ''
    return comments
