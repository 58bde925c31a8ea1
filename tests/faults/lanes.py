"""Calls beside each other, each lane in a process of its own; one lane is this process."""

import ctypes
import multiprocessing
import os
import signal
from collections.abc import Callable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait

import stalls

PR_SET_PDEATHSIG = 1  # linux/prctl.h
BESIDE = 2  # lanes where one drive may have priority over what else there is to do


def default() -> int:
    """Return how many lanes disturb no drive on the wall clock."""
    has_room = len(os.sched_getaffinity(0)) > 1
    return BESIDE if has_room and stalls.may_prefer() else 1


class Lanes:
    """A context manager; at its end no lane is left."""

    def __init__(self, count: int):
        if count < 1:
            raise ValueError(f'lanes: {count}; at least 1')
        self.count = count
        self.pool = None
        if count > 1:  # spawn: a fork would share the locks of this process
            spawn = multiprocessing.get_context('spawn')
            self.pool = ProcessPoolExecutor(count, spawn, initializer=_tie)

    def __enter__(self):
        return self

    def __exit__(self, *error):
        if self.pool:
            self.pool.shutdown(cancel_futures=True)

    def results(self, call: Callable, to_do: list[tuple]) -> Iterator[tuple[tuple, object]]:
        """Yield (arguments, result) of a call with each of `to_do`, as they come.

        What is put into the list meanwhile is done, too; an error in a call is raised here.
        """
        running: dict[Future, tuple] = {}
        while to_do or running:
            while to_do and len(running) < self.count:
                arguments = to_do.pop(0)
                running[self._submit(call, arguments)] = arguments
            for done in wait(running, return_when=FIRST_COMPLETED).done:
                yield running.pop(done), done.result()

    def _submit(self, call, arguments):
        if self.pool:
            return self.pool.submit(call, *arguments)
        done = Future()
        done.set_result(call(*arguments))
        return done


def _tie():
    """End this process when the one that started it ends, however it does."""
    ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGTERM)
