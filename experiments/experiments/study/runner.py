"""The runs of a study, simulated in parallel over the cores; results are cached on the disk."""

import json
import os
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from bags.errors import BagError
from experiments.pool import Pool
from experiments.study import run_spec
from experiments.study.run_spec import RunSpec
from stage_solver import compile_cache

Progress = Callable[[str, int, int], None]  # label, runs done, runs in all


class Record(NamedTuple):
    """One run and its results."""

    spec: RunSpec
    metrics: dict[str, Any]  # see bags.evaluation.metrics
    solver: dict[str, Any]  # see run_spec.solver_statistics

    def __repr__(self) -> str:
        return f'Record({self.spec!r}, {len(self.metrics)} metrics)'

    def value(self, name: str) -> Any:
        """Return a number by dotted name: 'min_v2o_per_obstacle_m.1', 'solver.failed' ..."""
        value = self.metrics | {'solver': self.solver}
        for part in name.split('.'):
            value = value[part]
        return value

    @property
    def is_cleared(self) -> bool:
        """Whether the run was completed without touching an obstacle or leaving the road."""
        is_safe = not self.value('collided') and self.value('min_v2e_m') > 0.0
        return self.value('completed') and is_safe


class Runner:
    """A context that simulates runs; an interrupted study continues with the missing runs.

    jobs      processes, by default one per core
    progress  called after every run
    cache     folder of the results, by default beside the compiled solvers; a file per
              run_spec.cache_key
    """

    def __init__(
        self,
        jobs: int | None = None,
        progress: Progress = lambda *_: None,
        cache: Path | None = None,
    ):
        self.jobs = jobs or len(os.sched_getaffinity(0))
        self.progress = progress
        self.cache = cache or compile_cache.cache_dir() / 'drives'
        self.simulated = 0  # runs that were not cached
        if self.jobs < 1:
            raise BagError(f'jobs: must be at least 1, is {jobs}')
        self._pool = Pool(self.jobs)

    def __enter__(self):
        self.cache.mkdir(parents=True, exist_ok=True)
        self._pool.__enter__()
        return self

    def __exit__(self, *error):
        self._pool.__exit__(*error)

    def run(
        self, specs: Sequence[RunSpec], label: str, done_before: int = 0, total: int | None = None
    ) -> list[Record]:
        """Return the record of every spec, in their order. Raises BagError.

        `done_before` of `total` runs with this label were done by earlier calls.
        """
        keys = {spec: run_spec.cache_key(run_spec.prepare(spec)) for spec in specs}
        files = {spec: self.cache / f'{key}.json' for spec, key in keys.items()}
        results = {spec: _read(file) for spec, file in files.items()}
        missing = [spec for spec, result in results.items() if result is None]
        total = len(files) if total is None else total
        done = done_before + len(files) - len(missing)
        self.progress(label, done, total)

        def count():
            nonlocal done
            done += 1
            self.simulated += 1
            self.progress(label, done, total)

        tasks = [(spec, files[spec]) for spec in missing]
        results |= zip(missing, self._pool.run(_simulate, tasks, count))
        return [Record(spec, **results[spec]) for spec in specs]


def _simulate(spec, file):
    result = run_spec.measure(spec)
    # written whole or not at all, also when another study writes the same run
    with tempfile.NamedTemporaryFile('w', dir=file.parent, suffix='.part', delete=False) as part:
        json.dump(result, part, allow_nan=False)
    os.replace(part.name, file)
    return result


def _read(file):
    try:
        return json.loads(file.read_text())
    except FileNotFoundError:
        return None
