"""A pool of processes that share work over the cores and end with this program, however it ends."""

import os
import signal
import threading
from collections.abc import Callable, Iterable
from concurrent.futures import ProcessPoolExecutor, as_completed
from multiprocessing import get_context, parent_process
from typing import Any


class WorkerPool:
    """A context with `jobs` processes, started by the first task.

    Leaving it cancels the tasks that have not begun and waits for the others.
    """

    def __init__(self, jobs: int):
        self.jobs = jobs
        self._executor = None

    def __enter__(self):
        return self

    def __exit__(self, *error):
        if self._executor is not None:
            self._executor.shutdown(cancel_futures=True)

    def run(
        self, function: Callable, tasks: Iterable[tuple], on_done: Callable[[], None]
    ) -> list[Any]:
        """Return function(*task) for every task, in their order; call `on_done()` after each.

        Raises the exception of the first task that fails.
        """
        if self._executor is None:
            # spawned: a fork would copy the threads of the progress display
            context = get_context('spawn')
            self._executor = ProcessPoolExecutor(self.jobs, context, _start_worker)
        futures = [self._executor.submit(function, *task) for task in tasks]
        for future in as_completed(futures):
            future.result()
            on_done()
        return [future.result() for future in futures]


def _start_worker():
    # Ctrl-C is for the parent, which then ends its workers
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    # a core each; numpy reads this when it is imported, so nothing here may import it
    os.environ['OPENBLAS_NUM_THREADS'] = '1'
    threading.Thread(target=_exit_with_parent, daemon=True).start()


def _exit_with_parent():
    # PR_SET_PDEATHSIG would not do: it is sent at the end of the parent's thread, too, and never
    # when the parent ended before the call
    parent_process().join()
    os._exit(1)
