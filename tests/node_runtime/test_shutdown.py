"""A process leaves when it has said so, whatever holds it, and hears nothing meanwhile."""

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

LEAVE_S = 1.0
SLOWEST_S = 20.0
# PyDLL keeps the interpreter while it calls, as a destructor of the middleware does
HELD = 'ctypes.PyDLL(None).sleep(60)'
SPINS = 'while True: pass'
LONGER = 'time.sleep(2.0)'
PUNCTUAL = """
os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
try:
    os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(10))
except PermissionError:
    os._exit(77)
"""


def leave(body, before='', after=''):
    """Run a body in a process that is to leave with 7; return exit code, outputs and time [s]."""
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
    return done.returncode, done.stdout, done.stderr, time.monotonic() - begin


@pytest.mark.parametrize('body', [HELD, SPINS, LONGER])
def test_a_process_that_is_held_ends_with_its_code_and_says_where(body):
    code, _, said, took_s = leave(body)
    assert code == 7
    assert re.search(r'Timeout.*\n.*\n  File "<string>", line 5 in <module>', said), said
    assert took_s > LEAVE_S


@pytest.mark.parametrize('body', [HELD, SPINS])
def test_priority_on_one_core_does_not_keep_a_process(body):
    code, _, _, _ = leave(body, before=PUNCTUAL)
    if code == 77:
        report_missing('priority')
    assert code == 7


def test_a_process_without_any_priority_ends_too():
    idle = 'os.sched_setscheduler(0, os.SCHED_IDLE, os.sched_param(0))'
    assert leave(HELD, before=idle)[0] == 7


def test_a_process_that_is_not_held_goes_on():
    assert leave('pass', after=f'{LONGER}; print("there")')[:3] == (0, 'there\n', '')


def test_an_error_while_leaving_is_not_swallowed():
    code, _, said, _ = leave('1 / 0')
    assert code == 1
    assert 'ZeroDivisionError' in said


def test_what_was_said_before_is_not_lost():
    assert leave(HELD, before='print("said")')[:2] == (7, 'said\n')


@pytest.mark.parametrize(
    'none',
    ['resource.RLIMIT_SIGPENDING, (0, 0)', 'resource.RLIMIT_NOFILE, (0, 0)'],
    ids=['timers', 'descriptors'],
)
def test_where_the_system_has_nothing_left_the_process_goes_on(none):
    before = f'import resource\nresource.setrlimit({none})'
    code, out, _, _ = leave(f'{LONGER}; print(shutdown.drop_incoming() >= 0)', before=before)
    assert (code, out) == (0, 'True\n')


SCRIPT = """
import os, socket, sys, time
from node_runtime import shutdown
ear = socket.socket({family}, socket.SOCK_DGRAM)
ear.bind(({host!r}, 0))
stream = socket.create_server(({host!r}, 0), family={family})
print(ear.getsockname()[1], stream.getsockname()[1], flush=True)
print(ear.recv(9).decode(), flush=True)
before = os.listdir('/proc/self/fd')
print(shutdown.drop_incoming(), flush=True)
assert os.listdir('/proc/self/fd') == before
sys.stdin.readline()
ear.settimeout(0.5)
try:
    print(ear.recv(9).decode(), flush=True)
except TimeoutError:
    print('nothing', flush=True)
ear.sendto(b'goodbye', ({host!r}, int(sys.stdin.readline())))
caller, _ = stream.accept()
print(caller.recv(9).decode(), flush=True)
"""


@pytest.fixture(params=[(socket.AF_INET, '127.0.0.1'), (socket.AF_INET6, '::1')], ids=['4', '6'])
def peer(request):
    """A socket, its family and its host."""
    family, host = request.param
    with socket.socket(family, socket.SOCK_DGRAM) as made:
        if family == socket.AF_INET6:
            require('ipv6')
        made.bind((host, 0))
        made.settimeout(SLOWEST_S)
        yield made, family, host


