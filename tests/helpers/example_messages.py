"""The valid messages of msgs_yaml/examples, messages of values, values of messages and of bytes."""

import struct
from functools import cache
from importlib import import_module
from typing import Any

import yaml
from rclpy.serialization import serialize_message
from rosbags.serde import SerdeError
from rosbags.typesys import Stores, get_typestore

from msgs_yaml import contract, decode, encode, flat_fields, raw_scenario, share
from node_runtime import ros

# readers of bytes without a message object, by topic; they return None for what they refuse
FAST = {topic: flat_fields.load(topic).read for topic in flat_fields.TYPES} | {
    raw_scenario.REFERENCE: raw_scenario.read_reference,
    raw_scenario.ROAD_EDGES: raw_scenario.read_road_edges,
}


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


def put(message: Any, path: str, value: Any) -> Any:
    """Set a field of a message by its path, as `poses.1.header.stamp.sec`; return the message."""
    *parents, last = path.split('.')
    owner = message
    for name in parents:
        owner = owner[int(name)] if name.isdigit() else getattr(owner, name)
    if last.isdigit():
        owner[int(last)] = value
    else:
        setattr(owner, last, value)
    return message


def encoded(topic: str, value: Any) -> Any:
    """Return the message of a value of a topic of the contract."""
    return getattr(encode, _function(topic))(value)


def decoded(topic: str, message: Any) -> Any:
    """Return the value of a message of a topic of the contract. Raises DecodeError."""
    return getattr(decode, _function(topic))(message)


def _function(topic):
    own = {'/diagnostics': 'health', '/estimator/odometry': 'estimate'}
    return own.get(topic, topic.rpartition('/')[2])


@cache
def ros_types() -> Any:
    """Return what rosbags knows of the messages of ROS 2 Jazzy."""
    return get_typestore(Stores.ROS2_JAZZY)


def canonical(topic: str, message: Any) -> bytes:
    """Return a serialised message with 0 in its padding, where rclpy leaves what was in memory."""
    store, kind = ros_types(), contract.load().topics[topic].type
    raw = serialize_message(message)
    for length in range(len(raw), len(raw) - 8, -1):  # it may leave junk behind the message, too
        try:
            return bytes(store.serialize_cdr(store.deserialize_cdr(raw[:length], kind), kind))
        except (SerdeError, struct.error, IndexError, ValueError):
            continue
    raise AssertionError(f'rosbags reads no {kind} in {raw!r}')
