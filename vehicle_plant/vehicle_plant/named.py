"""Named vectors: nested NamedTuples and dataclasses of numbers, flattened in field order.

One description serves the equations (leaves are CasADi symbols), the compiled step (leaves are
slots of an array) and the record (leaves are columns); nobody counts indices.
"""

from collections.abc import Iterator
from dataclasses import fields, is_dataclass
from functools import cache
from typing import Any, get_type_hints


def _children(kind: type) -> dict[str, type] | None:
    """Return the fields of a nested kind, or None for a leaf."""
    if is_dataclass(kind):
        hints = get_type_hints(kind)
        return {field.name: hints[field.name] for field in fields(kind)}
    return get_type_hints(kind) if hasattr(kind, '_fields') else None


@cache
def names(kind: type) -> tuple[str, ...]:
    """Return the dotted names of all leaves of a NamedTuple or dataclass type."""
    children = _children(kind)
    return tuple(
        f'{name}.{rest}' if rest else name
        for name, child in children.items()
        for rest in (names(child) if _children(child) is not None else ('',))
    )


def leaves(value: Any) -> list:
    """Return all leaves of a NamedTuple or dataclass instance, in the order of `names`."""
    children = _children(type(value))
    if children is None:
        return [value]
    return [leaf for name in children for leaf in leaves(getattr(value, name))]


def build(kind: type, values: Any) -> Any:
    """Build a NamedTuple or dataclass from its leaves. Raises ValueError when they do not fit."""
    numbers = list(values)
    if len(numbers) != len(names(kind)):
        raise ValueError(f'{kind.__name__} has {len(names(kind))} numbers, got {len(numbers)}')
    return _take(kind, iter(numbers))


def _take(kind: type, values: Iterator) -> Any:
    children = _children(kind)
    if children is None:
        return next(values)
    return kind(**{name: _take(child, values) for name, child in children.items()})
