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

# takes one processor away from everything of lower priority
OCCUPY = """
import os, sys, time
os.sched_setaffinity(0, {int(sys.argv[1])})
os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(int(sys.argv[2])))
end = time.monotonic() + 0.3
while time.monotonic() < end:
    pass
"""


# takes it away for 0.02 s at a time, and gives it back for 0.01 s
BURSTS = OCCUPY.replace(
    '    pass',
    '    burst = time.monotonic() + 0.02\n'
    '    while time.monotonic() < burst:\n'
    '        pass\n'
    '    time.sleep(0.01)',
)


def lost_s(processor, priority, program=OCCUPY):
    """Return the time lost while a program of a priority computes on a processor."""
    with stalls.Stalls() as found:
        since_ns = time.time_ns()
        command = [sys.executable, '-c', program, str(processor), str(priority)]
        done = subprocess.run(command, capture_output=True, text=True)
        if 'PermissionError' in done.stderr:
            pytest.skip('only a user who may give real-time priority can take a processor away')
        time.sleep(5 * stalls.TURN_S)
    assert done.returncode == 0, done.stderr
    return found.lost_s(since_ns)


@pytest.mark.parametrize('which', [0, -1])
def test_a_processor_that_is_taken_away_is_noticed_whichever_it_is(which):
    assert lost_s(sorted(os.sched_getaffinity(0))[which], 90) > stalls.STALL_S


def test_a_stop_is_noticed_without_any_right():
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


def test_a_node_that_computes_is_no_stall_of_the_machine():
    processor = min(os.sched_getaffinity(0))
    # the machine may stall by itself: three times in a row only if it is the node
    assert min(lost_s(processor, hooks.PRIORITY) for _ in range(3)) <= stalls.STALL_S


def test_the_priority_is_given_back():
    before = os.sched_getscheduler(0), os.sched_getparam(0).sched_priority
    with stalls.Stalls():
        pass
    assert (os.sched_getscheduler(0), os.sched_getparam(0).sched_priority) == before


def test_a_stall_before_and_long_before_the_fault():
    found = stalls.Stalls()
    found.found = [(10, 0.5), (20, 0.2), (30, 0.1)]
    assert [found.lost_s(since_ns) for since_ns in (0, 20, 21, 31)] == [0.5, 0.2, 0.1, 0.0]


def test_short_stalls_in_a_row_count_together():
    processor = min(os.sched_getaffinity(0))
    assert lost_s(processor, 90, BURSTS) > stalls.STALL_S


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
