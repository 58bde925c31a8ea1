"""Paths, edges and obstacles that violate the contract are rejected with field and range."""

import math
import re
import time
from functools import reduce

import numpy as np
import pytest
from builtin_interfaces.msg import Time
from geometry_msgs.msg import Point, PoseStamped
from nav_msgs.msg import Path
from visualization_msgs.msg import Marker

from msgs_yaml import decode, encode
from msgs_yaml.types import Command, Obstacle, Obstacles, Prediction, Reference, RoadEdges
from node_runtime import ros, subscriptions_node

S = 1_000_000_000
PATH = Reference(S, np.array([0.0, 10.0]), np.zeros(2), np.zeros(2), np.array([0.0, 0.5]))
EDGES = RoadEdges(S, np.array([[0.0, 3.0], [9.0, 3.0]]), np.array([[0.0, -3.0], [9.0, -3.0]]))
OBSTACLES = Obstacles(
    S, (Obstacle(1, 5.0, 0.0, 0.5, 0.0, 0.0), Obstacle(2, 9.0, 1.0, 0.5, 3.0, 0.0))
)


def test_every_pose_and_marker_is_in_the_frame_of_the_contract(rejects):
    message = encode.reference(PATH)
    message.poses[1].header.frame_id = 'odom'
    rejects(decode.reference, message, r"poses\[\*\].header.frame_id is 'odom'; allowed 'map'")
    message = encode.road_edges(EDGES)
    message.markers[0].header.frame_id = 'odom'
    rejects(decode.road_edges, message, "frame_id is 'odom'")


def test_pose_stamps_that_do_not_increase_are_rejected(rejects):
    message = encode.reference(PATH._replace(t=np.array([0.5, 0.0])))
    rejects(decode.reference, message, r'poses\[1\].header.stamp is 0.0+ s after .* allowed above')


def test_a_path_whose_poses_have_one_stamp_or_none_says_no_speed():
    for stamp in (Time(), Time(sec=1), Time(sec=77)):
        message = encode.reference(PATH)
        for pose in message.poses:
            pose.header.stamp, pose.header.frame_id = stamp, ''
        path = decode.reference(message)
        assert path.t.tolist() == [0.0, 0.0]
        assert path.X.tolist() == PATH.X.tolist()


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


def test_a_moving_obstacle_is_a_cylinder_and_an_arrow_of_one_id():
    message = encode.obstacles(OBSTACLES)
    assert [(m.ns, m.type, m.id) for m in message.markers] == [
        ('obstacle', Marker.CYLINDER, 1),
        ('obstacle', Marker.CYLINDER, 2),
        ('velocity', Marker.ARROW, 2),
    ]
    assert message.markers[0].scale.x == 1.0


def test_no_obstacle_is_one_marker_that_deletes_all_and_carries_the_stamp():
    message = encode.obstacles(Obstacles(5 * S, ()))
    (marker,) = message.markers
    assert marker.action == Marker.DELETEALL
    assert decode.obstacles(message) == Obstacles(5 * S, ())
    message.markers.clear()  # and the stamp with it
    assert decode.obstacles(message) == Obstacles(0, ())


def test_a_list_that_begins_by_deleting_all_is_understood():
    message = encode.obstacles(OBSTACLES)
    message.markers[:0] = encode.obstacles(Obstacles(S, ())).markers
    assert decode.obstacles(message) == OBSTACLES


def test_an_arrow_may_begin_anywhere_only_its_length_counts():
    message = encode.obstacles(OBSTACLES)
    message.markers[2].points = [Point(x=9.0, y=1.0), Point(x=12.0, y=1.0)]
    assert decode.obstacles(message) == OBSTACLES


def changed(**fields):
    """Return a function that sets fields of a marker, as pose__position__x."""

    def change(marker):
        for path, value in fields.items():
            *parents, name = path.split('__')
            setattr(reduce(getattr, parents, marker), name, value)

    return change


