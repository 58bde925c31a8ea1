"""Drives spread over the cores: processes of their own, results in the order of the tasks."""

import ctypes
import multiprocessing
import os
import signal
from collections.abc import Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from contextlib import contextmanager

from bags.experiments.processes import PR_SET_PDEATHSIG
from bags.tuning import objective
from bags.tuning.objective import Score


@contextmanager
def pool(jobs: int) -> Iterator[ProcessPoolExecutor]:
    """Yield `jobs` processes; leaving gives up what has not begun and waits for what has."""
    # started afresh, not forked: the bars of the terminal are drawn by a thread
    workers = ProcessPoolExecutor(jobs, multiprocessing.get_context('spawn'), _begin)
    try:
        yield workers
    finally:
        workers.shutdown(cancel_futures=True)


def _begin():
    # Ctrl-C is for the parent, which then ends its workers; should it be killed, they end too
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL)
    os.environ['OPENBLAS_NUM_THREADS'] = '1'


def drives(workers: ProcessPoolExecutor, tasks: Iterable[tuple], on_each) -> list[Score]:
    """Return the Score of every task, arguments of `objective.drive`; call `on_each()` after each.

    Which process drives what, and when, changes nothing. Raises what a drive raises.
    """
    futures = [workers.submit(objective.drive, *task) for task in tasks]
    for done in as_completed(futures):
        done.result()
        on_each()
    return [future.result() for future in futures]
