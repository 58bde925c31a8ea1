"""/tf over real Fast DDS: the car's frame in the map is the pose that the state has."""

import signal
from functools import partial
from pathlib import Path

import numpy as np
import pytest
import tf2
from rosbags.rosbag2 import Reader
from rosbags.typesys import Stores, get_typestore

from bags.storage import read
from msgs_yaml import conversions

FRAMES = 10
STORE = get_typestore(Stores.ROS2_JAZZY)
HERE = Path(__file__).parent
BAG = HERE.parents[2] / 'bags' / 'reference' / 'double_lane_change' / 'mpcc'
pytestmark = [pytest.mark.slow, pytest.mark.needs('tf2')]


@pytest.fixture(scope='module')
def environment(domain, tmp_path_factory):
    """Return the environment of a process that has tf2_msgs."""
    return tf2.environment(tmp_path_factory.mktemp('tf2'))


def test_frames_are_recorded_where_their_type_is_installed_and_have_the_pose_of_their_state(
    start_node, environment, tmp_path
):
    start = partial(start_node, environment=environment)
    recorder = start('bags.recorder_node', out=tmp_path / 'bag')
    markers = start('bags.markers_node')
    given = {'topics': '[/vehicle/odometry]', 'rate': 4.0, 'recorders': 1, 'delay_s': 2.0}
    assert start('bags.player_node', bag=BAG, **given).wait()[0] == 0
    for process in (recorder, markers):
        assert process.end(signal.SIGTERM)[0] == 0
    with Reader(tmp_path / 'bag') as reader:
        frames = [
            STORE.deserialize_cdr(data, connection.msgtype).transforms[0]
            for connection, _, data in reader.messages()
            if connection.topic == '/tf'
        ]
        (channel,) = (one for one in reader.connections if one.topic == '/tf')
    assert channel.digest == STORE.hash_rihs01('tf2_msgs/msg/TFMessage')
    assert len(frames) >= FRAMES
    states = read.columns(BAG)['/vehicle/odometry']
    for frame in frames:
        (row,) = np.flatnonzero(states.stamp_ns == conversions.stamp_to_ns(frame.header.stamp))
        assert (frame.header.frame_id, frame.child_frame_id) == ('map', 'base_link')
        place, turn = frame.transform.translation, frame.transform.rotation
        assert (place.x, place.y, place.z) == (states.x_m[row], states.y_m[row], 0.0)
        assert turn.x == turn.y == 0.0
        yaw = conversions.quaternion_to_heading(turn.z, turn.w)
        assert yaw == pytest.approx(states.yaw_rad[row], abs=1e-15)
    assert np.ptp([frame.transform.translation.x for frame in frames]) > 1.0
