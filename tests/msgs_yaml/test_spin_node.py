"""A node process starts, runs and ends as a person and a supervisor expect."""

import os
import signal
import subprocess
import sys
import threading
import time

import pytest

pytestmark = pytest.mark.ros
DOMAIN = '2'
TIMEOUT_S = 20.0

NODE = """
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated
from rclpy.node import Node
from msgs_yaml import encode, ros, spin_node
from msgs_yaml.parameters import Range
from msgs_yaml.types import Imu

@dataclass(frozen=True)
class Params:
    gain: Annotated[float, Range(0.0, 9.0, 'N')]

class TestNode(Node):
    def __init__(self):
        super().__init__('test_node')
        self.params = ros.declare(self, Params, Path({defaults!r}))
        self.imu = ros.publisher(self, '/vehicle/imu')
        print('range', __import__('os').environ['ROS_AUTOMATIC_DISCOVERY_RANGE'], flush=True)
        print('gain', self.params.gain, flush=True)
        self.create_timer(0.05, self.on_timer)
        {start}

    def on_timer(self):
        print('tick', flush=True)
        {tick}

sys.exit(spin_node.spin(TestNode))
"""


class Process:
    """A node in a process of its own."""

    def __init__(self, script, *arguments, **environment):
        env = {**os.environ, 'ROS_DOMAIN_ID': DOMAIN, **environment}
        env.pop('ROS_AUTOMATIC_DISCOVERY_RANGE', None)
        env.update(environment)
        command = [sys.executable, str(script), *arguments]
        pipes = {'stdout': subprocess.PIPE, 'stderr': subprocess.PIPE}
        self.popen = subprocess.Popen(command, env=env, text=True, **pipes)

        # a process that hangs ends here, and the test that waits for it fails
        self.watchdog = threading.Timer(TIMEOUT_S, self.popen.kill)
        self.watchdog.start()

    def until(self, word):
        for line in self.popen.stdout:
            if word in line:
                return line.strip()
        raise AssertionError(f'ended without {word!r}: {self.popen.stderr.read()}')

    def result(self):
        out, err = self.popen.communicate(timeout=TIMEOUT_S)
        return self.popen.returncode, out, err

    def close(self):
        self.watchdog.cancel()
        self.popen.kill()
        self.popen.communicate()


@pytest.fixture
def run(tmp_path):
    started = []

    def start(*arguments, start='', tick='', **environment):
        defaults = tmp_path / 'node.yaml'
        defaults.write_text('/**:\n  ros__parameters:\n    gain: 2.0  # N\n')
        script = tmp_path / 'node.py'
        script.write_text(NODE.format(defaults=str(defaults), start=start, tick=tick))
        started.append(Process(script, *arguments, **environment))
        return started[-1]

    yield start
    for process in started:
        process.close()


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_a_node_cleanly(run, number):
    node = run()
    node.until('tick')
    begin = time.monotonic()
    node.popen.send_signal(number)
    code, _, err = node.result()
    assert (code, err) == (0, '')
    assert time.monotonic() - begin < 5.0


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
def test_a_signal_does_not_tear_a_callback(run, number):
    node = run(tick="__import__('time').sleep(1.0); print('whole', flush=True)")
    node.until('tick')
    node.popen.send_signal(number)
    node.popen.send_signal(number)  # a terminal and a supervisor may both send it
    code, out, err = node.result()
    assert (code, err) == (0, '')
    assert 'whole' in out


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
def test_a_signal_interrupts_the_making_of_a_node(run, number):
    node = run(start="__import__('time').sleep(60)")
    node.until('gain')
    begin = time.monotonic()
    node.popen.send_signal(number)
    code, out, err = node.result()
    assert (code, err) == (0, '')
    assert 'tick' not in out
    assert time.monotonic() - begin < 5.0


def test_a_signal_keeps_the_exit_code_that_the_node_has_set(run):
    node = run(tick='self.exit_code = 5')
    node.until('tick')
    node.popen.send_signal(signal.SIGTERM)
    assert node.result()[0] == 5


def test_a_node_that_finishes_ends_with_its_code_and_at_once(run):
    node = run(tick='spin_node.finish(self, 3)')
    code, out, err = node.result()
    assert (code, err) == (3, '')
    assert out.count('tick') == 1


def test_a_node_may_finish_before_it_spins(run):
    code, out, _ = run(start='spin_node.finish(self, 4)').result()
    assert code == 4
    assert 'tick' not in out


def test_an_error_in_a_callback_ends_the_node_and_is_shown(run):
    code, _, err = run(tick='1 / 0').result()
    assert code == 1
    assert 'ZeroDivisionError' in err


