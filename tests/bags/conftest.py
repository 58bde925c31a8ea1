"""Bags of drives made by hand, without ROS nodes; nodes as processes, and a ring that they hear."""

import fcntl
import os
import re
import signal
import subprocess
import sys
import tempfile
import termios
from contextlib import ExitStack
from functools import partial

import numpy as np
import pytest
from example_messages import encoded
from node_graph import Manager
from rclpy.duration import Duration
from rclpy.serialization import serialize_message
from wait_until import wait_until

from bags import cli
from bags.figures import comparison_figures
from bags.storage import message_filing
from bags.storage.bag_writer import BagWriter
from msgs_yaml import contract, encode, types
from node_runtime import provenance, ros

PARAMETERS = {
    'controller': {
        'body.circle_offsets_m': [0.0],
        'body.circle_radius_m': 1.1,
        'limits.least_speed_mps': 7.0,
        'model.step_s': 0.05,
        'safety.edge_m': 0.5,
        'safety.obstacle_m': 0.5,
        'tyre.front_friction': 1.0,
        'tyre.rear_friction': 1.0,
    },
    'plant': {
        'car.body.cog_to_front_m': 1.4,
        'car.body.cog_to_rear_m': 1.4,
        'car.outline.front_overhang_m': 1.0,
        'car.outline.rear_overhang_m': 1.0,
        'car.outline.width_m': 1.8,
        'friction': 1.0,
        'stop.armed_after_m': 20.0,
        'stop.x_m': 90.0,
        'stop.y_m': 0.0,
    },
}
WHY = {'rung': 'solved', 'reason': 'converged', 'gate': 'passed', 'time.solve_ms': 5.0}
TIMEOUT_S = 90


class Ring(Manager):
    """Publishes as all nodes together would, from this process."""

    def __init__(self, domain, mode, namespace):
        super().__init__(domain, mode, namespace)
        self.publishers = {name: ros.publisher(self.node, name) for name in contract.load().topics}

    def wait_for_recorder(self):
        wait_until(
            lambda: all(p.get_subscription_count() for p in self.publishers.values()),
            TIMEOUT_S,
            'the recorder does not subscribe',
        )

    def publish(self, topic, value):
        self.publishers[topic].publish(encoded(topic, value))

    def publish_all(self, messages):
        """Publish everything, and wait until it has arrived."""
        for topic, sent in messages.items():
            for value in sent:
                self.publish(topic, value)
        self.wait_until_received()

    def wait_until_received(self):
        """Wait until whatever is reliable was acknowledged.

        That a publisher knows its recorder does not say that the recorder knows it yet.
        """
        for topic, publisher in self.publishers.items():
            acked = publisher.wait_for_all_acked(Duration(seconds=TIMEOUT_S))
            assert acked, f'{topic}: not acknowledged'


class NodeProcess:
    """A node in a process of its own; `terminal` is its standard input, else it has none."""

    def __init__(self, module, namespace='/', terminal=None, environment=None, **parameters):
        words = [word for k, v in parameters.items() for word in ('-p', f'{k}:={v}')]
        options = {'stdin': subprocess.DEVNULL, 'env': environment}
        if terminal is not None:
            # as a shell would in the foreground of this terminal
            options |= {'stdin': terminal, 'start_new_session': True}
            options['preexec_fn'] = lambda: fcntl.ioctl(0, termios.TIOCSCTTY, 0)
        self.log = tempfile.TemporaryFile('w+')  # noqa: SIM115 - lives as long as this
        words = [sys.executable, '-m', module, '--ros-args', *words, '-r', f'__ns:={namespace}']
        self.process = subprocess.Popen(words, stderr=self.log, stdout=self.log, **options)

    def end(self, number=signal.SIGINT):
        """Send a signal; return (exit code, everything it said)."""
        self.process.send_signal(number)
        return self.wait()

    def wait(self):
        code = self.process.wait(TIMEOUT_S)
        return code, self.said()

    def until(self, is_true):
        """Wait until something is true of everything it said; return that."""
        wait_until(lambda: is_true(self.said()), TIMEOUT_S, self.said)
        return self.said()

    def said(self):
        """Return everything it said so far."""
        size = os.fstat(self.log.fileno()).st_size
        return os.pread(self.log.fileno(), size, 0).decode()

    def hears(self, topic):
        """Tell whether it has said that something of a topic has arrived."""
        return re.search(rf'hears .*{topic}\b', self.said()) is not None


