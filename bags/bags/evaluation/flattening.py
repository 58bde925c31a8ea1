"""Nested values as single values by dotted name: `overshoots.0.x_m`."""

from collections.abc import Mapping
from typing import Any


def flatten(value: Any, name: str = '') -> dict[str, Any]:
    """Return the single values in mappings and lists by dotted name; `name` begins each."""
    if isinstance(value, Mapping):
        members = value.items()
    elif isinstance(value, list):
        members = enumerate(value)
    else:
        return {name: value}
    flat = {}
    for key, member in members:
        flat |= flatten(member, f'{name}.{key}' if name else str(key))
    return flat
