"""/tf over real Fast DDS: the car's frame in the map is the pose that the state has."""

import json
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import tf2

from bags.storage import read
from msgs_yaml import conversions

SECONDS = 60
FRAMES = 10
HERE = Path(__file__).parent
BAG = HERE.parents[2] / 'bags' / 'reference' / 'double_lane_change' / 'mpcc'
pytestmark = [pytest.mark.slow, pytest.mark.needs('tf2')]


@pytest.fixture(scope='module')
def environment(domain, tmp_path_factory):
    """Return the environment of a process that has tf2_msgs."""
    return tf2.environment(tmp_path_factory.mktemp('tf2'))


@pytest.fixture
def start(environment):
    """start(words) -> a process; ended at the end of the test."""
    started = []

    def one(*words, **options):
        started.append(subprocess.Popen([sys.executable, *words], env=environment, **options))
        return started[-1]

    yield one
    for process in started:
        process.send_signal(signal.SIGTERM)
        assert process.wait(SECONDS) == 0


def test_tf_has_the_pose_of_the_state_of_equal_stamp(start):
    start('-m', 'bags.markers_node')
    listener = start(tf2.LISTENER, str(FRAMES), stdout=subprocess.PIPE, text=True)
    arguments = (f'bag:={BAG}', 'topics:=[/vehicle/odometry]', 'loop:=true', 'delay_s:=1.0')
    words = [word for item in arguments for word in ('-p', item)]
    start('-m', 'bags.player_node', '--ros-args', *words, stdin=subprocess.DEVNULL)
    message = [json.loads(line) for line in listener.communicate(timeout=SECONDS)[0].splitlines()]
    assert len(message) >= FRAMES
    states = read.columns(BAG)['/vehicle/odometry']
    for item in message:
        (row,) = np.flatnonzero(states.stamp_ns == item['stamp_ns'])
        assert item['frames'] == ['map', 'base_link']
        assert item['at'] == [states.x_m[row], states.y_m[row], 0.0]
        x, y, z, w = item['turn']
        assert x == y == 0.0
        assert conversions.quaternion_to_heading(z, w) == pytest.approx(
            states.yaw_rad[row], abs=1e-15
        )
    moved = np.ptp([item['at'][0] for item in message])
    assert moved > 1.0
