"""Parallel calls, each lane in a process of its own; a single lane is this process."""

import ctypes
import multiprocessing
import os
import signal
from collections.abc import Callable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait

import stalls

PR_SET_PDEATHSIG = 1  # linux/prctl.h
PARALLEL_LANES = 2  # where one drive may have priority over the other work


def default() -> int:
    """Return the number of lanes that disturb no drive on the wall clock."""
    has_room = len(os.sched_getaffinity(0)) > 1
    return PARALLEL_LANES if has_room and stalls.may_set_priority() else 1


class Lanes:
    """A context manager; at its end all lanes have ended."""

    def __init__(self, count: int):
        if count < 1:
            raise ValueError(f'lanes: {count}; at least 1')
        self.count = count
        self.pool = None
        if count > 1:  # spawn: a fork would share the locks of this process
            spawn = multiprocessing.get_context('spawn')
            self.pool = ProcessPoolExecutor(count, spawn, initializer=_end_with_parent)

    def __enter__(self):
        return self

    def __exit__(self, *error):
        if self.pool:
            self.pool.shutdown(cancel_futures=True)

    def results(self, call: Callable, queue: list[tuple]) -> Iterator[tuple[tuple, object]]:
        """Yield (arguments, result) of `call` with each of `queue`, in the order of completion.

        Items that are added to the queue meanwhile are processed too. Raises the error of a call.
        """
        running: dict[Future, tuple] = {}
        while queue or running:
            while queue and len(running) < self.count:
                arguments = queue.pop(0)
                running[self._submit(call, arguments)] = arguments
            for done in wait(running, return_when=FIRST_COMPLETED).done:
                yield running.pop(done), done.result()

    def _submit(self, call, arguments):
        if self.pool:
            return self.pool.submit(call, *arguments)
        done = Future()
        done.set_result(call(*arguments))
        return done


def _end_with_parent():
    """End this process when its parent ends, for whatever reason."""
    ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGTERM)
