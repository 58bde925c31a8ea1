"""`experiments study settings`: draw settings, drive what is missing of them, write the table.

The stages: settings are built; the car without collision avoidance drives each; the others drive
where it hits obstacle 1; the compared controllers drive the perturbed starts where P1 to P3 hold
for any version of the baseline; the combinations of the factorial drive the first of these.
"""

import json
import time
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

from rich.console import Console

from bags.command_line import print_text
from bags.errors import BagError
from experiments import code_version
from experiments.drive_records import DriveRecords, record_each
from experiments.pool import Pool
from experiments.progress import CountProgress
from experiments.settings import (
    arms,
    drive,
    outcomes,
    plant_variants,
    preconditions,
    preregistration,
)
from experiments.settings import setting as settings
from experiments.settings.drive import DriveTask
from experiments.settings.plant_variants import Variant, build, variant_of
from experiments.settings.preregistration import Preregistration
from experiments.settings.setting import Setting
from node_runtime import provenance

TABLE, OUTCOMES = 'drives.parquet', 'outcomes.parquet'
CHUNK = 64  # points that one task builds
BUILD_ROOTS = ('experiments.settings.setting',)
ENOUGH = 1000  # drawn points per setting; fewer admissible ones mean an error in the file


class Request(NamedTuple):
    """The arguments of `experiments study settings`."""

    folder: Path  # of the results
    count: int  # of settings
    seed: int
    jobs: int
    limit_s: float  # of wall time for one drive
    plan: Path | None = None  # another preregistration than that of the package
    tuned: Path | None = None  # a table with the parameters of `frenet_tuned`
    is_screened: bool = False  # whether only settings that may be accepted are driven by all
    dask: str = ''  # address of a scheduler whose workers drive, instead of `jobs`


def preregistered(request: Request, name: str) -> Request:
    """Return a request for the settings of a run of the preregistration. Raises BagError."""
    if name not in preregistration.RUNS:
        known = ', '.join(preregistration.RUNS)
        raise BagError(f'--preregistered: is {name!r}; allowed {known}')
    run_ = getattr(preregistration.load(request.plan).runs, name)
    return request._replace(count=run_.count, seed=run_.seed, is_screened=run_.screened)


class Drawn(NamedTuple):
    """The settings of a study."""

    settings: Sequence[Setting]
    rejected: Mapping[str, int]  # points by the reason why they are no settings
    points: int  # up to the last setting

    def __repr__(self) -> str:
        return f'Drawn({len(self.settings)} settings of {self.points} points)'


def run(request: Request, console: Console) -> int:
    """Drive, write both tables and say how many settings there are; 0 when no drive failed.

    Raises BagError for unusable input, and KeyboardInterrupt after the tables of the drives so far
    were written.
    """
    plan = preregistration.load(request.plan)
    tuned = read_tuned(request.tuned)
    begin_s = time.monotonic()
    with (
        CountProgress(console) as progress,
        DriveRecords(request.folder) as records,
        Pool(request.jobs, request.dask, partial(code_version.describe, (__name__,))) as pool,
    ):
        study = _Study(plan, tuned, records, pool, request.limit_s, progress)
        interrupted = None
        drawn = study.draw(request.seed, request.count)
        try:
            study.drive_all(drawn.settings, request.is_screened)
        except KeyboardInterrupt as interrupt:
            interrupted = interrupt
        rows = list(study.rows(drawn.settings))
        files = _write(plan, rows, drawn, request, bool(interrupted)) if rows else []
    if interrupted:
        raise KeyboardInterrupt(
            f'{len(rows):,} drives are kept; the same command goes on'
        ) from None
    for line in describe(plan, drawn, rows):
        print_text(console, line)
    print_text(console, f'{time.monotonic() - begin_s:.1f} s; {", ".join(map(str, files))}')
    return 1 if any(row['error'] for row in rows) else 0


def read_tuned(path: Path | None) -> dict[int, dict[str, Any]]:
    """Return the parameters of `frenet_tuned` by setting, {} without a file.

    The file is a Parquet or CSV table with a column `setting` and one per parameter of the
    controller, by dotted name. Raises BagError for another one.
    """
    if path is None:
        return {}
    import pandas

    try:
        read = pandas.read_csv if path.suffix == '.csv' else pandas.read_parquet
        table = read(path).set_index('setting')
    except (OSError, KeyError, ValueError) as error:
        raise BagError(f'{path}: is no table of tuned parameters: {error}') from None
    return {int(number): dict(row) for number, row in table.to_dict('index').items()}


