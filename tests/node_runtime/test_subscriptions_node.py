"""Messages of any size are decoded or rejected in bounded time."""

import time

import long_paths
import numpy as np
import pytest
from visualization_msgs.msg import Marker

from msgs_yaml import contract, encode
from msgs_yaml.decode import DecodeError
from msgs_yaml.types import Obstacle, Obstacles, RoadEdges
from node_runtime import ros, subscriptions_node

LONG_S = 0.02  # of processor time; to look at what is sent here takes ten times as long
STAMP = 1_000_000_000
FAR = np.array([[0.0, 3.5], [900.0, 3.5]])


def obstacles(count):
    items = tuple(Obstacle(k, 60.0 + k, 3.0, 0.5, 1.0, 0.0) for k in range(count))
    return Obstacles(STAMP, items)


def swollen(message, many):
    message.markers = list(message.markers) * many
    return ros.serialize(message)


def quickly(read, raw):
    began = time.thread_time()
    with pytest.raises(DecodeError) as refused:
        read(raw)
    assert time.thread_time() - began < LONG_S
    return str(refused.value)


def test_of_too_many_obstacles_the_first_are_used_and_the_rest_is_not_decoded():
    raw = swollen(encode.obstacles(obstacles(1)), 20_000)
    began = time.thread_time()
    read = subscriptions_node.read_obstacles(raw)
    assert time.thread_time() - began < 10 * LONG_S
    assert len(read.items) == 1
    assert read.refused[0].reason == 'more than 400 markers: the first are used'


def test_too_many_edges_are_rejected_before_decoding():
    raw = swollen(encode.road_edges(RoadEdges(STAMP, FAR, -FAR)), 20_000)
    assert 'markers is 40000 long; allowed 2' in quickly(subscriptions_node.read_road_edges, raw)


def test_few_but_huge_markers_are_rejected_before_decoding():
    message = encode.road_edges(RoadEdges(STAMP, FAR, -FAR))
    message.markers[0].points = list(message.markers[0].points) * 50_000
    error = quickly(subscriptions_node.read_road_edges, ros.serialize(message))
    assert error.startswith('/scenario/road_edges: ')
    assert 'bytes; allowed' in error


def test_the_longest_messages_that_violate_the_contract_are_rejected_without_objects_of_them():
    path = long_paths.path()
    path.X[-1] = np.nan
    raw = ros.serialize(encode.reference(path))
    assert 'violate the contract' in quickly(subscriptions_node.read_reference, raw)
    message = encode.road_edges(long_paths.edges())
    message.markers[1].type = Marker.POINTS
    raw = ros.serialize(message)
    assert 'violate the contract' in quickly(subscriptions_node.read_road_edges, raw)


def test_the_longest_messages_of_the_contract_are_read():
    most = contract.load().topics['/scenario/obstacles'].sizes['markers'].high
    value = obstacles(most // 2)  # each with an arrow
    assert subscriptions_node.read_obstacles(ros.serialize(encode.obstacles(value))) == value
    longest = contract.load().topics['/scenario/road_edges'].sizes['markers[*].points'].high
    line = np.column_stack([np.linspace(0.0, 900.0, longest), np.full(longest, 3.5)])
    edges = subscriptions_node.read_road_edges(
        ros.serialize(encode.road_edges(RoadEdges(STAMP, line, -line)))
    )
    assert len(edges.left) == longest


@pytest.mark.parametrize('raw', [b'', b'\x00', b'\x00\x01\x00\x00', b'\x00\x01\x00\x00\x01\x00'])
def test_truncated_bytes_are_rejected(raw):
    for read in (
        subscriptions_node.read_reference,
        subscriptions_node.read_road_edges,
        subscriptions_node.read_obstacles,
    ):
        with pytest.raises(DecodeError):
            read(raw)
