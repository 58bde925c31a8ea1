"""When the machine stood still: threads, one pinned to each processor, that got no turn.

A virtual machine may lose one of its processors for a while and keep the others; a single watcher
sees that only when it happens to run there. It may also lose it many times in a row, each time for
less than a tick: what was lost within a tenth of a second counts together.

Only a thread with a priority above the nodes' can tell a machine that stands still from nodes that
compute. Where the user may not give it, nobody watches, no stall is found, and nothing is excused;
threads of ordinary priority would only take their turns from the nodes.
"""

import contextlib
import os
import threading
import time
from collections import deque

import hooks

TURN_S = 0.01
LATE_S = 0.005  # what a scheduler may take is no loss
# above the nodes': what they compute is no stall of the machine, however long it takes
PRIORITY = hooks.PRIORITY + 1
STALL_S = 0.04  # a tick of the controller has 0.05
WINDOW_S = 0.1  # the limit of the age of states and of commands
CALM_S = 2.0
LONGEST_WAIT_S = 60.0


class Stalls:
    """Watches over the machine while it is entered."""

    def __init__(self):
        self.found: list[tuple[int, float]] = []  # wall time [ns], lost by then [s]
        self.over = threading.Event()
        processors = sorted(os.sched_getaffinity(0)) if may_prefer() else []
        self.threads = [
            threading.Thread(target=self.watch, args=(processor,), daemon=True)
            for processor in processors
        ]

    def watch(self, processor: int):
        """Note the time without a turn on one processor."""
        thread = threading.get_native_id()
        with contextlib.suppress(OSError):
            os.sched_setaffinity(thread, {processor})
        prefer(thread)
        last = time.monotonic()
        recent = deque()  # turns within the window: when, time lost before it
        while not self.over.wait(TURN_S):
            now = time.monotonic()
            late_s = now - last - TURN_S
            recent.append((now, late_s if late_s > LATE_S else 0.0))
            while recent[0][0] < now - WINDOW_S:
                recent.popleft()
            self.found.append((time.time_ns(), sum(lost_s for _, lost_s in recent)))
            last = now

    def lost_s(self, since_ns: int) -> float:
        """Return the most time lost within a window that ended after an instant of the wall clock.

        A stall counts whole, however long, even where only its end is in the window.
        """
        # the watchers still append: a copy is taken in one step
        return max((lost_s for end_ns, lost_s in self.found[:] if end_ns >= since_ns), default=0.0)

    def __enter__(self):
        self.before = os.sched_getscheduler(0), os.sched_getparam(0)
        if self.threads:  # who holds the lock of the interpreter must not wait for a node
            prefer(0)
        for thread in self.threads:
            thread.start()
        return self

    def __exit__(self, *error):
        self.over.set()
        if self.threads:
            give_back(*self.before)
        for thread in self.threads:
            thread.join()


def prefer(thread: int) -> None:
    """Give a thread of this process its priority; what it starts gets none. PermissionError."""
    policy = os.SCHED_FIFO | os.SCHED_RESET_ON_FORK
    os.sched_setscheduler(thread, policy, os.sched_param(PRIORITY))


def give_back(policy: int, parameters: os.sched_param) -> None:
    """Give this thread the priority that it had."""
    try:
        os.sched_setscheduler(0, policy, parameters)
    except PermissionError:  # who is not root cannot take back what it said about forks
        os.sched_setscheduler(0, policy | os.SCHED_RESET_ON_FORK, parameters)


def may_prefer() -> bool:
    """Tell whether the user may give real-time priority."""
    before = os.sched_getscheduler(0), os.sched_getparam(0)
    try:
        prefer(0)
    except PermissionError:
        return False
    give_back(*before)
    return True


def wait_until_calm() -> None:
    """Wait for 2 s without a stall, a minute at the longest."""
    began = time.monotonic()
    with Stalls() as stalls:
        while time.monotonic() - began < LONGEST_WAIT_S:
            since_ns = time.time_ns()
            time.sleep(CALM_S)
            if stalls.lost_s(since_ns) <= STALL_S:
                break