@pytest.mark.parametrize(
    ('arguments', 'says'),
    [
        (['-p', 'gian:=1.0'], "gian: this node has no such parameter; did you mean 'gain'?"),
        (['-p', 'gain:=10'], 'gain: is out of range with 10; allowed 0 to 9 N'),
        (['-p', 'gain:=many'], "gain: must be a number, is 'many'; allowed 0 to 9 N"),
        (['-p', 'mode:=fast'], "mode: is 'fast'; allowed lockstep or realtime"),
        (['-p', 'gain'], "Couldn't parse parameter override rule"),
        (['--params-file', '/nowhere.yaml'], "Couldn't parse params file"),
    ],
)
def test_a_wrong_command_line_is_one_clear_message_and_no_start(run, arguments, says):
    code, out, err = run('--ros-args', *arguments).result()
    assert code == os.EX_CONFIG
    assert says in err
    assert 'Traceback' not in err
    assert 'gain' not in out


def test_a_typo_in_a_parameter_file_stops_the_node(run, tmp_path):
    file = tmp_path / 'mine.yaml'
    file.write_text('test_node:\n  ros__parameters:\n    gainn: 3.0\n')
    code, _, err = run('--ros-args', '--params-file', str(file)).result()
    assert code == os.EX_CONFIG
    assert "gainn: this node has no such parameter; did you mean 'gain'?" in err


def test_parameters_come_from_the_command_line(run):
    node = run('--ros-args', '-p', 'gain:=1', '-p', 'use_sim_time:=true')
    assert node.until('gain') == 'gain 1.0'


def test_discovery_stays_on_this_machine_unless_the_user_says_otherwise(run):
    assert run().until('range') == 'range LOCALHOST'
    other = run(ROS_AUTOMATIC_DISCOVERY_RANGE='SUBNET')
    assert other.until('range') == 'range SUBNET'


RECEIVER = """
import sys, time
from rclpy.node import Node
from msgs_yaml import decode, ros, spin_node

class Receiver(Node):
    def __init__(self):
        super().__init__('receiver')
        self.declare_parameter('mode', 'lockstep')
        self.stamps = []
        ros.subscribe(self, '/vehicle/imu', self.on_imu, raw=True)
        print('ready', flush=True)

    def on_imu(self, raw):
        self.stamps.append(decode.stamp_ns_of(raw))
        if len(self.stamps) == 1:
            time.sleep({stall_s})
        if self.stamps[-1] == {last}:
            print('in order', self.stamps == list(range(1, {last} + 1)), flush=True)
            spin_node.finish(self)

sys.exit(spin_node.spin(Receiver))
"""


@pytest.fixture
def receive(tmp_path):
    started = []

    def start(last, stall_s):
        script = tmp_path / 'receiver.py'
        script.write_text(RECEIVER.format(last=last, stall_s=stall_s))
        started.append(Process(script))
        started[-1].until('ready')
        return started[-1]

    yield start
    for process in started:
        process.close()


def sending(publish, last):
    """Return timer code that sends so many messages once somebody listens, and finishes."""
    return (
        'if self.imu.get_subscription_count():\n'
        f'            for k in range(1, {last} + 1):\n'
        f'                {publish}\n'
        '            spin_node.finish(self)\n'
    )


def test_what_a_node_sends_last_still_arrives(run, receive):
    last = 7_000  # more than the receiver's queue holds: the rest waits in the sender
    receiver = receive(last, stall_s=1.0)
    sender = run(tick=sending('self.imu.publish(encode.imu(Imu(k, 0.0, 0.0, 0.0)))', last))
    assert receiver.until('in order') == 'in order True'
    assert (receiver.result()[0], sender.result()[0]) == (0, 0)


def test_lockstep_waits_for_a_subscriber_whose_queue_is_full(run, receive):
    last = 11_500  # more than the queues of both sides hold
    receiver = receive(last, stall_s=2.0)
    sender = run(
        start="self.fast = ros.fast_publisher(self, '/vehicle/imu')",
        tick=sending('self.fast.publish(Imu(k, 0.0, 0.0, 0.0))', last),
    )
    assert receiver.until('in order') == 'in order True'
    assert (receiver.result()[0], sender.result()[0]) == (0, 0)


def test_a_signal_ends_a_node_that_waits_for_a_full_queue(run, receive):
    last = 30_000
    receive(last, stall_s=60.0)
    sender = run(
        start="self.fast = ros.fast_publisher(self, '/vehicle/imu')",
        tick=sending('self.fast.publish(Imu(k, 0.0, 0.0, 0.0))', last),
    )
    sender.until('tick')
    time.sleep(2.0)
    begin = time.monotonic()
    sender.popen.send_signal(signal.SIGTERM)
    assert sender.result()[0] == 0
    assert time.monotonic() - begin < 8.0
