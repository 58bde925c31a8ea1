"""The bytes of a template are those of the serialised message."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rclpy.serialization import serialize_message
from rosbags.typesys import Stores, get_typestore

from msgs_yaml import cdr_templates, contract, decode, encode, flat_fields
from msgs_yaml.types import Actuators, Command, Imu, VehicleState, Wheels
from node_runtime import ros

STORE = get_typestore(Stores.ROS2_JAZZY)
STAMP = st.integers(0, 2**31 * 10**9 - 1)
# every bit pattern that is a number, infinities included
F = st.floats(allow_nan=False)
QUAD = st.tuples(F, F, F, F)
VALUES = {
    '/vehicle/odometry': st.builds(VehicleState, STAMP, F, F, st.floats(-10, 10), F, F, F),
    '/vehicle/imu': st.builds(Imu, STAMP, F, F, F, F),
    '/vehicle/actuators': st.builds(Actuators, STAMP, F, F, F, F, QUAD),
    '/vehicle/wheels': st.builds(Wheels, STAMP, *[QUAD] * 7),
    '/controller/command': st.builds(Command, STAMP, F, F, F, F),
}


def encoded(topic, value):
    return getattr(encode, topic.rsplit('/', 1)[1])(value)


@pytest.mark.parametrize('topic', sorted(VALUES))
def test_patched_bytes_are_the_serialised_message(topic):
    template, kind = cdr_templates.Template(topic), contract.load().topics[topic].type

    @settings(max_examples=50)
    @given(VALUES[topic])
    def check(value):
        patched, message = template.fill(value), encoded(topic, value)
        # rclpy leaves in its padding what was in memory; rosbags writes zeros there
        through_rclpy = STORE.deserialize_cdr(serialize_message(message), kind)
        assert patched == bytes(STORE.serialize_cdr(through_rclpy, kind))
        assert len(patched) == len(serialize_message(message))
        assert ros.deserialize(topic, patched) == message

    check()


def test_every_topic_with_a_template_is_tested():
    assert set(VALUES) == set(flat_fields.TYPES)


def test_a_filled_message_is_not_changed_by_the_next():
    template = cdr_templates.Template('/controller/command')
    first = template.fill(Command(1, 0.1, 0.2, 0.3, 0.4))
    copy = bytes(first)
    template.fill(Command(2, 1.1, 1.2, 1.3, 1.4))
    assert first == copy


def test_a_topic_without_a_fixed_length_has_no_template():
    with pytest.raises(KeyError):
        cdr_templates.Template('/scenario/reference')


def decoded(topic, raw):
    """Return what the checked way through a message object gives, None if it refuses."""
    try:
        return getattr(decode, topic.rsplit('/', 1)[1])(ros.deserialize(topic, raw))
    except decode.DecodeError:
        return None


def bits(value):
    return None if value is None else [np.asarray(field).tobytes() for field in value]


@pytest.mark.parametrize('topic', sorted(VALUES))
def test_a_message_is_read_to_the_last_bit_as_it_is_decoded_or_refused(topic):
    template = cdr_templates.Template(topic)

    @settings(max_examples=100)
    @given(VALUES[topic])
    def check(value):
        raw = template.fill(value)
        assert bits(template.read(raw)) == bits(decoded(topic, raw))

    check()


def test_a_state_within_its_ranges_is_read():
    state = VehicleState(5, 1.0, -2.0, 0.5, 20.0, -0.5, 0.1)
    template = cdr_templates.Template('/vehicle/odometry')
    assert template.read(template.fill(state)) == decode.odometry(encode.odometry(state))


@settings(max_examples=300)
@given(st.integers(0, 10**4), st.integers(0, 255), st.integers(-4, 4))
def test_changed_bytes_are_never_read_as_another_state_than_they_decode_to(place, byte, longer):
    template = cdr_templates.Template('/vehicle/odometry')
    raw = bytearray(template.fill(VehicleState(5, 1.0, -2.0, 0.5, 20.0, -0.5, 0.1)))
    raw[place % len(raw)] = byte
    raw = bytes(raw)[: len(raw) + min(longer, 0)] + bytes(max(longer, 0))
    value = template.read(raw)
    assert value is None or bits(value) == bits(decoded('/vehicle/odometry', raw))


@pytest.mark.parametrize('change', ['z', 'frame', 'covariance', 'unit', 'nan', 'stamp'])
def test_a_state_that_needs_the_checked_way_is_not_read(change):
    message = encode.odometry(VehicleState(5, 1.0, -2.0, 0.5, 20.0, -0.5, 0.1))
    template = cdr_templates.Template('/vehicle/odometry')
    if change == 'z':
        message.pose.pose.position.z = 0.5
    elif change == 'frame':
        message.header.frame_id = 'mop'
    elif change == 'covariance':
        message.pose.covariance[7] = 0.1
    elif change == 'unit':
        message.pose.pose.orientation.w = 0.2
    elif change == 'nan':
        message.twist.twist.linear.x = math.nan
    else:
        message.header.stamp.nanosec = 0
    kind = contract.load().topics['/vehicle/odometry'].type
    through_rclpy = STORE.deserialize_cdr(serialize_message(message), kind)
    assert template.read(bytes(STORE.serialize_cdr(through_rclpy, kind))) is None
