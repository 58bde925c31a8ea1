"""Detection of stalls of the machine."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import hooks
import pytest
import stalls

# occupies one processor with a priority; prints how long it was not scheduled itself
OCCUPY = """
import os, sys, time
os.sched_setaffinity(0, {int(sys.argv[1])})
os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(int(sys.argv[2])))
now, lost = time.monotonic(), 0.0
end = now + 0.3
while now < end:
    before, now = now, time.monotonic()
    lost += now - before if now - before > 0.001 else 0.0
print(lost)
"""

# occupies it for 0.02 s at a time, with pauses of 0.01 s
BURSTS = """
import os, sys, time
os.sched_setaffinity(0, {int(sys.argv[1])})
os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(int(sys.argv[2])))
end = time.monotonic() + 0.3
while time.monotonic() < end:
    burst = time.monotonic() + 0.02
    while time.monotonic() < burst:
        pass
    time.sleep(0.01)
print(0.0)
"""


def lost_s(processor, priority, program=OCCUPY):
    """Return the time lost while a program of a priority computes, and what it lost itself."""
    with stalls.Stalls() as measured:
        since_ns = time.time_ns()
        command = [sys.executable, '-c', program, str(processor), str(priority)]
        result = subprocess.run(command, capture_output=True, text=True)
        time.sleep(5 * stalls.TURN_S)
    assert result.returncode == 0, result.stderr
    return measured.lost_s(since_ns), float(result.stdout)


@pytest.mark.alone
@pytest.mark.needs('priority')
@pytest.mark.parametrize('which', [0, -1])
def test_losing_any_processor_is_detected(which):
    lost, _ = lost_s(sorted(os.sched_getaffinity(0))[which], 90)
    assert lost > stalls.STALL_S


@pytest.mark.alone
@pytest.mark.needs('priority')
def test_a_stop_of_the_watchers_is_detected():
    program = (
        'import sys, time, stalls\n'
        'with stalls.Stalls() as measured:\n'
        '    print("watches", flush=True)\n'
        '    sys.stdin.readline()\n'
        '    time.sleep(0.1)\n'
        'print(measured.lost_s(0))\n'
    )
    with subprocess.Popen(
        [sys.executable, '-c', program],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        cwd=Path(__file__).parent,
    ) as watcher:
        assert watcher.stdout.readline() == 'watches\n'
        time.sleep(5 * stalls.TURN_S)
        watcher.send_signal(signal.SIGSTOP)
        time.sleep(0.3)
        watcher.send_signal(signal.SIGCONT)
        output, _ = watcher.communicate('go on\n', timeout=240)
    assert float(output) > 0.2


@pytest.mark.alone
@pytest.mark.needs('priority')
def test_a_computing_node_is_no_stall_of_the_machine():
    processors = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {min(processors)})  # one watcher, on the processor of the node
    try:
        lost, lost_by_node = lost_s(min(processors), hooks.PRIORITY)
    finally:
        os.sched_setaffinity(0, processors)
    # a stall of the machine stops the node too
    assert lost <= stalls.STALL_S + lost_by_node


def test_without_the_right_to_set_priority_no_stall_is_detected(monkeypatch):
    def refuse(*given):
        raise PermissionError

    monkeypatch.setattr(os, 'sched_setscheduler', refuse)
    assert not stalls.may_set_priority()
    with stalls.Stalls() as measured:
        assert measured.threads == []
    assert measured.lost_s(0) == 0.0


def test_the_priority_is_restored():
    before = os.sched_getscheduler(0), os.sched_getparam(0).sched_priority
    with stalls.Stalls():
        pass
    assert (os.sched_getscheduler(0), os.sched_getparam(0).sched_priority) == before


def test_a_stall_before_and_long_before_the_fault():
    measured = stalls.Stalls()
    measured.samples = [(10, 0.5), (20, 0.2), (30, 0.1)]
    assert [measured.lost_s(since_ns) for since_ns in (0, 20, 21, 31)] == [0.5, 0.2, 0.1, 0.0]


@pytest.mark.alone
@pytest.mark.needs('priority')
def test_short_stalls_in_a_row_are_summed():
    lost, _ = lost_s(min(os.sched_getaffinity(0)), 90, BURSTS)
    assert lost > stalls.STALL_S


class Machine:
    """Replaces the stalls and the clock of the machine by given values."""

    def __init__(self, stall_s):
        self.now, self.stall_s = 0.0, stall_s

    def monotonic(self):
        return self.now

    def time_ns(self):
        return round(self.now * 1e9)

    def sleep(self, seconds):
        self.now += seconds

    def lost_s(self, since_ns):
        return self.stall_s.pop(0)

    def __enter__(self):
        return self

    def __exit__(self, *error):
        pass


@pytest.mark.parametrize(
    ('stall_s', 'waited_s'), [([0.0], 2.0), ([0.3, 0.05, 0.04], 6.0), ([0.3] * 100, 60.0)]
)
def test_waits_until_the_machine_has_no_stall_but_at_most_a_minute(monkeypatch, stall_s, waited_s):
    machine = Machine(stall_s)
    monkeypatch.setattr(stalls, 'time', machine)
    monkeypatch.setattr(stalls, 'Stalls', lambda: machine)
    stalls.wait_until_calm()
    assert machine.now == waited_s
