"""Every path in topics.yaml leads to a number or text of its message definition."""

from importlib import import_module

import pytest

from msgs_yaml import contract, field_paths
from node_runtime import ros

NUMBERS = ('double', 'float', 'int32', 'uint32', 'int64')
FIELDS = [(t.name, path) for t in contract.load().topics.values() for path in t.fields]
SIZES = [(t.name, path) for t in contract.load().topics.values() for path in t.sizes]


def end_type(cls, path):
    """Return the type name at the end of a path; fail where the message has no such field."""
    declared = None
    for step in field_paths.parse(path):
        declared = cls.get_fields_and_field_types()[step.attribute]
        is_array = declared.startswith('sequence<') or declared.endswith(']')
        assert is_array == (step.selector is not None), f'{path}: {step.attribute} is {declared}'
        declared = declared.removeprefix('sequence<').removesuffix('>').partition('[')[0]
        if '/' in declared:
            package, name = declared.split('/')
            cls = getattr(import_module(f'{package}.msg'), name)
    return declared


@pytest.mark.parametrize(('topic', 'path'), FIELDS)
def test_a_field_exists_in_its_message_and_is_a_number(topic, path):
    wanted = ('string',) if contract.load().topics[topic].type == contract.DIAGNOSTICS else NUMBERS
    assert end_type(ros.message_type(topic), path) in wanted


@pytest.mark.parametrize(('topic', 'path'), SIZES)
def test_a_sized_array_exists_in_its_message(topic, path):
    assert '/' in end_type(ros.message_type(topic), f'{path}[*]')


def test_a_path_that_leads_nowhere_is_noticed():
    with pytest.raises(KeyError):
        end_type(ros.message_type('/vehicle/odometry'), 'pose.pose.positon.x')
    with pytest.raises(AssertionError):
        end_type(ros.message_type('/scenario/reference'), 'poses.pose.position.x')


@pytest.mark.parametrize('topic', contract.load().topics)
def test_frames_are_given_where_the_message_has_them(topic):
    has = 'child_frame_id' in ros.message_type(topic).get_fields_and_field_types()
    assert has == (contract.load().topics[topic].child_frame is not None)
