"""Field paths of the contract, as `poses[*].pose.position.x`: parsed once, then fast to follow.

A step is an attribute, with an optional selector in brackets: `*` takes every element of an
array, a word takes the elements whose namespace (Marker), name (DiagnosticStatus) or key
(KeyValue) matches it; the word may be a pattern as in `cost.*`. A number is an index.
"""

import re
from collections.abc import Callable
from fnmatch import fnmatchcase
from operator import attrgetter
from typing import Any, NamedTuple

_STEP = re.compile(r'([a-z][a-z0-9_]*)(?:\[([A-Za-z0-9_.*]+)\])?')
_PATH = re.compile(rf'{_STEP.pattern}(?:\.{_STEP.pattern})*')
_LABELS = ('ns', 'name', 'key')


class Step(NamedTuple):
    """One step of a path."""

    attribute: str
    selector: str | None


def parse(path: str) -> list[Step]:
    """Return the steps of a path; raise ValueError when it is none."""
    if not _PATH.fullmatch(path):
        raise ValueError(f'{path!r} is no field path such as poses[*].pose.position.x')
    return [Step(*match.groups()) for match in _STEP.finditer(path)]


def getter(path: str) -> Callable[[Any], list]:
    """Return a function that gives every value a path leads to in a message, in order."""
    pieces, names = [], []  # one attrgetter for the plain steps up to a selector: it is fast
    for attribute, selector in parse(path):
        names.append(attribute)
        if selector:
            pieces.append((attrgetter('.'.join(names)), selector))
            names = []
    last = attrgetter('.'.join(names)) if names else None

    def get(message):
        values = [message]
        for arrays, selector in pieces:
            if selector.isdigit():
                values = [array[int(selector)] for array in map(arrays, values)]
                continue
            values = [element for array in map(arrays, values) for element in array]
            if selector != '*':
                values = [value for value in values if fnmatchcase(_label(value), selector)]
        return list(map(last, values)) if last else values

    return get


def _label(element):
    for attribute in _LABELS:
        if hasattr(element, attribute):
            return getattr(element, attribute)
    raise TypeError(f'{type(element).__name__} has no namespace, name or key to select by')
