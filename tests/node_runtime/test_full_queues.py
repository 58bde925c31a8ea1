"""The last messages of a node arrive even if the queues between two nodes are full."""

import signal
import time

import pytest

RECEIVER = """
import sys, time
from rclpy.node import Node
from msgs_yaml import decode
from node_runtime import ros, spin_node

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
def receive(tmp_path, start_process):
    def start(last, stall_s):
        script = tmp_path / 'receiver.py'
        script.write_text(RECEIVER.format(last=last, stall_s=stall_s))
        process = start_process(script)
        process.until('ready')
        return process

    return start


def sending(publish, last):
    """Return timer code that sends so many messages once somebody listens, and finishes."""
    return (
        'if self.imu.get_subscription_count():\n'
        f'            for k in range(1, {last} + 1):\n'
        f'                {publish}\n'
        '            spin_node.finish(self)\n'
    )


# the second: longer than a wait of two seconds at the end, as a message that is lost on its way
@pytest.mark.parametrize('stall_s', [1.0, 2.5])
def test_the_last_messages_of_a_node_arrive(run, receive, stall_s):
    last = 7_000  # more than the receiver's queue holds: the rest waits in the sender
    receiver = receive(last, stall_s)
    sender = run(tick=sending('self.imu.publish(encode.imu(Imu(k, 0.0, 0.0, 0.0)))', last))
    assert receiver.until('in order') == 'in order True'
    assert (receiver.result()[0], sender.result()[0]) == (0, 0)


def test_lockstep_waits_for_a_subscriber_whose_queue_is_full(run, receive):
    last = 11_500  # more than the queues of both sides hold
    receiver = receive(last, stall_s=2.0)
    sender = run(
        start="self.fast = ros.TemplatePublisher(self, '/vehicle/imu')",
        tick=sending('self.fast.publish(Imu(k, 0.0, 0.0, 0.0))', last),
    )
    assert receiver.until('in order') == 'in order True'
    assert (receiver.result()[0], sender.result()[0]) == (0, 0)


def test_a_signal_ends_a_node_that_waits_for_a_full_queue(run, receive):
    last = 30_000
    receive(last, stall_s=60.0)
    sender = run(
        start="self.fast = ros.TemplatePublisher(self, '/vehicle/imu')",
        tick=sending('self.fast.publish(Imu(k, 0.0, 0.0, 0.0))', last),
    )
    sender.until('tick')
    time.sleep(2.0)
    begin = time.monotonic()
    sender.popen.send_signal(signal.SIGTERM)
    assert sender.result()[0] == 0
    assert time.monotonic() - begin < 12.0  # what docs/promises.md gives a node to end
