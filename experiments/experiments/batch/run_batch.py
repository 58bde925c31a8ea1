"""`experiments batch`: simulate what is missing of a study, and write its table."""

import json
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from rich.console import Console

from bags.errors import BagError
from experiments.batch import drive_plan, results_table, study_file
from experiments.batch.drive_plan import Combination, Perturbation
from experiments.batch.drive_records import DriveRecords
from experiments.batch.record_drives import record_each
from experiments.batch.simulate import simulate
from experiments.batch.study_file import StudyFile
from experiments.progress import CountProgress, print_text
from experiments.simulation import Setup
from experiments.study import code_version
from experiments.worker_pool import WorkerPool
from node_runtime import provenance

TIMES = ('wall_s', 'cpu_s')  # of a drive


class Request(NamedTuple):
    """The arguments of `experiments batch`."""

    study: Path
    folder: Path  # of the results
    jobs: int
    limit_s: float  # of wall time for one drive


class Plan(NamedTuple):
    """The drives of a study: every perturbation of every combination, in this order."""

    study: StudyFile
    combinations: Sequence[Combination]
    setups: Sequence[Setup]  # of the combinations
    perturbations: Sequence[Perturbation]
    keys: Sequence[Sequence[str]]  # of the drives, by combination and run

    def __repr__(self) -> str:
        return f'Plan({len(self.combinations)} combinations, {len(self.perturbations)} runs)'


def run(
    request: Request, console: Console, simulate_drive: Callable[[Setup], str] = simulate
) -> int:
    """Simulate, write the table and show its summary; return 0 when no drive failed.

    `simulate_drive` is what the workers call. Raises BagError for a study that cannot be used, and
    KeyboardInterrupt after the table of the drives so far was written.
    """
    begin_s = time.monotonic()
    study = study_file.load(request.study)
    errors: dict[str, str] = {}  # by key, of the drives that failed
    with (
        CountProgress(console) as progress,
        DriveRecords(request.folder) as records,
        WorkerPool(request.jobs) as pool,
    ):
        if records.damaged:
            text = f'{records.path}: {records.damaged} damaged records are simulated again'
            print_text(console, text)
        plan = prepare_plan(study, pool, progress)
        kept = sum(key in records for keys in plan.keys for key in keys)
        interrupted = None
        try:
            _simulate_missing(
                plan, records, errors, pool, request.limit_s, progress, simulate_drive
            )
        except KeyboardInterrupt as interrupt:
            interrupted = interrupt
        columns = results_table.build_columns(build_rows(plan, records, errors))
        count = len(columns.get('error', ()))
        failed = sum(map(bool, columns.get('error', ())))
        if count:
            table = results_table.write(columns, _notes(study), request.folder)
    if interrupted:
        raise KeyboardInterrupt(
            f'{count - failed:,} of {study.drives:,} drives are kept; the same command goes on'
        ) from None
    console.print(results_table.summarise(columns))
    print_text(
        console,
        f'{count:,} drives: {kept:,} were kept, {failed:,} failed; '
        f'{time.monotonic() - begin_s:.1f} s; {table}',
    )
    return 1 if failed else 0


def prepare_plan(study: StudyFile, pool: WorkerPool, progress: CountProgress) -> Plan:
    """Check every combination of a study and return its drives. Raises BagError."""
    combinations = drive_plan.combine(study)
    setups: list[Any] = [None] * len(combinations)
    shared: dict[str, Any] = {}
    tasks = [(combination,) for combination in combinations]
    for done, finished in enumerate(pool.finish_each(drive_plan.prepare, tasks), start=1):
        if isinstance(finished.error, BagError):
            combination = combinations[finished.number]
            raise drive_plan.locate_error(study, combination, finished.error)
        if finished.error:
            raise finished.error
        setups[finished.number] = _share_parts(finished.value, shared)
        progress.show('checked', done, len(tasks))
    _refuse_equal_names(study, combinations, setups)
    perturbations = drive_plan.draw_perturbations(study.runs, study.seed)
    keys = [drive_plan.drive_keys(setup, perturbations) for setup in setups]
    return Plan(study, combinations, setups, perturbations, keys)


def _share_parts(setup, shared):
    """Return a setup whose equal parts are those of earlier setups: a grid may have thousands."""
    return setup._replace(
        scn=shared.setdefault(setup.scn.text, setup.scn),
        **{
            name: shared.setdefault(repr(getattr(setup, name)), getattr(setup, name))
            for name in ('params', 'vehicle', 'plant')
        },
    )


def _refuse_equal_names(study, combinations, setups):
    """Refuse two scenario files of one name: their rows could not be told apart."""
    files: dict[str, str] = {}
    for combination, setup in zip(combinations, setups):
        other = files.setdefault(setup.scn.name, combination.scenario)
        if other != combination.scenario:
            raise BagError(
                f'{study.path}: scenarios: {other} and {combination.scenario} have one name, '
                f'{setup.scn.name!r}; give one of them another'
            )


def _simulate_missing(plan, records, errors, pool, limit_s, progress, simulate_drive):
    """Simulate each drive without a record once, also where it is in several rows."""
    missing: dict[str, tuple[int, int]] = {}
    done = 0
    for number, keys in enumerate(plan.keys):
        for run, key in enumerate(keys):
            done += key in records
            if key not in records:
                missing.setdefault(key, (number, run))
    tasks = _Setups(plan, list(missing.values()))
    groups = [plan.combinations[number].formulation for number, _ in tasks.chosen]
    ended = pool.finish_each(simulate_drive, tasks, groups, limit_s)
    record_each(ended, list(missing), done + len(missing), records, errors, progress)


class _Setups(Sequence):
    """The arguments of each task, made when the task begins."""

    def __init__(self, plan, chosen):
        self.plan, self.chosen = plan, chosen

    def __len__(self):
        return len(self.chosen)

    def __getitem__(self, number):
        combination, run = self.chosen[number]
        setup = self.plan.setups[combination]
        return (drive_plan.perturb(setup, self.plan.perturbations[run]),)


def build_rows(
    plan: Plan, records: DriveRecords, errors: dict[str, str]
) -> Iterator[dict[str, Any]]:
    """Yield the row of every drive that has ended, in the order of the plan."""
    for combination, setup, keys in zip(plan.combinations, plan.setups, plan.keys):
        for run, (perturbation, key) in enumerate(zip(plan.perturbations, keys), start=1):
            if key not in records and key not in errors:
                continue
            results = json.loads(records[key]) if key in records else {}
            yield {
                'scenario': setup.scn.name,
                'controller': setup.controller,
                **dict(combination.settings),
                'run': run,
                'seed': plan.study.seed,
                **{f'perturbation.{name}': value for name, value in perturbation._asdict().items()},
                'error': errors.get(key, ''),
                'code_version': code_version.digest(),
                **{name: results.pop(name, None) for name in TIMES},
                **results,
            }


def _notes(study):
    """Return what the table says about its origin."""
    return {
        'study': study.text,
        'versions': json.dumps(provenance.versions(), sort_keys=True),
        'machine': json.dumps(provenance.machine(), sort_keys=True),
        'git_commit': provenance.commit(),
    }
