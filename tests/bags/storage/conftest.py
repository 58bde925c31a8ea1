"""A recorder process, a publisher that plays every node of the ring, and what they recorded."""

import json
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
import rclpy

from msgs_yaml import contract, encode, ros
from msgs_yaml import types as values

DOMAIN = int(os.environ.get('ROS_DOMAIN_ID', '41'))
START_NS = 1_000_000_000
TICK_NS = 50_000_000
TICKS = 20
FOUR = (1.0, 2.0, 3.0, 4.0)
SLIPS = (0.1, -0.2, 0.3, -0.4)
TIMEOUT_S = 30


def every_message():
    """One second of driving: {topic: [value, ...]}, no number equal to its neighbour."""
    ticks = [START_NS + k * TICK_NS for k in range(TICKS)]
    steps = [START_NS + k * 1_000_000 for k in range(TICKS * 50)]
    t = np.arange(51) * 0.05
    X = 20.0 * t
    return {
        '/scenario/reference': [values.Reference(START_NS, X, 0.1 * X, 0.01 * X, t)],
        '/scenario/road_edges': [
            values.RoadEdges(
                START_NS, np.column_stack([X, X * 0 + 3.5]), np.column_stack([X, X * 0 - 2.5])
            )
        ],
        '/scenario/obstacles': [
            values.Obstacles(
                ns,
                (
                    values.Obstacle(1, 40.0, 1.5, 1.0, 0.0, 0.0),
                    values.Obstacle(2, 60.0 - k, 2.5, 0.5, -20.0, 0.0),
                ),
            )
            for k, ns in enumerate(ticks)
        ],
        '/vehicle/odometry': [
            # the heading passes pi: half of them come out negative
            values.VehicleState(ns, 0.02 * k, -1.5 + 0.001 * k, 3.0 + 3e-4 * k, 20.0, 0.1, 1e-3 * k)
            for k, ns in enumerate(steps)
        ],
        '/vehicle/actuators': [
            values.Actuators(ns, 1e-4 * k, -0.1, -2.0 * k, -1.0 * k, FOUR)
            for k, ns in enumerate(steps)
        ],
        '/vehicle/imu': [
            values.Imu(ns, 0.1 * k, -0.2 * k, 0.3) for k, ns in enumerate(steps[::10])
        ],
        '/vehicle/wheels': [
            values.Wheels(ns, FOUR, FOUR, (4e3 + k, 3e3, 2e3, 1e3), SLIPS, FOUR, SLIPS[::-1], FOUR)
            for k, ns in enumerate(steps[::10])
        ],
        '/controller/command': [
            values.Command(ns, 0.01 * k, 0.2, -100.0 * k, -50.0) for k, ns in enumerate(ticks)
        ],
        '/controller/prediction': [
            values.Prediction(ns, X + k, 0.5 * X, 0.02 * X, t) for k, ns in enumerate(ticks)
        ],
        '/controller/why': [
            values.Why(ns, 0, 'solved', {'rung': 'solved', 'cost.con': 0.1 * k, 'iterations': k})
            for k, ns in enumerate(ticks)
        ],
        '/diagnostics': [values.Health(START_NS, 'plant', 0, 'drives', {'ticks': TICKS})],
        '/clock': ticks,
    }


ENCODERS = {
    '/diagnostics': encode.health,
    **{
        f'/{group}/{name}': getattr(encode, name)
        for group, names in {
            'scenario': ('reference', 'road_edges', 'obstacles'),
            'vehicle': ('odometry', 'actuators', 'imu', 'wheels'),
            'controller': ('command', 'prediction', 'why'),
        }.items()
        for name in names
    },
    '/clock': encode.clock,
}


class Ring:
    """Publishes as all nodes together would, from this process."""

    def __init__(self, mode):
        self.context = rclpy.Context()
        rclpy.init(context=self.context, domain_id=DOMAIN)
        self.node = rclpy.create_node('ring', context=self.context)
        self.node.declare_parameter('mode', mode)
        self.publishers = {name: ros.publisher(self.node, name) for name in contract.load().topics}

    def wait_for_recorder(self):
        end = time.monotonic() + TIMEOUT_S
        while not all(p.get_subscription_count() for p in self.publishers.values()):
            assert time.monotonic() < end, 'the recorder does not subscribe'
            time.sleep(0.01)

    def publish(self, topic, value):
        self.publishers[topic].publish(ENCODERS[topic](value))

    def publish_all(self, messages):
        for topic, sent in messages.items():
            for value in sent:
                self.publish(topic, value)

    def close(self):
        self.node.destroy_node()
        rclpy.shutdown(context=self.context)


class Recorder:
    """A recorder_node in a process of its own."""

    def __init__(self, out: Path, **parameters):
        self.out = out
        given = {'out': out, **parameters}
        arguments = [word for k, v in given.items() for word in ('-p', f'{k}:={v}')]
        self.process = subprocess.Popen(
            [sys.executable, '-m', 'bags.recorder_node', '--ros-args', *arguments],
            env={**os.environ, 'ROS_DOMAIN_ID': str(DOMAIN)},
            stderr=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )

    def end(self, number=signal.SIGINT):
        """Send a signal; return (exit code, everything it said)."""
        self.process.send_signal(number)
        return self.wait()

    def wait(self):
        said = self.process.communicate(timeout=TIMEOUT_S)
        return self.process.returncode, ''.join(said)

    def cpu_s(self):
        """User and system time so far, without the start of the interpreter's parents."""
        fields = Path(f'/proc/{self.process.pid}/stat').read_text().rpartition(')')[2].split()
        return (int(fields[11]) + int(fields[12])) / os.sysconf('SC_CLK_TCK')


@pytest.fixture(scope='session', autouse=True)
def local_discovery():
    os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'


@pytest.fixture
def start_recorder():
    """Factory of recorders; whatever still runs at the end of the test is ended."""
    started = []

    def start(out, **parameters):
        started.append(Recorder(out, **parameters))
        return started[-1]

    yield start
    for recorder in started:
        if recorder.process.poll() is None:
            recorder.process.kill()
            recorder.process.wait(TIMEOUT_S)


@pytest.fixture
def make_ring():
    """Factory of publishers, closed at the end of the test."""
    made = []

    def make(mode='lockstep'):
        made.append(Ring(mode))
        return made[-1]

    yield make
    for ring in made:
        ring.close()


@pytest.fixture(scope='session')
def messages():
    return every_message()


@pytest.fixture(scope='session')
def bag_folder(tmp_path_factory, messages):
    """One second of every topic, recorded over Fast DDS in lockstep."""
    folder = tmp_path_factory.mktemp('runs') / 'mpcc'
    noted = folder.parent / 'run.json'
    noted.write_text(json.dumps({'scenario': 'double_lane_change', 'parameters': {'N': 50}}))
    recorder = Recorder(folder, run_info=noted)
    ring = Ring('lockstep')
    try:
        ring.wait_for_recorder()
        ring.publish_all(messages)
        code, said = recorder.end()
    finally:
        ring.close()
        if recorder.process.poll() is None:
            recorder.process.kill()
    assert code == 0, said
    assert re.search(r'\d+ messages in', said), said
    return folder