def test_the_deaf_hear_no_packet_and_still_speak(peer):
    peer, family, host = peer
    pipes = {'stdin': subprocess.PIPE, 'stdout': subprocess.PIPE, 'text': True}
    script = SCRIPT.format(family=f'socket.{family.name}', host=host)
    with subprocess.Popen([sys.executable, '-c', script], **pipes) as deaf:
        # what hangs ends here, and the test that waits for it fails
        watchdog = threading.Timer(SLOWEST_S, deaf.kill)
        watchdog.start()
        packets, streams = map(int, deaf.stdout.readline().split())
        peer.sendto(b'first', (host, packets))
        assert deaf.stdout.readline() == 'first\n'
        assert deaf.stdout.readline() == '1\n'
        peer.sendto(b'second', (host, packets))
        deaf.stdin.write(f'now\n{peer.getsockname()[1]}\n')
        deaf.stdin.flush()
        assert deaf.stdout.readline() == 'nothing\n'
        assert peer.recv(9) == b'goodbye'
        with socket.create_connection((host, streams), timeout=SLOWEST_S) as caller:
            caller.sendall(b'stream')
            assert deaf.stdout.readline() == 'stream\n'
        assert deaf.wait(SLOWEST_S) == 0
        watchdog.cancel()


def test_what_is_queued_is_waited_for(monkeypatch):
    monkeypatch.setattr(shutdown, 'DRAIN_S', SLOWEST_S)
    ear, late_s = socket.socket(socket.AF_INET, socket.SOCK_DGRAM), 0.2
    with ear:
        ear.bind(('127.0.0.1', 0))
        ear.sendto(b'queued', ear.getsockname())
        heard = []
        listener = threading.Timer(late_s, lambda: heard.append(ear.recv(9)))
        begin = time.monotonic()
        listener.start()
        shutdown.drop_incoming()
        took_s = time.monotonic() - begin
        listener.join()
        assert heard == [b'queued']
        assert late_s <= took_s < SLOWEST_S


def test_what_nobody_hears_is_not_waited_for_long():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as ear:
        ear.bind(('127.0.0.1', 0))
        ear.sendto(b'queued', ear.getsockname())
        begin = time.monotonic()
        shutdown.drop_incoming()
        assert shutdown.DRAIN_S <= time.monotonic() - begin < 4.0 * shutdown.DRAIN_S


def test_a_kernel_without_filters_is_no_error(monkeypatch):
    monkeypatch.setattr(shutdown, 'SO_ATTACH_FILTER', -1)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as ear:
        ear.bind(('127.0.0.1', 0))
        assert shutdown.drop_incoming() == 0
        assert ear.getsockname()[1]


both = pytest.mark.parametrize('number', shutdown.SIGNALS)


@pytest.fixture(autouse=True)
def handlers_of_the_tests():
    """This process goes on: it gets its handlers back."""
    before = {number: signal.getsignal(number) for number in shutdown.SIGNALS}
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


@both
def test_at_first_a_signal_interrupts(number):
    with shutdown.signals_as_interrupts(), pytest.raises(KeyboardInterrupt):
        signal.raise_signal(number)


@both
def test_later_it_asks_as_often_as_it_comes(number):
    asked = []
    with shutdown.signals_as_interrupts():
        shutdown.call_on_signal(lambda: asked.append(number))
        signal.raise_signal(number)
        signal.raise_signal(number)
    assert asked == [number, number]


@both
def test_afterwards_nothing_interrupts_the_end_of_the_process(number):
    with shutdown.signals_as_interrupts():
        assert signal.getsignal(number) is not signal.SIG_IGN
    assert signal.getsignal(number) is signal.SIG_IGN


def test_a_node_may_have_its_own_handler():
    heard, asked = [], []
    with shutdown.signals_as_interrupts():
        signal.signal(signal.SIGTERM, lambda *_: heard.append('own'))
        shutdown.call_on_signal(lambda: asked.append('asked'))
        signal.raise_signal(signal.SIGTERM)
        signal.raise_signal(signal.SIGINT)
    assert (heard, asked) == (['own'], ['asked'])


@both
def test_a_signal_that_the_parent_ignores_is_handled(number):
    asked = []
    signal.signal(number, signal.SIG_IGN)
    with shutdown.signals_as_interrupts():
        with pytest.raises(KeyboardInterrupt):
            signal.raise_signal(number)
        shutdown.call_on_signal(lambda: asked.append(number))
        signal.raise_signal(number)
    assert asked == [number]
