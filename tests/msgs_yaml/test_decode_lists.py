"""Paths, edges and obstacles that violate the contract are rejected with field and range."""

import math
import time

import numpy as np
import pytest
from geometry_msgs.msg import Point, PoseStamped
from nav_msgs.msg import Path
from visualization_msgs.msg import Marker

from msgs_yaml import decode, encode
from msgs_yaml.types import Command, Obstacle, Obstacles, Prediction, Reference, RoadEdges

S = 1_000_000_000
PATH = Reference(S, np.array([0.0, 10.0]), np.zeros(2), np.zeros(2), np.array([0.0, 0.5]))
EDGES = RoadEdges(S, np.array([[0.0, 3.0], [9.0, 3.0]]), np.array([[0.0, -3.0], [9.0, -3.0]]))
OBSTACLES = Obstacles(
    S, (Obstacle(1, 5.0, 0.0, 0.5, 0.0, 0.0), Obstacle(2, 9.0, 1.0, 0.5, 3.0, 0.0))
)


def test_every_pose_and_marker_is_in_the_frame_of_the_contract(rejects):
    message = encode.reference(PATH)
    message.poses[1].header.frame_id = ''
    rejects(decode.reference, message, r"poses\[\*\].header.frame_id is ''; allowed 'map'")
    message = encode.road_edges(EDGES)
    message.markers[0].header.frame_id = 'odom'
    rejects(decode.road_edges, message, "frame_id is 'odom'")


def test_pose_stamps_that_do_not_increase_are_rejected(rejects):
    message = encode.reference(PATH._replace(t=np.array([0.0, 0.0])))
    rejects(decode.reference, message, r'poses\[1\].header.stamp is 0.0+ s after .* allowed above')
    message = encode.reference(PATH._replace(t=np.array([0.5, 0.0])))
    rejects(decode.reference, message, r'poses\[1\].header.stamp')


def test_a_path_of_one_pose_is_rejected(rejects):
    message = encode.reference(PATH)
    message.poses.pop()
    rejects(decode.reference, message, 'poses is 1 long; allowed 2 to 40000 elements')


def test_a_path_that_starts_later_than_its_stamp_starts_at_zero():
    message = encode.reference(PATH._replace(t=np.array([2.0, 2.5])))
    assert decode.reference(message).t.tolist() == [0.0, 0.5]
    plan = Prediction(S, *PATH[1:4], np.array([0.05, 0.1]))
    assert decode.prediction(encode.prediction(plan)).t.tolist() == [0.05, 0.1]


def test_headings_are_unwrapped_across_the_cut():
    psi = np.array([3.0, 3.3])
    assert np.allclose(decode.reference(encode.reference(PATH._replace(psi=psi))).psi, psi)


def test_a_million_poses_are_rejected_at_once(rejects):
    message = Path()
    message.header = encode.reference(PATH).header
    message._poses = [PoseStamped()] * 1_000_000
    start = time.process_time()
    rejects(decode.reference, message, 'poses is 1000000 long')
    assert time.process_time() - start < 0.1


def test_a_million_points_or_names_are_rejected_at_once(rejects):
    edges = encode.road_edges(EDGES)
    edges.markers[1]._points = [Point()] * 1_000_000
    command = encode.command(Command(S, 0.1, 0.2, -3000.0, -2000.0))
    command._name = ['steer'] * 1_000_000
    start = time.process_time()
    rejects(decode.road_edges, edges, r'markers\[\*\].points is 1000000 long')
    rejects(decode.command, command, 'name is 1000000 long')
    assert time.process_time() - start < 0.1


def test_edges_are_one_left_and_one_right(rejects):
    message = encode.road_edges(EDGES)
    message.markers[1].ns = 'left'
    rejects(decode.road_edges, message, "markers are both 'left'; allowed left, right")
    message.markers[1].ns = 'centre'
    rejects(decode.road_edges, message, "ns is 'centre'; allowed left, right")
    message = encode.road_edges(EDGES)
    message.markers.pop()
    rejects(decode.road_edges, message, 'markers is 1 long; allowed 2 to 2 elements')
    message = encode.road_edges(EDGES)
    message.markers[0].type = Marker.POINTS
    rejects(decode.road_edges, message, 'type is 8; allowed 4 with ns left')
    message = encode.road_edges(EDGES)
    message.markers[0].action = Marker.DELETE
    rejects(decode.road_edges, message, 'action is 2; allowed 0')
    message = encode.road_edges(EDGES)
    message.markers[0].header.stamp.nanosec = 1
    rejects(decode.road_edges, message, 'markers have 2 stamps; allowed one for all')


def test_a_moving_obstacle_is_a_cylinder_and_an_arrow_of_one_id(rejects):
    message = encode.obstacles(OBSTACLES)
    assert [(m.ns, m.type, m.id) for m in message.markers] == [
        ('obstacle', Marker.CYLINDER, 1),
        ('obstacle', Marker.CYLINDER, 2),
        ('velocity', Marker.ARROW, 2),
    ]
    assert message.markers[0].scale.x == 1.0
    message.markers[2].id = 7
    rejects(decode.obstacles, message, 'velocity 7 belongs to no obstacle')


def test_no_obstacle_is_one_marker_that_deletes_all_and_carries_the_stamp(rejects):
    message = encode.obstacles(Obstacles(5 * S, ()))
    (marker,) = message.markers
    assert marker.action == Marker.DELETEALL
    assert decode.obstacles(message) == Obstacles(5 * S, ())
    message.markers.clear()
    rejects(decode.obstacles, message, 'markers is 0 long; allowed 1 to 400')


def test_a_list_that_begins_by_deleting_all_is_understood():
    message = encode.obstacles(OBSTACLES)
    message.markers[:0] = encode.obstacles(Obstacles(S, ())).markers
    assert decode.obstacles(message) == OBSTACLES


def test_an_arrow_may_begin_anywhere_only_its_length_counts():
    message = encode.obstacles(OBSTACLES)
    message.markers[2].points = [Point(x=9.0, y=1.0), Point(x=12.0, y=1.0)]
    assert decode.obstacles(message) == OBSTACLES


@pytest.mark.parametrize('value', [0.0, -1.0, math.nan, 1e3])
def test_an_obstacle_without_a_size_is_rejected(rejects, value):
    message = encode.obstacles(OBSTACLES)
    message.markers[0].scale.x = message.markers[0].scale.y = value
    rejects(decode.obstacles, message, r'scale.x \(2 r_obs\) is .*; allowed 0.01 to 100 m')


def test_oval_twin_and_unknown_obstacles_are_rejected(rejects):
    message = encode.obstacles(OBSTACLES)
    message.markers[0].scale.y = 3.0
    rejects(decode.obstacles, message, 'scale.y of obstacle 1 is 3.0; allowed scale.x = 1.0')
    message = encode.obstacles(OBSTACLES)
    message.markers[1].id = 1
    rejects(decode.obstacles, message, 'have one id')
    message = encode.obstacles(OBSTACLES)
    message.markers[0].ns = 'tree'
    rejects(decode.obstacles, message, "ns is 'tree'; allowed obstacle, velocity")
    message = encode.obstacles(OBSTACLES)
    message.markers[2].points.pop()
    rejects(decode.obstacles, message, r'points is 1 long; allowed 2 to 2')
