"""What Linux can do for a punctual process: priority, a core, memory that stays. No ROS.

None of it is needed, and the first and the third are not given to everybody: what is refused is
said, and the node runs without it.
"""

import ctypes
import gc
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from node_runtime.parameters import Range

# linux/mman.h: what is mapped now and later, each page once it is in use
MCL_CURRENT, MCL_FUTURE, MCL_ONFAULT = 1, 2, 4
THREADS = Path('/proc/self/task')
ANY = -1


@dataclass(frozen=True)
class Options:
    """Parameters `realtime.*` of every node, realtime only."""

    priority: Annotated[int, Range(0, 99, 'of SCHED_FIFO for every thread of the node, 0: none')]
    core: Annotated[int, Range(ANY, 1023, 'that the node runs on alone, -1: any')]
    lock_memory: bool  # no page of it is ever swapped out
    collect_garbage: bool  # false: cycles of Python objects are kept for ever


DEFAULTS = Options(priority=0, core=ANY, lock_memory=False, collect_garbage=True)


def apply(options: Options) -> tuple[str, ...]:
    """Ask for what the options say; return what was refused, and what would help."""
    settle()
    if not options.collect_garbage:
        gc.disable()
    asked = (_core(options), _memory(options), _priority(options))
    return tuple(refusal for refusal in asked if refusal)


def settle() -> None:
    """Collect garbage now, and never look again at what is left."""
    gc.collect()
    gc.freeze()


def _core(options):
    if options.core == ANY:
        return ''
    try:
        for thread in _threads():
            os.sched_setaffinity(thread, {options.core})
    except OSError as error:
        there = sorted(os.sched_getaffinity(0))
        return f'realtime.core={options.core}: {error.strerror}; this process may use {there}'
    return ''


def _memory(options):
    if not options.lock_memory:
        return ''
    libc = ctypes.CDLL(None, use_errno=True)
    if libc.mlockall(MCL_CURRENT | MCL_FUTURE | MCL_ONFAULT):
        why = os.strerror(ctypes.get_errno())
        return f'realtime.lock_memory: {why}; allow it with `ulimit -l unlimited`'
    return ''


def _priority(options):
    if not options.priority:
        return ''
    try:
        for thread in _threads():
            os.sched_setscheduler(thread, os.SCHED_FIFO, os.sched_param(options.priority))
    except OSError as error:
        return (
            f'realtime.priority={options.priority}: {error.strerror}; allow it with '
            f'`ulimit -r {options.priority}`, or `rtprio` in /etc/security/limits.conf'
        )
    return ''


def _threads():
    """Return every thread of this process: those of DDS deliver the messages."""
    return [int(thread.name) for thread in THREADS.iterdir()]
