"""Wait for a condition in a test, and fail with a message; what processes do meanwhile."""

import os
import time
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

POLL_S = 0.01

T = TypeVar('T')


def wait_until(
    condition: Callable[[], T],
    seconds: float,
    message: str | Callable[[], str],
    pause: Callable[[], object] = lambda: time.sleep(POLL_S),
) -> T:
    """Call `condition` until it returns something true, and return that.

    `pause` is called between two calls: it sleeps, or lets a node work for a moment. Raises
    AssertionError with the message after `seconds` of wall time; a message that is a function is
    called only then, so that it can quote a log.
    """
    end = time.monotonic() + seconds
    while not (value := condition()):
        if time.monotonic() > end:
            text = message() if callable(message) else message
            raise AssertionError(f'waited for {seconds:g} s: {text}')
        pause()
    return value


def processor_s(pid: int) -> float:
    """Return user and system time of a process and its threads so far [s]."""
    fields = Path(f'/proc/{pid}/stat').read_text().rpartition(')')[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf('SC_CLK_TCK')


def lives(pid: int) -> bool:
    """Tell whether any thread of a process is there and has not ended.

    The first one may be a zombie while another one still holds the pipes of the process.
    """
    threads = Path(f'/proc/{pid}/task')
    try:
        states = [
            (one / 'stat').read_text().rpartition(')')[2].split()[0] for one in threads.iterdir()
        ]
    except (FileNotFoundError, ProcessLookupError):
        return (threads / f'{pid}').exists() and lives(pid)  # a thread ended meanwhile
    return any(state not in 'ZX' for state in states)