class _Study:
    """The drives of a study: those that are recorded, and those that failed."""

    def __init__(self, plan, tuned, records, pool, limit_s, progress):
        self.plan, self.tuned, self.records = plan, tuned, records
        self.pool, self.limit_s, self.progress = pool, limit_s, progress
        self.errors: dict[str, str] = {}
        # by key and row: equal drives are driven once
        self.tasks: dict[str, dict[tuple[int, str, int], DriveTask]] = {}

    def draw(self, seed: int, count: int) -> Drawn:
        """Return the first `count` settings of a seed. Raises BagError where there are too few."""
        self._build_plants()
        drawn: list[Setting] = []
        rejected: Counter[str] = Counter()
        first, wave = 0, 1
        while True:
            firsts = [first + k * CHUNK for k in range(wave)]
            for start, chunk in zip(firsts, self._build_chunks(seed, firsts)):
                for point in chunk['points']:
                    if isinstance(point['rejected'], str):
                        rejected[point['rejected']] += 1
                    else:
                        drawn.append(_setting_of(point))
                    if len(drawn) == count:
                        return Drawn(drawn, rejected, point['number'] + 1)
                self.progress.show('settings', len(drawn), count)
                first = start + CHUNK
            if first > ENOUGH * count:
                raise BagError(
                    f'{self.plan.path}: {first:,} points gave {len(drawn)} settings; allowed are '
                    f'ranges that give one in {ENOUGH}'
                )
            # about as many points as are missing, so that all processes have work
            share = (len(drawn) + 1) / first
            wave = max(1, min(256, round((count - len(drawn)) / share / CHUNK)))

    def _build_plants(self):
        """Identify every plant before settings are built: each only once."""
        names = Variant._fields
        chosen = [self.plan.dimensions[name].ends() for name in names]
        variants = [Variant(*values) for values in _product(chosen)]
        for done, finished in enumerate(self.pool.finish_each(build, [(v,) for v in variants]), 1):
            if finished.error:
                raise BagError(
                    f'{self.plan.path}: {variants[finished.number]}: {finished.error}'
                ) from None
            self.progress.show('plants', done, len(variants))

    def _build_chunks(self, seed, firsts):
        keys = [_chunk_key(self.plan, seed, first) for first in firsts]
        missing = [n for n, key in enumerate(keys) if key not in self.records]
        tasks = [(self.plan, seed, firsts[n]) for n in missing]
        for finished in self.pool.finish_each(_build_chunk, tasks):
            if finished.error:
                raise finished.error
            self.records.add(keys[missing[finished.number]], finished.value)
        return [json.loads(self.records[key]) for key in keys]

    def drive_all(self, chosen: Sequence[Setting], is_screened: bool) -> None:
        """Drive every stage; screened, the later ones only where P1 to P3 can still be met."""
        self._drive('no avoidance', [self._task(s, arms.NO_CA) for s in chosen])
        hit = [s for s in chosen if preconditions.hits_first_at_all(self._row(s, arms.NO_CA))]
        if is_screened:
            hit = self._screen(hit)
        self._drive('compared', [self._task(s, arm) for s in hit for arm in self._compared(s)])
        accepted = [s for s in hit if self._is_accepted(s)]
        numbers = range(1, len(self.plan.perturbations))
        self._drive(
            'perturbed',
            [self._task(s, arm, n) for s in accepted for arm in self._compared(s) for n in numbers],
        )
        # the factors lead from the MPCC to this version
        matched = [s for s in accepted if self._is_accepted(s, (arms.MATCHED,))]
        crossed = matched[: self.plan.arms.factorial_settings]
        self._drive('factorial', [self._task(s, arm) for s in crossed for arm in arms.COMBINATIONS])

    def _screen(self, chosen):
        """Return the settings that only the baseline can still keep from P1, P2 and P3."""
        conditions = self.plan.preconditions
        able = []
        for setting in chosen:
            row = self._row(setting, arms.NO_CA)
            hits = preconditions.hits_first(row, conditions.P1.by)
            if hits and preconditions.reaches_limit(row, conditions):
                able.append(setting)
        self._drive('MPCC', [self._task(setting, arms.MPCC) for setting in able])
        rows = [(setting, self._row(setting, arms.MPCC)) for setting in able]
        return [
            setting
            for setting, row in rows
            if preconditions.avoids(row, conditions.P2.by)
            and preconditions.reaches_limit(row, conditions)
        ]

    def _compared(self, setting):
        known = (arms.MPCC, arms.MATCHED, arms.LINEAGE)
        return (*known, arms.TUNED) if setting.number in self.tuned else known

    def _is_accepted(self, setting, baselines=arms.BASELINES):
        driven = (arms.NO_CA, *self._compared(setting))
        drives = {(arm, 0): self._row(setting, arm) for arm in driven}
        return outcomes.is_accepted(self.plan, drives, baselines)

    def _task(self, setting, arm, perturbation=0):
        tuned = self.tuned.get(setting.number, arms.NO_PARAMETERS)
        return drive.plan_drive(self.plan, setting, arm, perturbation, tuned)

    def _drive(self, stage, tasks: Sequence[DriveTask]):
        """Drive what is missing, grouped by formulation."""
        by_key: dict[str, DriveTask] = {}
        for task in tasks:
            key = drive.key(task)
            row = task.setting.number, task.name, task.perturbation
            self.tasks.setdefault(key, {})[row] = task
            by_key.setdefault(key, task)
        missing = {key: task for key, task in by_key.items() if key not in self.records}
        if not by_key:
            return
        ended = self.pool.finish_each(
            drive.run,
            [(task,) for task in missing.values()],
            self.limit_s,
        )
        progress = _Stage(self.progress, stage)
        record_each(ended, list(missing), len(by_key), self.records, self.errors, progress)

    def _row(self, setting, arm, perturbation=0) -> dict[str, Any]:
        task = self._task(setting, arm, perturbation)
        return self._row_of(drive.key(task), task)

    def _row_of(self, key, task):
        results = json.loads(self.records[key]) if key in self.records else {}
        return {
            'setting': task.setting.number,
            'arm': task.name,
            'perturbation': task.perturbation,
            **dict(settings.describe(task.setting)),
            'error': self.errors.get(key, ''),
            **results,
        }

    def rows(self, chosen: Sequence[Setting]) -> Iterator[dict[str, Any]]:
        """Yield the row of every drive that has ended, by setting, arm and perturbation."""
        order = {setting.number: place for place, setting in enumerate(chosen)}
        ended = [
            (order[task.setting.number], task.name, task.perturbation, key, task)
            for key, tasks in self.tasks.items()
            if key in self.records or key in self.errors
            for task in tasks.values()
        ]
        for *_, key, task in sorted(ended, key=lambda entry: entry[:3]):
            yield self._row_of(key, task)


