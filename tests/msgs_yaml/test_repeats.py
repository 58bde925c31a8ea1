"""Paths and edges are sent again under another stamp, and repeats are told from new ones."""

import long_paths
import numpy as np
import pytest
from example_messages import FAST, canonical, decoded, encoded
from std_msgs.msg import ColorRGBA
from visualization_msgs.msg import Marker

from msgs_yaml import contract, encode, raw_scenario
from msgs_yaml.decode import DecodeError
from msgs_yaml.raw_scenario import REFERENCE, ROAD_EDGES, repeated_ns
from msgs_yaml.types import Obstacle, Obstacles
from node_runtime import ros, subscriptions_node

S = 1_000_000_000
MAKE = {REFERENCE: long_paths.path, ROAD_EDGES: long_paths.edges}
RESTAMP = {
    REFERENCE: raw_scenario.restamp_reference,
    ROAD_EDGES: raw_scenario.restamp_road_edges,
}
READ = {
    REFERENCE: subscriptions_node.read_reference,
    ROAD_EDGES: subscriptions_node.read_road_edges,
}
both = pytest.mark.parametrize('topic', MAKE)


def raw_of(topic, *given, **named):
    return canonical(topic, encoded(topic, MAKE[topic](*given, **named)))


@both
@pytest.mark.parametrize('number', [2, 3, 51, 500])
def test_restamping_gives_the_message_built_anew_and_it_is_a_repeat(topic, number):
    raw = raw_of(topic, number)
    for stamp_ns in (1, 4 * S, long_paths.LATER_NS):
        after = RESTAMP[topic](raw, stamp_ns)
        assert after == raw_of(topic, number, stamp_ns=stamp_ns)
        assert repeated_ns(topic, after, raw) == stamp_ns
        value = FAST[topic](after)
        assert long_paths.are_equal(value, decoded(topic, ros.deserialize(topic, after)))
        assert type(value.stamp_ns) is int
    assert topic == ROAD_EDGES or len(raw) == raw_scenario.reference_size(number)


@pytest.mark.parametrize('now_ns', [1, 1_795_000_000_987_654_321])
def test_poses_without_a_stamp_stay_so_in_a_repeat(now_ns):
    message = encode.reference(long_paths.path(4, now_ns))
    for pose in message.poses:
        pose.header.stamp.sec = pose.header.stamp.nanosec = 0
    raw = canonical(REFERENCE, message)
    message.header.stamp.sec += 1
    later = canonical(REFERENCE, message)
    assert repeated_ns(REFERENCE, later, raw) == now_ns + S
    assert raw_scenario.restamp_reference(raw, now_ns + S) == later


@both
def test_any_other_byte_that_differs_is_another_message(topic):
    old = raw_of(topic, 3)
    padding = range(*raw_scenario.PADDING.indices(99)) if topic == REFERENCE else ()
    for place in sorted(set(range(len(old))) - set(padding)):  # one of the stamps, too
        new = bytearray(old)
        new[place] ^= 1
        assert not repeated_ns(topic, bytes(new), old), place


@both
@pytest.mark.parametrize('cut', [0, 1, 4, 50, -72, -20, -1])
def test_a_cut_or_first_message_is_no_repeat_and_is_not_restamped(topic, cut):
    raw = raw_of(topic, 4)
    assert not repeated_ns(topic, raw, None)
    assert not repeated_ns(topic, raw, raw_of(topic, 3))
    assert not repeated_ns(topic, raw[:cut], raw[:cut])
    with pytest.raises(ValueError, match=f'no serialised {topic}'):
        RESTAMP[topic](raw[:cut], S)


@pytest.mark.parametrize('left', ['', 'a', 'text', 'longer text'])
def test_fields_of_a_marker_that_do_not_matter_may_hold_anything_in_either_order(left):
    message = encode.road_edges(long_paths.edges(3))
    for marker, text in zip(message.markers, (left, 'right')):
        marker.colors = [ColorRGBA(r=1.0)] * 3
        marker.text = marker.mesh_resource = marker.texture_resource = text
        marker.texture.format, marker.texture.data = text, text.encode()
        marker.mesh_file.filename, marker.mesh_file.data = text, text.encode()
        marker.frame_locked = marker.mesh_use_embedded_materials = True
    message.markers.reverse()
    raw = ros.serialize(message)
    assert long_paths.are_equal(raw_scenario.read_road_edges(raw), long_paths.edges(3))
    after = raw_scenario.restamp_road_edges(raw, long_paths.LATER_NS)
    assert decoded(ROAD_EDGES, ros.deserialize(ROAD_EDGES, after)).stamp_ns == long_paths.LATER_NS


