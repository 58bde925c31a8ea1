"""A process leaves when it has said so, whatever holds it, and hears nothing meanwhile."""

import os
import re
import socket
import subprocess
import sys
import time

import pytest

from msgs_yaml import leaving

LEAVE_S = 1.0
SLOWEST_S = 20.0
# PyDLL keeps the interpreter while it calls, as a destructor of the middleware does
HELD = 'ctypes.PyDLL(None).sleep(60)'
SPINS = 'while True: pass'
PUNCTUAL = """
os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
try:
    os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(10))
except PermissionError:
    pass
"""


def leave(body, before=''):
    """Run a body in a process that is to leave with 7; return exit code, stderr and time [s]."""
    script = f'import ctypes, os\nfrom msgs_yaml import leaving\n{before}\n'
    script += f'with leaving.within({LEAVE_S}, 7):\n    {body}\n'
    begin = time.monotonic()
    done = subprocess.run(
        [sys.executable, '-c', script], capture_output=True, text=True, timeout=SLOWEST_S
    )
    return done.returncode, done.stderr, time.monotonic() - begin


@pytest.mark.parametrize('body', [HELD, SPINS, 'ctypes.CDLL(None).sleep(60)'])
def test_a_process_that_is_held_ends_with_its_code_and_says_where(body):
    code, said, took_s = leave(body)
    assert code == 7
    assert re.search(r'Timeout.*\n.*\n  File "<string>", line 5 in <module>', said), said
    assert took_s > LEAVE_S


@pytest.mark.parametrize('body', [HELD, SPINS])
def test_priority_on_one_core_does_not_keep_a_process(body):
    assert leave(body, before=PUNCTUAL)[0] == 7


def test_a_process_that_is_not_held_goes_on():
    code, said, took_s = leave('pass\nprint(__import__("time").sleep(1.5))')
    assert (code, said) == (0, '')
    assert took_s > 1.5


def test_an_error_while_leaving_is_not_swallowed():
    code, said, _ = leave('1 / 0')
    assert code == 1
    assert 'ZeroDivisionError' in said


def test_without_a_timer_the_body_still_runs():
    none = 'import resource\nresource.setrlimit(resource.RLIMIT_SIGPENDING, (0, 0))'
    code, said, _ = leave('print("left")', before=none)
    assert (code, said) == (0, '')


SCRIPT = """
import os, socket, sys
from msgs_yaml import leaving
ear = socket.socket({family}, socket.SOCK_DGRAM)
ear.bind(({host!r}, 0))
stream = socket.create_server(({host!r}, 0), family={family})
print(ear.getsockname()[1], stream.getsockname()[1], flush=True)
print(ear.recv(9).decode(), flush=True)
print(leaving.deafen(), flush=True)
sys.stdin.readline()
ear.settimeout(0.5)
try:
    print(ear.recv(9).decode(), flush=True)
except TimeoutError:
    print('nothing', flush=True)
ear.sendto(b'goodbye', ({host!r}, int(sys.stdin.readline())))
caller, _ = stream.accept()
print(caller.recv(9).decode(), flush=True)
print(len(os.listdir('/proc/self/fd')))
"""


@pytest.mark.parametrize(
    ('family', 'host'), [('socket.AF_INET', '127.0.0.1'), ('socket.AF_INET6', '::1')]
)
def test_the_deaf_hear_no_packet_and_still_speak(family, host):
    kind = socket.AF_INET if family == 'socket.AF_INET' else socket.AF_INET6
    if kind == socket.AF_INET6 and not os.path.exists('/proc/net/if_inet6'):
        pytest.skip('no IPv6 here')
    pipes = {'stdin': subprocess.PIPE, 'stdout': subprocess.PIPE, 'text': True}
    script = SCRIPT.format(family=family, host=host)
    deaf = subprocess.Popen([sys.executable, '-c', script], **pipes)
    with deaf, socket.socket(kind, socket.SOCK_DGRAM) as peer:
        peer.bind((host, 0))
        peer.settimeout(SLOWEST_S)
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
        assert int(deaf.stdout.readline()) <= 8  # nothing was left open, nothing closed


def test_a_kernel_without_filters_is_no_error(monkeypatch):
    monkeypatch.setattr(leaving, 'SO_ATTACH_FILTER', -1)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as ear:
        ear.bind(('127.0.0.1', 0))
        assert leaving.deafen() == 0
        assert ear.getsockname()[1]
