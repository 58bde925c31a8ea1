"""The page about the keys of a scenario file, from the types of its schema."""

import dataclasses
import inspect
import types
import typing

from plain_docstrings import class_fields

from msgs_yaml import strict_yaml
from reference_pages.markdown import code, table, text
from scenario_publisher import schema

UNIONS = (typing.Union, types.UnionType)


def page(root: type = schema.File) -> str:
    """Return the page: a table for the file and for each kind of block in it."""
    parts = [
        '# Keys of a scenario file',
        'From the types of `scenario_publisher.schema`. [Scenarios](../../scenarios.md) explains '
        'them, with a complete example.',
    ]
    for name, cls in blocks(root).items():
        allowed_default = strict_yaml.defaults(cls)
        meanings = {field.name: field.meaning for field in class_fields(schema).get(name, ())}
        rows = [
            (code(key), text(meanings.get(key, '')), _kind(hint), _default(allowed_default, key))
            for key, hint in strict_yaml.field_types(cls).items()
        ]
        about = inspect.getdoc(cls) or ''
        if about.startswith(f'{cls.__name__}('):  # of a dataclass without one
            about = 'A block with one key.'
        parts += [f'## {name}', text(about), table(('key', 'meaning', 'value', 'default'), rows)]
    return '\n\n'.join(parts) + '\n'


def blocks(root: type) -> dict[str, type]:
    """Return every dataclass that a file of a schema may hold, by its name, the root first."""
    found, waiting = {}, [root]
    while waiting:
        cls = waiting.pop(0)
        if cls.__name__ in found:
            continue
        found[cls.__name__] = cls
        for hint in strict_yaml.field_types(cls).values():
            waiting += [leaf for leaf in _leaves(hint) if dataclasses.is_dataclass(leaf)]
    return found


def _leaves(hint):
    """Yield the types that a hint of lists and unions is made of."""
    arguments = typing.get_args(hint)
    if typing.get_origin(hint) in (*UNIONS, tuple):
        for argument in arguments:
            yield from _leaves(argument)
    else:
        yield hint


def _kind(hint):
    """Return the allowed values of a hint, with links to blocks."""
    origin, arguments = typing.get_origin(hint), typing.get_args(hint)
    if dataclasses.is_dataclass(hint):
        return f'[{hint.__name__}](#{hint.__name__.lower().replace("_", "-")})'
    if origin in UNIONS:
        return ' or '.join(_kind(kind) for kind in arguments if kind is not types.NoneType)
    if origin is tuple and arguments[-1] is Ellipsis:
        return f'list of {_kind(arguments[0])}'
    if origin is tuple:
        return f'[{", ".join(map(_kind, arguments))}]'.replace('[', r'\[', 1)
    allowed = strict_yaml.describe_allowed(hint)
    return text(allowed or getattr(hint, '__name__', str(hint)))


def _default(defaults, key):
    if key not in defaults:
        return ''
    value = defaults[key]
    if value is None or dataclasses.is_dataclass(value):
        return 'may be left out'
    if value == float('inf'):
        return 'never'
    return text(value) if value != () else 'none'