def messages(drive):
    """Return [(topic, stamp_ns, message)] that say what a Drive says."""
    motion, scene = drive.motion, drive.scene
    reference = types.Reference(
        int(motion.stamp_ns[0]),
        *scene.reference.T,
        np.zeros(len(scene.reference)),
        np.arange(len(scene.reference)) / 20.0,
    )
    edges = types.RoadEdges(int(motion.stamp_ns[0]), scene.left, scene.right)
    result = [
        ('/scenario/reference', int(motion.stamp_ns[0]), encode.reference(reference)),
        ('/scenario/road_edges', int(motion.stamp_ns[0]), encode.road_edges(edges)),
    ]
    for k, ns in enumerate(scene.obstacle_stamp_ns.tolist()):
        crowd = tuple(
            types.Obstacle(item.id, item.x[k], item.y[k], item.radius, item.vx[k], item.vy[k])
            for item in scene.obstacles
        )
        result.append(('/scenario/obstacles', ns, encode.obstacles(types.Obstacles(ns, crowd))))
    for ns, *state in zip(*(column.tolist() for column in motion)):
        state = types.VehicleState(ns, *state, 0.0)
        result.append(('/vehicle/odometry', ns, encode.odometry(state)))
    for ns, ax, ay in zip(*(column.tolist() for column in drive.accelerations)):
        result.append(('/vehicle/imu', ns, encode.imu(types.Imu(ns, ax, ay, 0.0))))
    for ns, steer, force in zip(*(column.tolist() for column in drive.inputs)):
        actuators = types.Actuators(ns, steer, 0.0, force, 0.0, (0.0,) * 4)
        result.append(('/vehicle/actuators', ns, encode.actuators(actuators)))
    for ns in drive.ticks.answered_ns.tolist():
        command = types.Command(ns, 0.0, 0.0, 0.0, 0.0)
        result.append(('/controller/command', ns, encode.command(command)))
        result.append(('/controller/why', ns, encode.why(types.Why(ns, 0, 'solved', WHY))))
    return result


@pytest.fixture(scope='session')
def write_bag_into():
    """Return write(folder, drive, name, extra, ...) -> the bag of the drive below a folder.

    `extra` are (topic, ns, CDR) more; the scenario has a name and a text.
    """

    def write(folder, drive, name='mpcc', extra=(), scenario='straight', text='schema: 1'):
        topics = [message_filing.bag_topic(t, 'lockstep') for t in contract.load().topics.values()]
        index = {topic.name: i for i, topic in enumerate(topics)}
        info = provenance.describe_run(scenario, text, name, 'lockstep', PARAMETERS)
        bag = BagWriter(folder / name, topics, {'run': info})
        sent = [(topic, ns, serialize_message(item)) for topic, ns, item in messages(drive)]
        for topic, ns, data in [*sent, *extra]:
            bag.write(index[topic], ns, ns, data)
        bag.close()
        return folder / name

    return write


@pytest.fixture
def undrawn(monkeypatch):
    """Draw no figures, which takes seconds."""
    monkeypatch.setattr(comparison_figures, 'write_figures', lambda *given: [given[2]])


@pytest.fixture
def bags_prints(capsys):
    """Return run(words) -> what a command of `bags` that succeeds prints."""

    def run(*words):
        assert cli.main([*map(str, words)]) == 0
        return capsys.readouterr().out

    return run


@pytest.fixture
def write_bag(write_bag_into, tmp_path):
    """Return write(drive, name, extra) -> folder of its bag in the folder of the test."""
    return partial(write_bag_into, tmp_path)


@pytest.fixture
def start_node(domain):
    """Factory of node processes; whatever still runs at the end of the test is ended."""
    started = []

    def start(module, **options):
        started.append(NodeProcess(module, **options))
        return started[-1]

    yield start
    for node in started:
        if node.process.poll() is None:
            node.process.kill()
            node.process.wait(TIMEOUT_S)
        node.log.close()


@pytest.fixture
def make_ring(domain):
    """Factory of publishers, closed at the end of the test."""
    with ExitStack() as rings:
        yield lambda mode, namespace='/': rings.enter_context(Ring(domain, mode, namespace))
