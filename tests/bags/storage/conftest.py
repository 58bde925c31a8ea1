"""A bag of one second; a recorder process, and a publisher that plays every node of the ring."""

import fcntl
import os
import re
import signal
import subprocess
import sys
import tempfile
import termios
from contextlib import ExitStack, closing
from pathlib import Path

import pytest
import rclpy
from example_messages import encoded
from one_second import every_message, write
from rclpy.duration import Duration
from session_cache import build_once
from wait_until import wait_until

from msgs_yaml import contract
from node_runtime import ros, spin_node

TIMEOUT_S = 90


class Ring:
    """Publishes as all nodes together would, from this process."""

    def __init__(self, mode):
        self.context = rclpy.Context()
        rclpy.init(context=self.context)
        self.node = rclpy.create_node('ring', context=self.context)
        self.node.declare_parameter('mode', mode)
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

    def close(self):
        spin_node.shut_down(self.node, context=self.context)


class NodeProcess:
    """A node in a process of its own; `terminal` is its standard input, else it has none."""

    def __init__(self, module, namespace='/', terminal=None, **parameters):
        words = [word for k, v in parameters.items() for word in ('-p', f'{k}:={v}')]
        options = {'stdin': subprocess.DEVNULL}
        if terminal is not None:
            # as a shell would in the foreground of this terminal
            options = {'stdin': terminal, 'start_new_session': True}
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

    def cpu_s(self):
        """User and system time so far, without the start of the interpreter's parents."""
        fields = Path(f'/proc/{self.process.pid}/stat').read_text().rpartition(')')[2].split()
        return (int(fields[11]) + int(fields[12])) / os.sysconf('SC_CLK_TCK')


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
def start_recorder(start_node):
    """Factory of recorders into a folder."""
    return lambda out, **options: start_node('bags.recorder_node', out=out, **options)


@pytest.fixture
def make_ring(domain):
    """Factory of publishers, closed at the end of the test."""
    with ExitStack() as rings:
        yield lambda mode='lockstep': rings.enter_context(closing(Ring(mode)))


@pytest.fixture
def start_pair(start_recorder, make_ring):
    """Factory of a recorder and publishers, of the same mode, that know each other."""

    def start(out, **parameters):
        mode = parameters.get('mode', 'lockstep')
        recorder, ring = start_recorder(out, **parameters), make_ring(mode)
        ring.wait_for_recorder()
        return recorder, ring

    return start


@pytest.fixture(scope='session')
def messages():
    return every_message()


@pytest.fixture(scope='session')
def bag_folder(tmp_path_factory, messages):
    """One second of every topic, as a recorder files it in lockstep; once for all workers."""
    entries = {'scenario': 'double_lane_change', 'parameters': '{"N": 50}', 'namespace': '/'}
    folder = build_once(
        tmp_path_factory, 'one_second', lambda folder: write(folder / 'mpcc', messages, entries)
    )
    return folder / 'mpcc'
