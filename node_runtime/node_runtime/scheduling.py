"""Linux scheduling of a real-time process: priority, core affinity, locked memory. No ROS.

All of it is optional, and priority and locked memory need permission. Refusals of the
system are logged, and the node runs without.
"""

import ctypes
import gc
import os
from pathlib import Path
from typing import Annotated

from node_runtime.parameters import Range, Struct

# linux/mman.h: lock what is mapped now and later, each page once it is in use
MCL_CURRENT, MCL_FUTURE, MCL_ONFAULT = 1, 2, 4
THREADS = Path('/proc/self/task')
ANY = -1


class SchedulingOptions(Struct):
    """Parameters `realtime.*` of every node; used in mode realtime only."""

    priority: Annotated[int, Range(0, 99, 'of SCHED_FIFO for every thread of the node, 0: none')]
    core: Annotated[int, Range(ANY, 1023, 'that the node runs on alone, -1: any')]
    lock_memory: bool  # no page of it is ever swapped out
    collect_garbage: bool  # false: cycles of Python objects are kept for ever


DEFAULTS = SchedulingOptions(priority=0, core=ANY, lock_memory=False, collect_garbage=True)


def apply(options: SchedulingOptions) -> tuple[str, ...]:
    """Request what the options ask for; return a line for each refusal, with what would help."""
    freeze_garbage()
    if not options.collect_garbage:
        gc.disable()
    refusals = []
    if options.core != ANY:
        reason = _refusal(lambda thread: os.sched_setaffinity(thread, {options.core}))
        hint = f'this process may use {sorted(os.sched_getaffinity(0))}'
        refusals += [f'realtime.core={options.core}: {reason}; {hint}'] if reason else []
    libc = ctypes.CDLL(None, use_errno=True)
    if options.lock_memory and libc.mlockall(MCL_CURRENT | MCL_FUTURE | MCL_ONFAULT):
        reason = os.strerror(ctypes.get_errno())
        refusals.append(f'realtime.lock_memory: {reason}; allow it with `ulimit -l unlimited`')
    if options.priority:
        wanted = os.sched_param(options.priority)
        reason = _refusal(lambda thread: os.sched_setscheduler(thread, os.SCHED_FIFO, wanted))
        hint = f'`ulimit -r {options.priority}`, or `rtprio` in /etc/security/limits.conf'
        what = f'realtime.priority={options.priority}: {reason}; allow it with {hint}'
        refusals += [what] if reason else []
    return tuple(refusals)


def freeze_garbage() -> None:
    """Collect garbage now, and exclude the objects that are left from later collections."""
    gc.collect()
    gc.freeze()


def _refusal(change):
    """Change every thread, DDS has some of its own; return why the system refuses, or ''."""
    try:
        for thread in THREADS.iterdir():
            change(int(thread.name))
    except OSError as error:
        return error.strerror
    return ''
