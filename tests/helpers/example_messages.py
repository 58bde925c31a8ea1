"""The valid messages of msgs_yaml/examples, and messages of values."""

from importlib import import_module
from typing import Any

import yaml

from msgs_yaml import encode, share
from node_runtime import ros


def load_example(topic: str) -> Any:
    """Return the example message of a topic."""
    name = topic.strip('/').replace('/', '-')
    text = share.path('msgs_yaml', 'examples', f'{name}.yaml').read_text()
    return fill(ros.message_type(topic)(), yaml.safe_load(text))


def fill(message: Any, values: dict) -> Any:
    """Set the fields of a message from a mapping and return it.

    Raises KeyError for an unknown field, AssertionError for a wrong type.
    """
    for name, value in values.items():
        declared = message.get_fields_and_field_types()[name]
        current = getattr(message, name)
        if isinstance(value, dict):
            fill(current, value)
        elif isinstance(value, list) and '/' in declared:
            package, kind = declared.removeprefix('sequence<').removesuffix('>').split('/')
            cls = getattr(import_module(f'{package}.msg'), kind)
            setattr(message, name, [fill(cls(), element) for element in value])
        else:
            assert isinstance(value, (list, type(current))), f'{name}: {value!r}'
            setattr(message, name, value)
    return message


def encoded(topic: str, value: Any) -> Any:
    """Return the message of a value of a topic of the contract."""
    name = 'health' if topic == '/diagnostics' else topic.rpartition('/')[2]
    return getattr(encode, name)(value)
