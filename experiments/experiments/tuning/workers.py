"""Drives spread over the cores: processes of their own, results in the order of the tasks."""

from collections.abc import Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from contextlib import contextmanager

from experiments import workers
from experiments.tuning import objective
from experiments.tuning.objective import Score


@contextmanager
def pool(jobs: int) -> Iterator[ProcessPoolExecutor]:
    """Yield `jobs` processes; leaving gives up what has not begun and waits for what has."""
    started = workers.started(jobs)
    try:
        yield started
    finally:
        started.shutdown(cancel_futures=True)


def drives(pool: ProcessPoolExecutor, tasks: Iterable[tuple], on_each) -> list[Score]:
    """Return the Score of every task, arguments of `objective.drive`; call `on_each()` after each.

    Which process drives what, and when, changes nothing. Raises what a drive raises.
    """
    futures = [pool.submit(objective.drive, *task) for task in tasks]
    for done in as_completed(futures):
        done.result()
        on_each()
    return [future.result() for future in futures]
