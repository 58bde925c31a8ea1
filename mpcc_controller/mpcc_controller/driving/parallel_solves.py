"""Several solves at once, each thread with a solver of its own."""

import os
from collections import deque
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor, wait
from typing import Any

from stage_solver.solution import Solution, StageSolver

PARALLEL = 'riccati'  # the solver that releases Python's lock and may run in threads


class ParallelSolves:
    """Runs jobs on solvers; which thread takes which job does not change its result.

    The calling thread works too. On one core, and with solvers that hold Python's lock, it does
    all of the work.
    """

    def __init__(self, make: Callable[[], StageSolver], most: int):
        """Make one solver per thread with `make`; there are at most `most` jobs at once.

        The calling thread has a job of its own besides, so that `most` + 1 threads may be busy.
        """
        first = make()
        can_share = first.name == PARALLEL
        threads = min(most + 1, cores()) if can_share else 1
        self.solvers = [first, *(make() for _ in range(threads - 1))]
        self._pool: ThreadPoolExecutor | None = None
        self._working: dict[int, Future] = {}  # by the number of the solver, submitted last

    def run(
        self,
        own: Callable[[], Any],
        jobs: Sequence[Callable[[StageSolver], Solution]],
        patience_s: Callable[[], float | None] = lambda: None,
    ) -> tuple[Any, list[Solution | None]]:
        """Return the result of `own`, called in this thread, and those of the jobs in order.

        `patience_s`, called when this thread has no work left, is how long it waits for the others,
        None for as long as it takes. A job that takes longer has the result None, and its solver is
        left alone until it returns.

        There are as many threads as the process has cores now: a node may have been bound to one
        core after it was built.
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

        helpers = [
            number
            for number in range(1, min(len(self.solvers), cores(), 1 + len(jobs)))
            if number not in self._working or self._working[number].done()
        ]
        if helpers and self._pool is None:  # in the process that solves, not in one it forks from
            self._pool = ThreadPoolExecutor(len(self.solvers) - 1, 'candidates')
        running = {n: self._pool.submit(work, self.solvers[n]) for n in helpers}
        self._working |= running
        result = own()
        work(self.solvers[0])
        done, _ = wait(running.values(), patience_s())
        for future in done:
            future.result()
        return result, [*results]


def cores() -> int:
    """Return how many cores the calling thread may use."""
    return len(os.sched_getaffinity(0))
