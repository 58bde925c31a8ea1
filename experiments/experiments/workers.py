"""Processes that share work over the cores and end with the one that asked, however it ends."""

import os
import signal
import threading
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context, parent_process


def started(jobs: int) -> ProcessPoolExecutor:
    """Return a pool of `jobs` processes; whoever asks shuts it down."""
    # started afresh: a fork would copy the threads of the progress display
    return ProcessPoolExecutor(jobs, get_context('spawn'), _begin)


def _begin():
    # Ctrl-C is for the parent, which then ends its workers
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    # a core each; read when numpy is loaded, so nothing here may load it
    os.environ['OPENBLAS_NUM_THREADS'] = '1'
    threading.Thread(target=_await_parent, daemon=True).start()


def _await_parent():
    # not the kernel's signal at the death of the parent: it comes with that of a thread, too, and
    # never when the parent died before it was asked for
    parent_process().join()
    os._exit(1)