class _Stage:
    """Progress of one stage, under its name."""

    def __init__(self, progress: CountProgress, name: str):
        self._progress, self._name = progress, name

    def show(self, _, done, total, note=''):
        self._progress.show(self._name, done, total, note)

    def print_line(self, text):
        self._progress.print_line(f'{self._name}: {text}')


def _product(chosen: Sequence[Iterable[Any]]):
    from itertools import product

    return product(*chosen)


def _chunk_key(plan, seed, first):
    content = [
        plan.digest,
        code_version.digest(BUILD_ROOTS),
        # of the Sobol sequence and of the linear program
        provenance.versions()['scipy'],
        [plant_variants.digest(car) for car in plan.dimensions['car'].ends()],
        [seed, first, CHUNK],
    ]
    return provenance.digest(json.dumps(content))


def _build_chunk(plan: Preregistration, seed: int, first: int) -> str:
    """Return the points of a chunk as JSON; a point that is no setting has the reason alone."""
    points = [_point_of(built) for built in settings.build_range(plan, seed, first, CHUNK)]
    return json.dumps({'points': points})


def _point_of(built):
    if isinstance(built, settings.Rejected):
        return {'number': built.number, 'rejected': built.reason}
    kept = {name: value for name, value in built._asdict().items() if name != 'plant'}
    return kept | {'rejected': None}


def _setting_of(point):
    values = {name: value for name, value in point.items() if name != 'rejected'}
    plant = build(variant_of(point['values']))
    return Setting(**values | {'plant': plant, 'offsets': tuple(point['offsets'])})


def describe(plan: Preregistration, drawn: Drawn, rows: Sequence[Mapping]) -> Iterator[str]:
    """Yield how many settings there are, how many meet each condition, and what the drives cost."""
    reasons = ', '.join(f'{count:,} {reason}' for reason, count in drawn.rejected.items())
    yield f'{len(drawn.settings):,} settings of {drawn.points:,} drawn points ({reasons})'
    judged = [row for row in outcomes.build(plan, rows) if not row.get('perturbation')]
    for baseline in arms.BASELINES:
        own = [row for row in judged if row['baseline'] in ('', baseline)]
        if not any(row['baseline'] for row in own):
            continue
        counts, passed = [], own
        for level in preregistration.LEVELS[1:]:
            passed = [row for row in passed if row[level]]
            counts.append(f'{len(passed):,} up to {level}')
        near = sum(row['P0'] for row in passed)
        yield f'{baseline}: {", ".join(counts)} (P0 apart: {near:,} of the last)'
    known = [row for row in rows if not row['error'] and row.get('cpu_s')]
    if known:
        cpu_s = sum(row['cpu_s'] for row in known)
        failed = len(rows) - len(known)
        yield (
            f'{len(rows):,} drives, {failed:,} failed; {cpu_s / len(known):.2f} s of processor '
            f'time each, {cpu_s / len(drawn.settings):.2f} s per setting'
        )


def _write(plan, rows, drawn, request, is_interrupted):
    import pyarrow
    from pyarrow import parquet

    notes = {
        'preregistration': plan.text,
        'seed': str(request.seed),
        'points': str(drawn.points),
        'screened': str(request.is_screened).lower(),
        'rejected': json.dumps(drawn.rejected),
        'interrupted': str(is_interrupted).lower(),
        'versions': json.dumps(provenance.versions(), sort_keys=True),
        'machine': json.dumps(provenance.machine(), sort_keys=True),
        'git_commit': provenance.commit(),
    }
    files = []
    for name, content in ((TABLE, rows), (OUTCOMES, list(outcomes.build(plan, rows)))):
        path = request.folder / name
        part = path.with_suffix('.part')
        names = dict.fromkeys(name for row in content for name in row)
        columns = {name: [row.get(name) for row in content] for name in names}
        parquet.write_table(pyarrow.table(columns).replace_schema_metadata(notes), part)
        part.replace(path)
        files.append(path)
    return files