@both
def test_a_long_message_takes_a_tenth_of_the_time_of_its_object(topic):
    value = MAKE[topic](5000)
    raw = ros.serialize(encoded(topic, value))
    read_s = long_paths.min_cpu_s(lambda: READ[topic](raw))
    by_object_s = long_paths.min_cpu_s(lambda: decoded(topic, ros.deserialize(topic, raw)), 2)
    assert read_s < 0.1 * by_object_s
    sent_s = long_paths.min_cpu_s(lambda: RESTAMP[topic](raw, S))
    built_s = long_paths.min_cpu_s(lambda: ros.serialize(encoded(topic, value)), 2)
    assert sent_s < 0.1 * built_s


def swollen(topic, value, many):
    message = encoded(topic, value)
    message.markers = list(message.markers) * many
    return ros.serialize(message)


def too_long(topic):
    message = encoded(topic, MAKE[topic](2))
    if topic == REFERENCE:
        message.poses = list(message.poses) * 20_001
    else:
        message.markers[0].points = list(message.markers[0].points) * 50_000
    return ros.serialize(message)


def wrong(topic):
    """Return a long message with one number or field that violates the contract."""
    message = encoded(topic, MAKE[topic](9000))
    if topic == REFERENCE:
        message.poses[-1].pose.position.x = np.nan
    else:
        message.markers[1].type = Marker.POINTS
    return ros.serialize(message)


@both
def test_messages_of_any_size_are_refused_without_building_their_objects(topic):
    quick_s = 0.02  # to look at what is sent here takes ten times as long
    cases = [(too_long(topic), 'bytes; allowed'), (wrong(topic), 'violate the contract')]
    if topic == ROAD_EDGES:
        many = swollen(topic, long_paths.edges(2), 20_000)
        cases.append((many, 'markers is 40000 long; allowed 2'))
    for raw, error in cases:

        def read(raw=raw, error=error):
            with pytest.raises(DecodeError, match=f'^{topic}: .*{error}'):
                READ[topic](raw)

        assert long_paths.min_cpu_s(read, 3) < quick_s
    for raw in (b'', b'\x00', b'\x00\x01\x00\x00', b'\x00\x01\x00\x00\x01\x00'):
        for read in (*READ.values(), subscriptions_node.read_obstacles):
            with pytest.raises(DecodeError):
                read(raw)


def obstacles(count, speed=0.0):
    return Obstacles(S, tuple(Obstacle(k, 60.0 + k, 3.0, 0.5, speed, 0.0) for k in range(count)))


@pytest.mark.parametrize('number', [401, 2500])
def test_of_too_many_obstacles_the_first_are_used(number):
    read = subscriptions_node.read_obstacles(ros.serialize(encode.obstacles(obstacles(number))))
    assert read.items == obstacles(400).items
    assert read.refused == (('number', 'more than 400 markers: the first are used'),)


def test_the_most_obstacles_are_read_and_more_are_not_decoded():
    most = contract.load().topics['/scenario/obstacles'].sizes['markers'].high
    value = obstacles(most // 2, speed=1.0)  # each with an arrow
    assert subscriptions_node.read_obstacles(ros.serialize(encode.obstacles(value))) == value
    raw = swollen('/scenario/obstacles', obstacles(1), 20_000)
    assert len(subscriptions_node.read_obstacles(raw).items) == 1
    assert long_paths.min_cpu_s(lambda: subscriptions_node.read_obstacles(raw), 2) < 0.2
    huge = encode.obstacles(obstacles(1, speed=1.0))
    huge.markers[1].points = list(huge.markers[1].points) * 20_000
    with pytest.raises(DecodeError, match=r'/scenario/obstacles: \d+ bytes; allowed 553600'):
        subscriptions_node.read_obstacles(ros.serialize(huge))
