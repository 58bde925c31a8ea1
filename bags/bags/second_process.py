"""Run a function in a second process while this one continues."""

import ctypes
import os
import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from multiprocessing import get_context
from typing import Any

PR_SET_PDEATHSIG = 1  # linux/prctl.h


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
    process = get_context('fork').Process(
        target=_run, args=(os.getpid(), function, arguments), daemon=True
    )
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


def _run(first, function, arguments):
    # when the first process is killed, the kernel ends this one
    ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL)
    if os.getppid() != first:  # killed before prctl took effect
        raise SystemExit(1)
    # Ctrl-C in the terminal reaches both processes: the first one ends the second
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        function(*arguments)
    except Exception:
        raise SystemExit(1) from None
