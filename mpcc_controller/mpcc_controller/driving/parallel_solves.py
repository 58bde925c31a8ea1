"""Several solves at once, each thread with a solver of its own."""

import os
import threading
import weakref
from collections import deque
from collections.abc import Callable, Sequence
from concurrent.futures import Future, wait
from queue import SimpleQueue
from typing import Any

from stage_solver.solution import Solution
from stage_solver.solver import StageSolver


class ParallelSolves:
    """Runs jobs on solvers; which thread takes which job does not change its result.

    The calling thread works too. Where it may wait for a limited time only, another thread works in
    its place: a solve that does not return must not hold the thread that sends the commands.
    """

    def __init__(self, make: Callable[[], StageSolver], most: int):
        """Make one solver per thread with `make`; there are at most `most` jobs at once.

        The calling thread has a job of its own besides, so that `most` + 1 threads may be busy.
        """
        self.solvers = [make() for _ in range(min(most + 1, cores()))]
        self._threads: dict[int, _Thread] = {}  # by the number of the solver
        self._working: dict[int, Future] = {}  # by the number of the solver, submitted last

    @property
    def idle(self) -> list[StageSolver]:
        """The solvers that no thread works with."""
        return [solver for number, solver in enumerate(self.solvers) if self._is_idle(number)]

    def run(
        self,
        own: Callable[[], Any],
        jobs: Sequence[Callable[[StageSolver], Solution]],
        patience_s: Callable[[], float | None] = lambda: None,
    ) -> tuple[Any, list[Solution | None]]:
        """Return the result of `own`, called in this thread, and those of the jobs in order.

        `patience_s`, called when `own` has returned, is how long this thread waits for the jobs
        then, None for as long as they take; with a number it solves none of them itself. A job that
        takes longer has the result None, and its solver is left alone until it returns.

        There are as many threads at work as the process has cores now: a node may have been bound
        to one core after it was built.
        """
        waiting = deque(enumerate(jobs))
        results: list[Solution | None] = [None] * len(jobs)

        def work(solver):
            while True:
                try:
                    index, job = waiting.popleft()
                except IndexError:
                    return
                results[index] = job(solver)

        others = range(1, min(len(self.solvers), cores(), 1 + len(jobs)))
        running = [self._start(number, work) for number in others if self._is_idle(number)]
        try:
            result = own()
            patience = patience_s()
            if patience is None:
                work(self.solvers[0])
            elif waiting and self._is_idle(0):
                running.append(self._start(0, work))
            done, _ = wait(running, patience)
        finally:
            waiting.clear()  # nobody waits for what was not begun
        for future in done:
            future.result()
        return result, [*results]

    def _is_idle(self, number):
        return number not in self._working or self._working[number].done()

    def _start(self, number, work):
        """Let the thread of a solver work, which begins with its first work.

        That is in the process that solves, not in one that it forks from.
        """
        if number not in self._threads:
            self._threads[number] = thread = _Thread()
            weakref.finalize(self, thread.end)
        future = self._threads[number].submit(work, self.solvers[number])
        self._working[number] = future
        return future


class _Thread:
    """A thread that calls functions, one after another.

    The end of the process does not wait for it, as it does for those of a ThreadPoolExecutor. Its
    real-time priority is below that of the thread that makes it: on one core that one would not get
    on, either, before the function returns.
    """

    def __init__(self):
        self._calls = SimpleQueue()
        threading.Thread(target=_serve, args=(self._calls,), name='candidates', daemon=True).start()

    def submit(self, function, argument) -> Future:
        """Call a function after those before it."""
        future = Future()
        self._calls.put((future, function, argument))
        return future

    def end(self) -> None:
        """Let the thread end after the last function."""
        self._calls.put(None)


def _serve(calls):
    if os.sched_getscheduler(0) == os.SCHED_FIFO:
        lower = max(os.sched_getparam(0).sched_priority - 1, 1)
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(lower))
    while call := calls.get():
        future, function, argument = call
        try:
            future.set_result(function(argument))
        except BaseException as error:  # that of the caller, who asks for the result
            future.set_exception(error)
        del call, future, function, argument  # it would keep them until the next call


def cores() -> int:
    """Return how many cores the calling thread may use."""
    return len(os.sched_getaffinity(0))
