"""The wall clock that a fault sets: waits for an instant of it notice a jump, as in the kernel."""

import subprocess
import sys

import hooks
import pytest

# waits on a semaphore that is never posted, and sets the clock meanwhile; prints how long it
# waited, and when the clock was set
WAITS = """
import ctypes, struct, sys, threading, time
page, wait_s, jump_s, after_s = sys.argv[1], *map(float, sys.argv[2:])
libc = ctypes.CDLL(None, use_errno=True)
semaphore = ctypes.create_string_buffer(64)
libc.sem_init(semaphore, 0, 0)

def jump():
    with open(page, 'r+b') as clock:
        clock.write(round(jump_s * 1e9).to_bytes(8, 'little', signed=True))
    jumped.append(time.monotonic() - began)

jumped = []
began = time.monotonic()
until = struct.pack('qq', *divmod(time.time_ns() + round(wait_s * 1e9), 10**9))
timer = threading.Timer(after_s, jump)
timer.start()
assert libc.sem_timedwait(semaphore, until) == -1
waited = time.monotonic() - began
timer.join()
print(waited, *jumped)
"""
ATTEMPTS = 50  # to set the clock in time on a busy machine


@pytest.mark.parametrize('wait_s', [0.015, 0.1])
def test_a_wait_lasts_longer_when_the_clock_is_set_back_even_in_its_last_milliseconds(
    tmp_path, wait_s
):
    for _ in range(ATTEMPTS):
        waited_s, jumped_s = waited(tmp_path, wait_s, -0.5, 0.005)
        if jumped_s < wait_s:
            assert waited_s >= wait_s + 0.5
            return
    pytest.fail(f'the clock was never set within the {wait_s} s of the wait')


def test_a_wait_ends_when_the_clock_is_set_beyond_its_end(tmp_path):
    waited_s, _ = waited(tmp_path, 60.0, 120.0, 0.05)
    assert 0.05 <= waited_s < 30.0


def test_a_wait_without_a_jump_has_its_normal_length(tmp_path):
    waited_s, _ = waited(tmp_path, 0.1, 0.0, 0.02)
    assert 0.1 <= waited_s < 30.0


def waited(folder, wait_s, jump_s, after_s):
    clock = hooks.MachineClock(folder)
    arguments = [str(clock.page), *map(str, (wait_s, jump_s, after_s))]
    result = subprocess.run(
        [sys.executable, '-c', WAITS, *arguments],
        env=clock.environment(),
        capture_output=True,
        text=True,
        timeout=240,
    )
    assert result.returncode == 0, result.stderr
    return tuple(map(float, result.stdout.split()))
