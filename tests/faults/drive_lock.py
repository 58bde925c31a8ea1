"""A lock that allows one drive on the wall clock at a time.

Beside it only processes without real-time priority run: node graphs that start or end, drives in
lockstep, the evaluation of bags.
"""

import contextlib
import fcntl
import os
import tempfile
from collections.abc import Iterator
from pathlib import Path


@contextlib.contextmanager
def hold(mode: str) -> Iterator[None]:
    """Hold the lock of this user and machine in realtime; do nothing in lockstep."""
    if mode != 'realtime':
        yield
        return
    path = Path(tempfile.gettempdir(), f'faults_{os.getuid()}_realtime_drive.lock')
    with path.open('w') as handle:
        fcntl.flock(handle, fcntl.LOCK_EX)
        yield
