"""Field paths of the contract, as `poses[*].pose.position.x`: parsed once, then fast to follow.

A step is an attribute, with an optional selector in brackets: `*` takes every element of an
array, a word takes the elements whose namespace (Marker), name (DiagnosticStatus) or key
(KeyValue) matches it; the word may be a pattern as in `cost.*`.
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
    return _follow(parse(path))


def _follow(steps):
    # one attrgetter for the plain steps up to the next selector: they cost the time
    plain = 0
    while plain < len(steps) and steps[plain].selector is None:
        plain += 1
    if plain == len(steps):
        last = attrgetter('.'.join(step.attribute for step in steps))
        return lambda msg: [last(msg)]
    array = attrgetter('.'.join(step.attribute for step in steps[: plain + 1]))
    choose = _chooser(steps[plain].selector)
    rest = steps[plain + 1 :]
    if not rest:
        return lambda msg: choose(array(msg))
    if all(step.selector is None for step in rest):
        last = attrgetter('.'.join(step.attribute for step in rest))
        return lambda msg: [last(element) for element in choose(array(msg))]
    inner = _follow(rest)
    return lambda msg: [value for element in choose(array(msg)) for value in inner(element)]


def _chooser(pattern):
    if pattern == '*':
        return list
    return lambda array: [e for e in array if fnmatchcase(_label(e), pattern)]


def _label(element):
    for attribute in _LABELS:
        if hasattr(element, attribute):
            return getattr(element, attribute)
    raise TypeError(f'{type(element).__name__} has no namespace, name or key to select by')
