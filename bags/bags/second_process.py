"""Run a function in a second process while this one continues."""

import os
import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from multiprocessing import get_context
from typing import Any


@contextmanager
def concurrently(function: Callable[..., Any], *arguments: Any) -> Iterator[None]:
    """Run function(*arguments), which writes files, in a copy of this process beside the block.

    Where there is one core only, beside other threads, and when the copy fails, the function runs
    in this process after the block: so its errors are raised here.
    """
    if len(os.sched_getaffinity(0)) < 2 or threading.active_count() > 1:
        yield
        function(*arguments)
        return
    # a copy needs neither to pass the arguments nor to import anything
    process = get_context('fork').Process(target=_run, args=(function, arguments), daemon=True)
    process.start()
    try:
        yield
    except BaseException:
        process.kill()
        raise
    finally:
        process.join()
    if process.exitcode:
        function(*arguments)


def _run(function, arguments):
    # Ctrl-C in the terminal reaches both processes: the first one ends the second
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        function(*arguments)
    except Exception:
        raise SystemExit(1) from None
