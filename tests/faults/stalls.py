"""Stalls of the machine: times in which threads pinned to the processors are not scheduled.

A virtual machine may lose one of its processors for a while and keep the others; a single watcher
detects that only if it runs there. It may also lose it many times in a row, each time for less than
a tick: losses within a tenth of a second are summed.

Only a thread with a priority above the nodes' can distinguish a stall of the machine from computing
nodes. Where the user may not set it, there are no watchers, no stall is detected, and no late run
is retried; threads of ordinary priority would only take processor time from the nodes.
"""

import contextlib
import os
import threading
import time
from collections import deque

import hooks

TURN_S = 0.01
LATE_S = 0.005  # ordinary latency of the scheduler
# above the nodes': their own computation must not look like a stall
PRIORITY = hooks.PRIORITY + 1
STALL_S = 0.04  # a tick of the controller has 0.05
WINDOW_S = 0.1  # the limit of the age of states and of commands
CALM_S = 2.0
LONGEST_WAIT_S = 60.0


class Stalls:
    """A context manager that measures the stalls of the machine."""

    def __init__(self):
        self.samples: list[tuple[int, float]] = []  # wall time [ns], time lost in the window [s]
        self.over = threading.Event()
        processors = sorted(os.sched_getaffinity(0)) if may_set_priority() else []
        self.threads = [
            threading.Thread(target=self.watch, args=(processor,), daemon=True)
            for processor in processors
        ]

    def watch(self, processor: int):
        """Sample the time lost on one processor."""
        thread = threading.get_native_id()
        with contextlib.suppress(OSError):
            os.sched_setaffinity(thread, {processor})
        set_priority(thread)
        last = time.monotonic()
        recent = deque()  # wake-ups within the window: instant, time lost before it
        while not self.over.wait(TURN_S):
            now = time.monotonic()
            late_s = now - last - TURN_S
            recent.append((now, late_s if late_s > LATE_S else 0.0))
            while recent[0][0] < now - WINDOW_S:
                recent.popleft()
            self.samples.append((time.time_ns(), sum(lost_s for _, lost_s in recent)))
            last = now

    def lost_s(self, since_ns: int) -> float:
        """Return the largest time lost in a window that ended after an instant of the wall clock.

        A stall counts completely, even where only its end is in the window.
        """
        # copy atomically: the watchers still append
        return max(
            (lost_s for end_ns, lost_s in self.samples[:] if end_ns >= since_ns), default=0.0
        )

    def __enter__(self):
        self.before = os.sched_getscheduler(0), os.sched_getparam(0)
        if self.threads:  # the thread that holds Python's lock must not wait for a node
            set_priority(0)
        for thread in self.threads:
            thread.start()
        return self

    def __exit__(self, *error):
        self.over.set()
        if self.threads:
            restore_priority(*self.before)
        for thread in self.threads:
            thread.join()


def set_priority(thread: int) -> None:
    """Set PRIORITY for a thread of this process, not for its children. Raises PermissionError."""
    policy = os.SCHED_FIFO | os.SCHED_RESET_ON_FORK
    os.sched_setscheduler(thread, policy, os.sched_param(PRIORITY))


def restore_priority(policy: int, parameters: os.sched_param) -> None:
    """Restore the former priority of this thread."""
    try:
        os.sched_setscheduler(0, policy, parameters)
    except PermissionError:  # an ordinary user cannot reset SCHED_RESET_ON_FORK
        os.sched_setscheduler(0, policy | os.SCHED_RESET_ON_FORK, parameters)


def may_set_priority() -> bool:
    """Return whether the user may set real-time priority."""
    before = os.sched_getscheduler(0), os.sched_getparam(0)
    try:
        set_priority(0)
    except PermissionError:
        return False
    restore_priority(*before)
    return True


def wait_until_calm() -> None:
    """Wait for 2 s without a stall, at most a minute."""
    began = time.monotonic()
    with Stalls() as stalls:
        while time.monotonic() - began < LONGEST_WAIT_S:
            since_ns = time.time_ns()
            time.sleep(CALM_S)
            if stalls.lost_s(since_ns) <= STALL_S:
                break
