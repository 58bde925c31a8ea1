"""What is seen of a machine that stands still."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import hooks
import pytest
import stalls

# takes one processor away from everything of lower priority; prints for how long in all it was
# itself without a turn
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

# takes it away for 0.02 s at a time, and gives it back for 0.01 s
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
    with stalls.Stalls() as found:
        since_ns = time.time_ns()
        command = [sys.executable, '-c', program, str(processor), str(priority)]
        done = subprocess.run(command, capture_output=True, text=True)
        time.sleep(5 * stalls.TURN_S)
    assert done.returncode == 0, done.stderr
    return found.lost_s(since_ns), float(done.stdout)


@pytest.mark.alone
@pytest.mark.needs('priority')
@pytest.mark.parametrize('which', [0, -1])
def test_a_processor_that_is_taken_away_is_noticed_whichever_it_is(which):
    lost, _ = lost_s(sorted(os.sched_getaffinity(0))[which], 90)
    assert lost > stalls.STALL_S


@pytest.mark.alone
@pytest.mark.needs('priority')
def test_a_stop_of_the_watchers_is_noticed():
    program = (
        'import sys, time, stalls\n'
        'with stalls.Stalls() as found:\n'
        '    print("watches", flush=True)\n'
        '    sys.stdin.readline()\n'
        '    time.sleep(0.1)\n'
        'print(found.lost_s(0))\n'
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
        said, _ = watcher.communicate('go on\n', timeout=30)
    assert float(said) > 0.2


@pytest.mark.alone
@pytest.mark.needs('priority')
def test_a_node_that_computes_is_no_stall_of_the_machine():
    processors = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {min(processors)})  # one watcher, on the processor of the node
    try:
        lost, lost_by_node = lost_s(min(processors), hooks.PRIORITY)
    finally:
        os.sched_setaffinity(0, processors)
    # when the machine stands still the node gets no turn either
    assert lost <= stalls.STALL_S + lost_by_node


def test_who_may_not_give_priority_has_no_watchers_and_finds_no_stall(monkeypatch):
    def refuse(*given):
        raise PermissionError

    monkeypatch.setattr(os, 'sched_setscheduler', refuse)
    assert not stalls.may_prefer()
    with stalls.Stalls() as found:
        assert found.threads == []
    assert found.lost_s(0) == 0.0


def test_the_priority_is_given_back():
    before = os.sched_getscheduler(0), os.sched_getparam(0).sched_priority
    with stalls.Stalls():
        pass
    assert (os.sched_getscheduler(0), os.sched_getparam(0).sched_priority) == before


def test_a_stall_before_and_long_before_the_fault():
    found = stalls.Stalls()
    found.found = [(10, 0.5), (20, 0.2), (30, 0.1)]
    assert [found.lost_s(since_ns) for since_ns in (0, 20, 21, 31)] == [0.5, 0.2, 0.1, 0.0]


@pytest.mark.alone
@pytest.mark.needs('priority')
def test_short_stalls_in_a_row_count_together():
    lost, _ = lost_s(min(os.sched_getaffinity(0)), 90, BURSTS)
    assert lost > stalls.STALL_S


class Machine:
    """A machine of which every look is known, and its clock."""

    def __init__(self, stood_s):
        self.now, self.stood_s = 0.0, stood_s

    def monotonic(self):
        return self.now

    def time_ns(self):
        return round(self.now * 1e9)

    def sleep(self, seconds):
        self.now += seconds

    def lost_s(self, since_ns):
        return self.stood_s.pop(0)

    def __enter__(self):
        return self

    def __exit__(self, *error):
        pass


@pytest.mark.parametrize(
    ('stood_s', 'waited_s'), [([0.0], 2.0), ([0.3, 0.05, 0.04], 6.0), ([0.3] * 100, 60.0)]
)
def test_waits_until_the_machine_is_calm_but_not_for_ever(monkeypatch, stood_s, waited_s):
    machine = Machine(stood_s)
    monkeypatch.setattr(stalls, 'time', machine)
    monkeypatch.setattr(stalls, 'Stalls', lambda: machine)
    stalls.wait_until_calm()
    assert machine.now == waited_s
