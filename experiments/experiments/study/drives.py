"""Many drives, in parallel over the cores; what was driven once is read from the disk."""

import json
import os
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from bags.errors import BagError
from experiments.study import case as cases
from experiments.study import measure
from experiments.study.case import Case
from experiments.worker_pool import WorkerPool
from stage_solver import compile_cache

Progress = Callable[[str, int, int], None]  # what is being driven, drives done, drives in all


class Record(NamedTuple):
    """One drive and what came out."""

    case: Case
    metrics: dict[str, Any]  # see verdict.metrics
    solver: dict[str, Any]  # see measure.solver

    def value(self, name: str) -> Any:
        """Return a number by dotted name: 'min_v2o_per_obstacle_m.1', 'solver.failed' ..."""
        found = self.metrics | {'solver': self.solver}
        for part in name.split('.'):
            found = found[part]
        return found


def silent(what: str, done: int, total: int) -> None:
    """Show nothing."""


def default_cache() -> Path:
    """Return the folder that keeps drives, beside the compiled solvers."""
    return compile_cache.cache_dir() / 'drives'


class Drives:
    """A context in which drives are made; an interrupted study goes on where it stopped.

    jobs      processes, by default one per core
    progress  called after every drive
    cache     folder of the results, named by content (see case.key)
    """

    def __init__(
        self, jobs: int | None = None, progress: Progress = silent, cache: Path | None = None
    ):
        self.jobs = jobs or len(os.sched_getaffinity(0))
        self.progress = progress
        self.cache = cache or default_cache()
        self.driven = 0  # anew, not read
        self._pool = WorkerPool(self.jobs)
        if self.jobs < 1:
            raise BagError(f'jobs: must be at least 1, is {jobs}')

    def __enter__(self):
        self.cache.mkdir(parents=True, exist_ok=True)
        return self

    def __exit__(self, *error):
        self._pool.__exit__(*error)

    def of(
        self, chosen: Sequence[Case], what: str, before: int = 0, total: int | None = None
    ) -> list[Record]:
        """Return the record of every case, in their order. Raises BagError.

        `before` drives of `total` were shown as done earlier.
        """
        files = {case: self.cache / f'{cases.key(case)}.json' for case in chosen}
        kept = {case: _read(file) for case, file in files.items()}
        missing = [case for case, record in kept.items() if record is None]
        total = len(files) if total is None else total
        done = before + len(files) - len(missing)
        self.progress(what, done, total)

        def count():
            nonlocal done
            done += 1
            self.driven += 1
            self.progress(what, done, total)

        results = self._pool.run(_drive, [(case, files[case]) for case in missing], count)
        kept |= zip(missing, results)
        return [Record(case, kept[case]['metrics'], kept[case]['solver']) for case in chosen]


def _drive(case, file):
    found = measure.measured(case)
    # whole or not at all, also when another study writes the same drive
    with tempfile.NamedTemporaryFile('w', dir=file.parent, suffix='.part', delete=False) as part:
        json.dump(found, part, allow_nan=False)
    os.replace(part.name, file)
    return found


def _read(file):
    try:
        return json.loads(file.read_text())
    except FileNotFoundError:
        return None
