"""A process ends in bounded time with its exit code, and receives no packets meanwhile."""

import os
import re
import signal
import socket
import subprocess
import sys
import threading
import time

import pytest
from capabilities import report_missing, require

from node_runtime import shutdown

LEAVE_S = 0.8
SLOWEST_S = 60.0
# PyDLL keeps the interpreter while it calls, as a destructor of the middleware does
HANGS = 'ctypes.PyDLL(None).sleep(60)'
SPINS = 'while True: pass'
LONGER = 'time.sleep(1.2)'
PUNCTUAL = """
os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
try:
    os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(10))
except PermissionError:
    os._exit(77)
"""
IDLE = 'os.sched_setscheduler(0, os.SCHED_IDLE, os.sched_param(0))'
NONE_LEFT = 'import resource\nresource.setrlimit(resource.{}, (0, 0))'
DROPS = f'{LONGER}; print(shutdown.drop_incoming() >= 0)'
TRACEBACK = r'Timeout.*\n.*\n  File "<string>", line \d+ in <module>'
LEAVES = {
    # before it, the body, after it; exit code, what is printed, the errors
    'a destructor': ('print("said")', HANGS, '', 7, 'said\n', TRACEBACK),
    'a loop': ('', SPINS, '', 7, '', TRACEBACK),
    'a destructor with priority': (PUNCTUAL, HANGS, '', 7, '', TRACEBACK),
    'a destructor when idle': (IDLE, HANGS, '', 7, '', TRACEBACK),
    'nothing': ('', 'pass', f'{LONGER}; print("there")', 0, 'there\n', '^$'),
    'an error': ('', '1 / 0', '', 1, '', 'ZeroDivisionError'),
    'no timers': (NONE_LEFT.format('RLIMIT_SIGPENDING'), DROPS, '', 0, 'True\n', ''),
    'no descriptors': (NONE_LEFT.format('RLIMIT_NOFILE'), DROPS, '', 0, 'True\n', ''),
}


@pytest.mark.parametrize('case', LEAVES)
def test_a_process_leaves_with_its_code_in_bounded_time_only_if_it_hangs(case):
    before, body, after, code, printed, errors = LEAVES[case]
    script = f'import ctypes, os, time\nfrom node_runtime import shutdown\n{before}\n'
    script += f'with shutdown.exit_after({LEAVE_S}, 7):\n    {body}\n{after}\n'
    environment = {k: v for k, v in os.environ.items() if k != 'PYTHONUNBUFFERED'}
    begin = time.monotonic()
    done = subprocess.run(
        [sys.executable, '-c', script],
        capture_output=True,
        text=True,
        timeout=SLOWEST_S,
        env=environment,
    )
    if done.returncode == 77:
        report_missing('priority')
    assert (done.returncode, done.stdout) == (code, printed)
    assert re.search(errors, done.stderr), done.stderr
    assert code != 7 or time.monotonic() - begin > LEAVE_S


@pytest.fixture
def udp():
    """A socket that can send to itself."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as udp:
        udp.bind(('127.0.0.1', 0))
        udp.settimeout(SLOWEST_S)
        yield udp


@pytest.mark.parametrize('host', ['127.0.0.1', '::1'])
def test_a_process_that_drops_packets_can_still_send_and_its_streams_go_on(host):
    family = socket.AF_INET6 if ':' in host else socket.AF_INET
    if family == socket.AF_INET6:
        require('ipv6')
    with (
        socket.socket(family, socket.SOCK_DGRAM) as dropping,
        socket.create_server((host, 0), family=family) as stream,
    ):
        dropping.bind((host, 0))
        before = os.listdir(shutdown.DESCRIPTORS)
        assert shutdown.drop_incoming() >= 1
        assert os.listdir(shutdown.DESCRIPTORS) == before
        with socket.socket(family, socket.SOCK_DGRAM) as later:
            later.bind((host, 0))
            later.settimeout(SLOWEST_S)
            later.sendto(b'dropped', dropping.getsockname())
            dropping.sendto(b'goodbye', later.getsockname())
            assert later.recv(9) == b'goodbye'
            with pytest.raises(BlockingIOError):
                dropping.recv(9, socket.MSG_DONTWAIT)
        with socket.create_connection((host, stream.getsockname()[1]), SLOWEST_S) as caller:
            caller.sendall(b'stream')
            accepted, _ = stream.accept()
            with accepted:
                assert accepted.recv(9) == b'stream'


def test_packets_that_are_queued_are_still_received(monkeypatch, udp):
    monkeypatch.setattr(shutdown, 'DRAIN_S', SLOWEST_S)
    udp.sendto(b'queued', udp.getsockname())
    late_s, received = 0.2, []
    listener = threading.Timer(late_s, lambda: received.append(udp.recv(9)))
    begin = time.monotonic()
    listener.start()
    shutdown.drop_incoming()
    assert late_s <= time.monotonic() - begin < SLOWEST_S
    listener.join()
    assert received == [b'queued']


def test_packets_that_no_thread_receives_are_waited_for_half_a_second(udp):
    udp.sendto(b'queued', udp.getsockname())
    begin = time.monotonic()
    shutdown.drop_incoming()
    assert shutdown.DRAIN_S <= time.monotonic() - begin < 4.0 * shutdown.DRAIN_S


def test_a_kernel_without_filters_is_no_error(monkeypatch, udp):
    monkeypatch.setattr(shutdown, 'SO_ATTACH_FILTER', -1)
    assert shutdown.drop_incoming() == 0
    assert udp.getsockname()[1]


@pytest.fixture(autouse=True)
def restored_handlers():
    """This process goes on: it gets its handlers back."""
    before = {number: signal.getsignal(number) for number in shutdown.SIGNALS}
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


@pytest.mark.parametrize('number', shutdown.SIGNALS)
@pytest.mark.parametrize('handler', [signal.SIG_DFL, signal.SIG_IGN])
def test_a_signal_is_an_interrupt_then_a_request_and_ignored_afterwards(number, handler):
    asked = []
    signal.signal(number, handler)  # a shell may ignore it for what it starts in the background
    with shutdown.signals_as_interrupts():
        with pytest.raises(KeyboardInterrupt):
            signal.raise_signal(number)
        shutdown.call_on_signal(lambda: asked.append(number))
        signal.raise_signal(number)
        signal.raise_signal(number)
    assert asked == [number, number]
    assert signal.getsignal(number) is signal.SIG_IGN


def test_a_node_may_have_its_own_handler():
    received, asked = [], []
    with shutdown.signals_as_interrupts():
        signal.signal(signal.SIGTERM, lambda *_: received.append('own'))
        shutdown.call_on_signal(lambda: asked.append('asked'))
        signal.raise_signal(signal.SIGTERM)
        signal.raise_signal(signal.SIGINT)
    assert (received, asked) == (['own'], ['asked'])
