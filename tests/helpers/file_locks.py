"""Locks of files as seen by another process."""

import fcntl
from pathlib import Path


def is_locked(path: Path) -> bool:
    """Return whether a process holds a lock on a file."""
    with path.open() as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            return True
    return False
