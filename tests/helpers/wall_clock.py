"""Drives on the wall clock beside other tests: their nodes have priority, one drive at a time.

Tests get this module from the fixture `wall_clock`: it marks them as `alone` where the user may not
set real-time priority.
"""

import contextlib
import fcntl
import os
import tempfile
from collections.abc import Iterator
from functools import cache
from pathlib import Path

# what else is needed is imported late: every session of tests loads this module


@cache
def may_set_priority() -> bool:
    """Return whether the user may set real-time priority."""
    before = os.sched_getscheduler(0), os.sched_getparam(0)
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(1))
    except PermissionError:
        return False
    os.sched_setscheduler(0, *before)
    return True


@cache
def priorities() -> dict[str, int]:
    """Return the priority of each role, {} where the user may not set it."""
    from realtime import FIFO

    return FIFO if may_set_priority() else {}


@contextlib.contextmanager
def own_drive() -> Iterator[None]:
    """Let no other test of this user drive on the wall clock with priority meanwhile."""
    path = Path(tempfile.gettempdir(), f'drive_on_the_wall_clock_{os.getuid()}.lock')
    with path.open('w') as handle:
        fcntl.flock(handle, fcntl.LOCK_EX)
        yield


def with_priority(**settings: dict) -> dict[str, dict]:
    """Return parameters by role: `settings`, and the priority of each node."""
    given = {role: {'realtime.priority': number} for role, number in priorities().items()}
    return {r: settings.get(r, {}) | given.get(r, {}) for r in settings.keys() | given.keys()}


def options() -> list[str]:
    """Return the options of `experiments run` that give every node its priority."""
    given = (f'{role}.realtime.priority={number}' for role, number in priorities().items())
    return [word for setting in given for word in ('--set', setting)]
