"""Definition text and type hash are those every other tool computes."""

import pytest
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from bags.storage.message_definitions import schema_text, type_hash
from msgs_yaml import contract

TYPES = sorted({topic.type for topic in contract.load().topics.values()})


@pytest.mark.parametrize('type_name', TYPES)
def test_text_and_hash_agree_by_an_independent_computation(type_name):
    store = get_typestore(Stores.EMPTY)
    store.register(get_types_from_msg(schema_text(type_name), type_name))
    assert store.hash_rihs01(type_name) == type_hash(type_name)


@pytest.mark.parametrize('type_name', TYPES)
def test_hash_is_the_one_of_jazzy(type_name):
    jazzy = get_typestore(Stores.ROS2_JAZZY)
    assert type_hash(type_name) == jazzy.hash_rihs01(type_name)


def test_every_dependency_stands_in_the_text_once():
    text = schema_text('visualization_msgs/msg/MarkerArray')
    names = [line.removeprefix('MSG: ') for line in text.splitlines() if line.startswith('MSG: ')]
    assert len(names) == len(set(names))
    assert {'visualization_msgs/Marker', 'std_msgs/Header', 'builtin_interfaces/Time'} <= set(names)


def test_unknown_package_is_named_with_the_places_searched():
    with pytest.raises(FileNotFoundError, match=r'Nothing\.msg of package no_msgs is in none of'):
        schema_text('no_msgs/msg/Nothing')
