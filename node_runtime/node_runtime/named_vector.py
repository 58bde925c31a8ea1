"""Named vectors: nested named tuples and dataclasses as flat sequences, in field order.

One description serves the equations (leaves are CasADi symbols), compiled code (leaves are slots
of an array) and tables (leaves are columns); no index is ever typed. A template is a type whose
annotations name the nested types, or an instance, in which a plain tuple counts its members from 0:

    names(State)               # ('planar.X', 'planar.Y', ..., 'wheels.fl.omega', ...)
    state = build(State, values)
    leaves(state)              # the values again
"""

from collections.abc import Iterable
from dataclasses import fields, is_dataclass
from functools import cache
from typing import Any, get_type_hints


def leaves(value: Any) -> list:
    """Return the leaves of an instance in the order of `names`."""
    if _is_leaf(type(value)):
        return [value]
    if isinstance(value, tuple):
        children = value
    else:
        children = [getattr(value, field.name) for field in fields(value)]
    flat: list = []
    for child in children:  # a call per leaf would take most of the time
        if _is_leaf(type(child)):
            flat.append(child)
        else:
            flat += leaves(child)
    return flat


@cache
def _is_leaf(kind: type) -> bool:
    return not issubclass(kind, tuple) and not is_dataclass(kind)


def names(template: Any) -> tuple[str, ...]:
    """Return the dotted names of the leaves of a template."""
    return tuple(
        f'{name}.{rest}' if rest else str(name)
        for name, child in _children(template).items()
        for rest in (names(child) if _children(child) is not None else ('',))
    )


def build(template: Any, values: Iterable) -> Any:
    """Return an instance with these leaves. Raises ValueError when their number is wrong."""
    given = list(values)
    remaining = iter(given)
    try:
        result = _build(template, remaining)
    except StopIteration:
        result = None
    if result is None or next(remaining, None) is not None:
        kind, count = _kind(template), len(names(template))
        raise ValueError(f'{kind.__name__} has {count} numbers, got {len(given)}')
    return result


def _build(template, remaining):
    if isinstance(template, tuple):  # the most frequent, without a dict of its fields
        values = [_build(child, remaining) for child in template]
        return tuple(values) if type(template) is tuple else type(template)(*values)
    children = _children(template)
    if children is None:
        return next(remaining)
    # a list: in a generator StopIteration would become another error
    return _kind(template)(*[_build(child, remaining) for child in children.values()])


def _kind(template):
    return template if isinstance(template, type) else type(template)


def _children(template) -> dict[str | int, Any] | None:
    """Return the fields of a nested template with their templates, None for a leaf."""
    if isinstance(template, type):
        return _fields_of(template)
    if isinstance(template, tuple):
        return dict(zip(getattr(template, '_fields', range(len(template))), template))
    if is_dataclass(template):
        return {field.name: getattr(template, field.name) for field in fields(template)}
    return None


@cache
def _fields_of(kind: type) -> dict[str, Any] | None:
    if not is_dataclass(kind) and not hasattr(kind, '_fields'):
        return None
    hints = get_type_hints(kind)
    listed = [field.name for field in fields(kind)] if is_dataclass(kind) else kind._fields
    return {name: hints[name] for name in listed}
