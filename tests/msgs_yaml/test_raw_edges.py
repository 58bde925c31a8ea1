"""Edges read from their bytes are those of their message; sent again, those made anew."""

import random

import facts
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from std_msgs.msg import ColorRGBA

from msgs_yaml import decode, encode, raw_edges
from msgs_yaml.decode import DecodeError
from node_runtime import facts_node, ros

TOPIC = raw_edges.TOPIC
MOST_NS = 2**32 - 1  # that a message can hold beside the seconds
SHORT = facts.edges(points=3)


def slowly(raw):
    """Return what the message of the bytes says."""
    return decode.road_edges(ros.message(TOPIC, raw))


def outcome(read, raw):
    """Return what is read, or the error for which it is not."""
    try:
        return read(raw)
    except DecodeError as error:
        return error


@pytest.mark.parametrize('points', [2, 3, 5000])
@pytest.mark.parametrize('stamp_ns', [1, facts.LATER_NS])
def test_bytes_and_message_say_the_same_to_the_last_bit(points, stamp_ns):
    raw = facts.raw_edges(points=points, stamp_ns=stamp_ns)
    assert facts.same(raw_edges.read(raw), slowly(raw))


@pytest.mark.parametrize('left', ['', 'a', 'text', 'longer text'])
def test_fields_that_do_not_matter_may_hold_anything(left):
    message = encode.road_edges(SHORT)
    for marker, text in zip(message.markers, (left, 'right')):
        marker.colors = [ColorRGBA(r=1.0)] * 3
        marker.text = marker.mesh_resource = marker.texture_resource = text
        marker.texture.format, marker.texture.data = text, text.encode()
        marker.mesh_file.filename, marker.mesh_file.data = text, text.encode()
        marker.frame_locked = marker.mesh_use_embedded_materials = True
    raw = ros.serialized(message)
    assert facts.same(raw_edges.read(raw), slowly(raw))
    after = raw_edges.restamped(raw, facts.LATER_NS)
    assert slowly(after).stamp_ns == facts.LATER_NS


def test_the_order_of_the_sides_does_not_matter():
    message = encode.road_edges(SHORT)
    message.markers.reverse()
    assert facts.same(raw_edges.read(ros.serialized(message)), SHORT)


@pytest.mark.parametrize('seed', range(300))
def test_harmed_bytes_are_read_or_refused_as_their_message_is(seed):
    chance = random.Random(seed)
    raw = bytearray(ros.serialized(encode.road_edges(SHORT)))
    for _ in range(chance.randint(1, 3)):
        raw[chance.randrange(len(raw))] ^= 1 << chance.randrange(8)
    if seed % 10 == 0:
        del raw[chance.randrange(len(raw)) :]
    raw = bytes(raw)
    expected, found = outcome(slowly, raw), outcome(facts_node.read_edges, raw)
    if isinstance(expected, DecodeError):
        assert raw_edges.read(raw) is None
        assert type(found) is DecodeError
    else:
        assert facts.same(found, expected)


@settings(deadline=None, derandomize=True)
@given(
    sec=st.lists(st.integers(-6, 3), min_size=2, max_size=2),
    nanosec=st.integers(0, MOST_NS),
)
@example(sec=[-1, -1], nanosec=1_500_000_000)
@example(sec=[1, -1], nanosec=4_000_000_000)
def test_any_stamp_is_read_or_refused_as_that_of_the_message_is(sec, nanosec):
    message = encode.road_edges(SHORT)
    for marker, own in zip(message.markers, sec):
        marker.header.stamp.sec, marker.header.stamp.nanosec = own, nanosec
    raw = ros.serialized(message)
    expected, found = outcome(slowly, raw), raw_edges.read(raw)
    if isinstance(expected, DecodeError):
        assert found is None
    else:
        assert facts.same(outcome(facts_node.read_edges, raw), expected)


@pytest.mark.parametrize(
    ('name', 'value', 'says'),
    [
        ('ns', 'right', 'markers are both'),
        ('ns', 'middle', "ns is 'middle'"),
        ('type', 5, 'type is 5'),
        ('action', 2, 'action is 2'),
        ('points', [], '0 long'),
    ],
)
def test_edges_that_break_the_contract_are_refused_with_their_reason(name, value, says):
    message = encode.road_edges(SHORT)
    setattr(message.markers[0], name, value)
    raw = ros.serialized(message)
    assert raw_edges.read(raw) is None
    with pytest.raises(DecodeError, match=says):
        facts_node.read_edges(raw)


@pytest.mark.parametrize('points', [2, 5000])
def test_another_stamp_gives_the_message_made_anew(points):
    before = facts.raw_edges(points=points)
    after = raw_edges.restamped(before, facts.LATER_NS)
    anew = facts.raw_edges(points=points, stamp_ns=facts.LATER_NS)
    assert ros.message(TOPIC, after) == ros.message(TOPIC, anew)


def test_what_is_no_pair_of_edges_gets_no_stamp():
    with pytest.raises(ValueError, match='no serialised /scenario/road_edges'):
        raw_edges.restamped(facts.raw_edges(points=3)[:-20], facts.S)


def test_the_longest_edges_take_a_tenth_of_the_time_of_their_message():
    raw, edges = facts.raw_edges(), facts.edges()
    read_s = facts.processor_s(lambda: facts_node.read_edges(raw))
    assert read_s < 0.1 * facts.processor_s(lambda: slowly(raw), 2)
    sent_s = facts.processor_s(lambda: raw_edges.restamped(raw, facts.S))
    assert sent_s < 0.1 * facts.processor_s(lambda: ros.serialized(encode.road_edges(edges)), 2)
