"""/tf over real Fast DDS: frames are recorded where car and wheels are, and sent by one node."""

import importlib.util
import os
import subprocess
import sys
from collections import defaultdict
from pathlib import Path

import numpy as np
import pytest
from node_graph import ROLES, NodeGraph
from rosbags.rosbag2 import Reader
from rosbags.typesys import Stores, get_typestore

from bags.storage import read
from experiments.configuration import node_config
from msgs_yaml import conversions
from vehicle_plant import parameters, robot_description

STORE = get_typestore(Stores.ROS2_JAZZY)
SECONDS = 240  # of wall time
# on a circle, for a second
SHORT = {'stop.x_m': 9.0, 'stop.y_m': 2.1, 'stop.yaw_rad': 0.4, 'stop.armed_after_m': 1.0}
# who sends the frames: their period, and those that move
PLANT = 20_000_000, ['base_link', 'fl_wheel', 'fr_wheel']
MARKERS = 1_000_000, ['base_link']  # of whichever state comes


@pytest.fixture(scope='module')
def environment(tmp_path_factory):
    """Return the environment of a process that has tf2_msgs, built where it is not installed."""
    result = dict(os.environ)
    if importlib.util.find_spec('tf2_msgs'):
        return result
    folder = tmp_path_factory.mktemp('tf2')
    build = [sys.executable, Path(__file__).with_name('tf2_build.py'), folder]
    subprocess.run(build, check=True, timeout=SECONDS, stdout=subprocess.DEVNULL)
    for name in ('LD_LIBRARY_PATH', 'PYTHONPATH', 'AMENT_PREFIX_PATH'):
        result[name] = os.pathsep.join(filter(None, (result.get(name), str(folder))))
    return result


def transforms(bag, topic):
    """Return the transforms that were recorded of a topic, and the hash of its type."""
    with Reader(bag) as reader:
        (channel,) = (one for one in reader.connections if one.topic == topic)
        messages = (
            STORE.deserialize_cdr(data, channel.msgtype)
            for connection, _, data in reader.messages()
            if connection.topic == topic
        )
        return [one for message in messages for one in message.transforms], channel.digest


def heading(frame):
    turn = frame.transform.rotation
    assert turn.x == turn.y == 0.0
    return conversions.quaternion_to_heading(turn.z, turn.w)


def place(frame):
    at = frame.transform.translation
    return [at.x, at.y, at.z]


@pytest.mark.slow
@pytest.mark.needs('tf2')
@pytest.mark.parametrize(('period_ns', 'moving'), [PLANT, MARKERS], ids=['plant', 'markers'])
def test_frames_are_recorded_once_where_car_and_wheels_are(
    domain, environment, tmp_path, period_ns, moving
):
    plant = SHORT | {'publish_tf': moving is PLANT[1]}
    with NodeGraph(tmp_path, domain, road='circle_20m', plant=plant) as graph:
        graph.nodes['markers'] = node_config.build_markers_node(graph.nodes.values())
        graph.environment |= environment | {'ROS_DOMAIN_ID': str(domain)}
        graph.start('markers', *ROLES)
        bag = graph.finish()
    frames, digest = transforms(graph.bag, '/tf')
    assert digest == STORE.hash_rihs01('tf2_msgs/msg/TFMessage')
    columns, by_name = read.columns(bag), defaultdict(list)
    states, actuators = columns['/vehicle/odometry'], columns['/vehicle/actuators']
    for frame in frames:
        by_name[frame.child_frame_id].append(frame)
        stamp_ns = conversions.stamp_to_ns(frame.header.stamp)
        (row,) = np.flatnonzero(states.stamp_ns == stamp_ns)
        if frame.child_frame_id == 'base_link':
            assert frame.header.frame_id == 'map'
            assert place(frame) == [states.x_m[row], states.y_m[row], 0.0]
            expected = states.yaw_rad[row]
        else:
            expected = actuators.steer_rad[row]
        assert heading(frame) == pytest.approx(expected, abs=1e-12)
    assert sorted(by_name) == moving
    assert np.ptp(actuators.steer_rad) > 0.01
    for of_one in by_name.values():
        stamps = [conversions.stamp_to_ns(frame.header.stamp) for frame in of_one]
        # two nodes that send them would repeat a stamp
        # the plant sends every one; a node that draws sees few states on a busy machine
        assert len({*stamps}) == len(stamps) > (10 if moving is PLANT[1] else 2)
        assert not {*np.diff(sorted(stamps)) % period_ns} - {0}
    assert np.ptp([place(frame)[0] for frame in by_name['base_link']]) > 1.0
    if moving is PLANT[1]:
        plant = parameters.load(parameters.config_file(parameters.DEFAULT_CAR))
        fixed = {
            frame.child_frame_id: place(frame) for frame in transforms(graph.bag, '/tf_static')[0]
        }
        still = [one for one in robot_description.frames(plant.car) if not one.is_steered]
        assert fixed == {one.name: [one.x, one.y, one.z] for one in still}
