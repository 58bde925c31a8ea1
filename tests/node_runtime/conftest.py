"""Node processes."""

import os
import subprocess
import sys
import threading

import pytest

SLOWEST_S = 60.0

NODE = """
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated
from rclpy.node import Node
from msgs_yaml import encode
from node_runtime import ros, spin_node
from node_runtime.parameters import Range, Struct
from msgs_yaml.types import Imu

class Params(Struct):
    gain: Annotated[float, Range(0.0, 9.0, 'N')]

class TestNode(Node):
    def __init__(self):
        super().__init__('test_node')
        self.params = ros.declare(self, Params, Path({defaults!r}))
        self.imu = ros.publisher(self, '/vehicle/imu')
        print('gain', self.params.gain, flush=True)
        self.create_timer(0.05, self.on_timer)
        {start}

    def on_timer(self):
        print('tick', flush=True)
        {tick}

    def close(self):
        print('close', flush=True)
        {close}

    def destroy_node(self):
        {destroy}
        super().destroy_node()

sys.exit(spin_node.spin(TestNode))
"""


class Process:
    """A node in a process of its own."""

    def __init__(self, script, *arguments, **environment):
        env = {**os.environ, **environment}
        if 'ROS_AUTOMATIC_DISCOVERY_RANGE' not in environment:
            del env['ROS_AUTOMATIC_DISCOVERY_RANGE']
        command = [sys.executable, str(script), *arguments]
        pipes = {'stdout': subprocess.PIPE, 'stderr': subprocess.PIPE}
        self.popen = subprocess.Popen(command, env=env, text=True, **pipes)

        # a process that hangs ends here, and the test that waits for it fails
        self.watchdog = threading.Timer(SLOWEST_S, self.popen.kill)
        self.watchdog.start()

    def until(self, word):
        for line in self.popen.stdout:
            if word in line:
                return line.strip()
        raise AssertionError(f'ended without {word!r}: {self.popen.stderr.read()}')

    def result(self):
        # not `communicate`: it does not return what `until` has read ahead; the watchdog ends both
        out, err = self.popen.stdout.read(), self.popen.stderr.read()
        self.popen.wait()
        # where parameters come from is information
        errors = [line for line in err.splitlines(True) if not line.startswith('[INFO]')]
        return self.popen.returncode, out, ''.join(errors)

    def close(self):
        self.watchdog.cancel()
        self.popen.kill()
        self.popen.communicate()


@pytest.fixture
def start_process(domain):
    """Factory of node processes; whatever still runs at the end of the test is ended."""
    started = []

    def start(script, *arguments, **environment):
        started.append(Process(script, *arguments, **environment))
        return started[-1]

    yield start
    for process in started:
        process.close()


@pytest.fixture
def run(tmp_path, start_process):
    """Return run(*arguments, start=, tick=, close=, destroy=): a node with code of its own."""

    def start_node(*arguments, start='', tick='', close='', destroy='', **environment):
        defaults = tmp_path / 'node.yaml'
        defaults.write_text('/**:\n  ros__parameters:\n    gain: 2.0  # N\n')
        script = tmp_path / 'node.py'
        own = {'start': start, 'tick': tick, 'close': close, 'destroy': destroy}
        script.write_text(NODE.format(defaults=str(defaults), **own))
        return start_process(script, *arguments, **environment)

    return start_node
