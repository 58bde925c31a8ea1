"""Wait for a condition in a test, and fail with a message when it does not become true."""

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


def lives(pid: int) -> bool:
    """Tell whether a process is there and no zombie."""
    try:
        return Path(f'/proc/{pid}/stat').read_text().rpartition(')')[2].split()[0] != 'Z'
    except (FileNotFoundError, ProcessLookupError):
        return False
