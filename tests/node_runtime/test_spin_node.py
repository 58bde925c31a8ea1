"""A node process starts, runs and ends as a person and a supervisor expect."""

import os
import signal
import time
from typing import NamedTuple

import pytest

from node_runtime import shutdown

HELD = "__import__('ctypes').PyDLL(None).sleep(60)"
SLEEP = "__import__('time').sleep"
REFUSED = "raise __import__('node_runtime.parameters').parameters.ParameterError('gain: no')"
HALF_MADE = f"""
        class Held:
            def __del__(self):
                print('freed', flush=True)
                {HELD}
        self.held = Held()
        print('half', flush=True)
        """
INT, TERM = signal.SIGINT, signal.SIGTERM
LIMIT_S = 2.0  # of the shutdown, instead of 4 s: what hangs is waited for
LIMITED = f'spin_node._SHUTDOWN_S = {LIMIT_S}'


class End(NamedTuple):
    """The code of a node, when which signals are sent, and how it ends."""

    own: dict[str, str]  # at start, tick, close and destroy
    signals: tuple[int, ...] = ()
    after: str = 'tick'  # what it says before they are sent
    code: int = 0
    error: str = ''  # in its errors; '' for none at all
    says: str = ''
    never: str = 'nothing'
    within_s: float = 60.0  # what does not end by itself says so in its errors


FINISH = 'spin_node.finish(self, 3)'
ZERO = 'ZeroDivisionError'
HANGS = {'error': shutdown.TRACEBACK_START, 'within_s': 12.0}
# both signals, and each kind of hang: test_shutdown.py
ENDS = {
    # a terminal and a supervisor may both send it
    'in a callback': End({'tick': f"{SLEEP}(1.0); print('whole')"}, (INT, TERM), says='whole'),
    'at the start': End({'start': f'{SLEEP}(60)'}, (TERM,), 'gain', never='tick'),
    'its own code': End({'tick': 'self.exit_code = 5'}, (TERM,), code=5),
    'it finishes': End({'tick': FINISH}, code=3, says='close', never='tick\ntick'),
    'it finishes at the start': End({'start': FINISH}, after='gain', code=3, never='tick'),
    'an error': End({'tick': '1 / 0'}, code=1, error=ZERO, says='close'),
    'its own code and it hangs': End(
        {'start': LIMITED, 'tick': 'self.exit_code = 5', 'destroy': HELD},
        (INT,),
        code=5,
        says='close',
        **HANGS,
    ),
    'a long close': End(
        {'start': LIMITED, 'close': f'{SLEEP}({1.5 * LIMIT_S}); self.exit_code = 6'},
        (INT,),
        code=6,
        says='close',
    ),
    'an error in close': End({'close': '1 / 0'}, (INT,), code=1, error=ZERO),
    'a wrong parameter at the start and it hangs': End(
        {'start': LIMITED + HALF_MADE + REFUSED},
        after='half',
        code=os.EX_CONFIG,
        says='freed',
        **HANGS,
    ),
}


@pytest.mark.parametrize('case', ENDS)
def test_a_node_ends_in_bounded_time_with_its_code(run, case):
    end = ENDS[case]
    node = run(**end.own)
    node.until(end.after)
    begin = time.monotonic()
    for number in end.signals:
        node.popen.send_signal(number)
    code, out, err = node.result()
    assert code == end.code
    assert end.error in err if end.error else err == ''
    assert end.says in out
    assert end.never not in out
    assert out.count('close') <= 1
    assert time.monotonic() - begin < end.within_s


EARS = """
import os, socket
filters = []
for name in os.listdir('/proc/self/fd'):
    try:
        ear = socket.socket(fileno=int(name))
    except OSError:
        continue
    if ear.type == socket.SOCK_DGRAM and ear.family == socket.AF_INET:
        filters.append(len(ear.getsockopt(socket.SOL_SOCKET, 26, 64)))  # how many instructions
    ear.detach()
print('filters', *filters, flush=True)
"""


def test_a_node_receives_nothing_while_it_shuts_down(run, tmp_path):
    """Fast DDS may wait for ever for the end of what it hears meanwhile."""
    (tmp_path / 'ears.py').write_text(EARS)
    node = run(tick='import ears', destroy='import importlib, ears; importlib.reload(ears)')
    hears = node.until('filters').split()[1:]
    node.popen.send_signal(signal.SIGINT)
    code, out, err = node.result()
    assert (code, err) == (0, '')
    assert len(hears) >= 3  # multicast, unicast, user data
    assert set(hears) == {'0'}
    assert out.split('filters')[1].split() == ['1'] * len(hears)


@pytest.mark.parametrize(
    ('arguments', 'error'),
    [
        (['-p', 'gain:=10'], 'gain: is 10; allowed 0 to 9 N'),
        (['-p', 'gain'], "Couldn't parse parameter override rule"),
        (['--params-file', '/nowhere.yaml'], "Couldn't parse params file"),
    ],
)
def test_a_wrong_command_line_is_one_clear_message_and_no_start(run, arguments, error):
    code, out, err = run('--ros-args', *arguments).result()
    assert code == os.EX_CONFIG
    assert error in err
    assert 'Traceback' not in err
    assert 'gain' not in out


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
def connect(tmp_path, start_process, run):
    """Return connect(last, stall_s, fast): a receiver that stalls, and what sends to it."""

    def start(last, stall_s, fast):
        script = tmp_path / 'receiver.py'
        script.write_text(RECEIVER.format(last=last, stall_s=stall_s))
        receiver = start_process(script)
        receiver.until('ready')
        message = 'Imu(k, 0.0, 0.0, 0.0)'
        sending = (
            f'self.fast.publish({message})' if fast else f'self.imu.publish(encode.imu({message}))'
        )
        sender = run(
            start="self.fast = ros.TemplatePublisher(self, '/vehicle/imu')" if fast else '',
            tick='if self.imu.get_subscription_count():\n'
            f'            for k in range(1, {last} + 1):\n'
            f'                {sending}\n'
            '            spin_node.finish(self)\n',
        )
        return receiver, sender

    return start


@pytest.mark.parametrize(
    ('last', 'stall_s', 'fast'),
    [
        # more than the receiver's queue holds: the rest waits in the sender, for longer than two
        # seconds, as a message that is lost on its way
        (7_000, 2.5, False),
        # more than the queues of both sides hold: lockstep waits for the subscriber
        (11_500, 2.0, True),
    ],
)
def test_the_last_messages_of_a_node_arrive(connect, last, stall_s, fast):
    receiver, sender = connect(last, stall_s, fast)
    assert receiver.until('in order') == 'in order True'
    assert (receiver.result()[0], sender.result()[0]) == (0, 0)


def test_a_signal_ends_a_node_that_waits_for_a_full_queue(connect):
    _, sender = connect(30_000, 60.0, True)
    sender.until('tick')
    time.sleep(2.0)
    sender.popen.send_signal(signal.SIGTERM)
    assert sender.result()[0] == 0  # not 1, as after the 30 s that it waits for a dead process