LONE = Obstacle(9, 40.0, 1.0, 0.5, 0.0, 0.0)
SIZE = r'scale.x \(2 r_obs\) is .*; allowed 0.01 to 100 m'
FAULTS = {
    'no size': (changed(scale__x=0.0, scale__y=0.0), 'field', SIZE),
    'negative': (changed(scale__x=-1.0, scale__y=-1.0), 'field', SIZE),
    'nan size': (changed(scale__x=math.nan), 'field', SIZE),
    'giant': (changed(scale__x=1e3, scale__y=1e3), 'field', SIZE),
    'nan place': (changed(pose__position__y=math.nan), 'field', r'position.y \(Y_obs\) is nan'),
    'oval': (changed(scale__y=3.0), 'shape', 'scale.y is 3.0; allowed scale.x = 1.0'),
    'cube': (changed(type=Marker.CUBE), 'type', 'type is 1; allowed 3'),
    'twin': (changed(id=1), 'id', 'another one before it has this id'),
    'foreign': (changed(ns='tree'), 'ns', 'allowed ns obstacle, velocity'),
    'frame': (changed(header__frame_id='odom'), 'field', "frame_id is 'odom'; allowed 'map'"),
    'no stamp': (changed(header__stamp=Time()), 'field', 'stamp is 0.000000000 s'),
    'stamp': (changed(header__stamp=Time(sec=99)), 'stamp', 'not that of most markers'),
    'action': (changed(action=77), 'action', 'action is 77; allowed 0'),
}


@pytest.mark.parametrize(('change', 'kind', 'reason'), FAULTS.values(), ids=FAULTS)
@pytest.mark.parametrize('place', ['first', 'last'])
def test_an_object_that_breaks_the_contract_is_refused_alone(change, kind, reason, place):
    message = encode.obstacles(OBSTACLES)
    (marker,) = encode.obstacles(Obstacles(OBSTACLES.stamp_ns, (LONE,))).markers
    change(marker)
    message.markers.insert(0 if place == 'first' and kind != 'id' else 3, marker)
    read = decode.obstacles(message)
    assert (read.stamp_ns, read.items) == (OBSTACLES.stamp_ns, OBSTACLES.items)
    (refusal,) = read.refused
    assert refusal.kind == kind
    assert re.fullmatch(f'{marker.ns} {marker.id}: .*{reason}.*', refusal.reason)


@pytest.mark.parametrize('fault', sorted(FAULTS.keys() - {'twin', 'stamp'}))
def test_objects_none_of_which_can_be_used_are_no_free_road(rejects, fault):
    change, _, reason = FAULTS[fault]
    message = encode.obstacles(Obstacles(S, (LONE,)))
    change(message.markers[0])
    rejects(decode.obstacles, message, reason)


@pytest.mark.parametrize(
    ('change', 'reason'),
    [
        (changed(points=[Point()]), r'velocity 2: .*points is 1 long; allowed 2 to 2'),
        (changed(points=[Point(), Point(x=math.inf)]), r'velocity 2: .*vX 1 s.* is inf'),
        (changed(id=7), 'velocity 7: belongs to no obstacle'),
    ],
)
def test_an_arrow_that_breaks_the_contract_costs_the_velocity_alone(change, reason):
    message = encode.obstacles(OBSTACLES)
    change(message.markers[2])
    read = decode.obstacles(message)
    still = [item._replace(vX=0.0, vY=0.0) for item in OBSTACLES.items]
    assert read.items == tuple(still)
    (refusal,) = read.refused
    assert re.match(reason, refusal.reason)


def test_markers_that_delete_are_no_objects():
    message = encode.obstacles(OBSTACLES)
    message.markers.append(Marker(ns='obstacle', id=3, action=Marker.DELETE))
    assert decode.obstacles(message) == OBSTACLES


@pytest.mark.parametrize('number', [401, 1000, 2500])
def test_of_too_many_obstacles_the_first_are_used_at_once(number):
    crowd = Obstacles(S, tuple(Obstacle(i, 1.0 * i, 0.0, 0.5, 0.0, 0.0) for i in range(number)))
    read = subscriptions_node.read_obstacles(ros.serialize(encode.obstacles(crowd)))
    assert read.items == crowd.items[:400]
    (refusal,) = read.refused
    assert refusal == ('number', 'more than 400 markers: the first are used')
