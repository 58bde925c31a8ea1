"""Which drives may take place beside each other.

A drive on the wall clock has the machine to itself, but for what has no real-time priority: other
rings that start or end, drives in lockstep, the judging of bags.
"""

import contextlib
import fcntl
import os
import tempfile
from collections.abc import Iterator
from pathlib import Path


@contextlib.contextmanager
def drive(mode: str) -> Iterator[None]:
    """Wait until a drive of a mode may take place; the lock is this user's, on this machine."""
    if mode != 'realtime':
        yield
        return
    path = Path(tempfile.gettempdir(), f'faults_{os.getuid()}_realtime_drive.lock')
    with path.open('w') as handle:
        fcntl.flock(handle, fcntl.LOCK_EX)
        yield
