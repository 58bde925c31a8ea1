"""`experiments batch`: simulate what is missing of a study, and write its table."""

import json
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from rich.console import Console

from bags.errors import BagError
from experiments import code_version
from experiments.batch import drive_plan, results_table, study_file
from experiments.batch.drive_plan import (
    NOT_DRAWN,
    Combination,
    Draw,
    Drive,
    Family,
    Pairs,
    Perturbation,
)
from experiments.batch.drive_records import DriveRecords, record_each
from experiments.batch.simulate import simulate
from experiments.batch.study_file import StudyFile
from experiments.cluster_pool import open_pool
from experiments.progress import CountProgress, print_text
from experiments.simulation import Setup
from experiments.worker_pool import TaskPool
from node_runtime import provenance

TIMES = ('wall_s', 'cpu_s')  # of a drive


class Request(NamedTuple):
    """The arguments of `experiments batch`."""

    study: Path
    folder: Path  # of the results
    jobs: int
    limit_s: float  # of wall time for one drive
    dask: str = ''  # address of a scheduler, whose workers drive in place of `jobs` processes


class Plan(NamedTuple):
    """The drives of a study: every run of every draw of every combination, in this order."""

    study: StudyFile
    combinations: Sequence[Combination]
    names: Sequence[tuple[str, str]]  # scenario, '' of a family, and controller of combinations
    draws: Sequence[Draw]
    perturbations: Sequence[Perturbation]
    keys: Sequence[str]  # of the drives
    bases: Mapping[tuple[Combination, Pairs], str]  # `base_key` by combination and drawn words

    def __repr__(self) -> str:
        return f'Plan({len(self.combinations)} combinations, {len(self.keys)} drives)'

    def drives(self) -> Iterator[Drive]:
        """Yield every drive."""
        for combination in self.combinations:
            for draw in drive_plan.draws_of(combination, self.draws):
                for perturbation in self.perturbations:
                    yield Drive(combination, draw, perturbation)


def run(
    request: Request, console: Console, simulate_drive: Callable[[Setup], str] = simulate
) -> int:
    """Simulate, write the table and show its summary; return 0 when no drive failed.

    `simulate_drive` is what the workers call. Raises BagError for a study that cannot be used, and
    KeyboardInterrupt after the table of the drives so far was written.
    """
    begin_s = time.monotonic()
    results_table.check_format()
    study = study_file.load(request.study)
    errors: dict[str, str] = {}  # by key, of the drives that failed
    with (
        CountProgress(console) as progress,
        DriveRecords(request.folder) as records,
        open_pool(request.jobs, request.dask, code_version.describe) as pool,
    ):
        if records.damaged:
            text = f'{records.path}: {records.damaged} damaged records are simulated again'
            print_text(console, text)
        plan = prepare_plan(study, pool, progress)
        kept = sum(key in records for key in plan.keys)
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


def prepare_plan(study: StudyFile, pool: TaskPool, progress: CountProgress) -> Plan:
    """Check every combination of a study and return its drives. Raises BagError."""
    combinations, draws = drive_plan.combine(study), drive_plan.sample_draws(study)
    words = list(dict.fromkeys(draw.words for draw in draws)) if study.drawn else [()]
    tasks = [(combination, some) for combination in combinations for some in words]
    checked: dict[tuple[Combination, Pairs], Any] = {}
    for done, finished in enumerate(pool.finish_each(_check, tasks), start=1):
        combination, some = tasks[finished.number]
        if isinstance(finished.error, BagError):
            located = drive_plan.locate_error(study, combination, finished.error)
            drive_plan.check_drawn(study, [combination])  # a word may be the cause
            raise located
        if finished.error:
            raise finished.error
        checked[combination, some] = finished.value
        progress.show('checked', done, len(tasks))
    drive_plan.check_drawn(study, combinations)
    for line in dict.fromkeys(checked[task][-1] for task in tasks if checked[task][-1]):
        progress.print_line(f'warning: {line}')
    names = [checked[combination, words[0]][:2] for combination in combinations]
    _refuse_equal_names(study, combinations, names)
    perturbations = drive_plan.draw_perturbations(study.runs, study.seed)
    bases = {pair: base for pair, (_, _, base, _) in checked.items()}
    plan = Plan(study, combinations, names, draws, perturbations, [], bases)
    keys = [
        drive_plan.drive_key(bases[drive.combination, drive.draw.words], drive)
        for drive in plan.drives()
    ]
    return plan._replace(keys=keys)


def _check(combination, words):
    """Return scenario, controller, key and `describe_misfit` of a combination, in a worker."""
    setup = drive_plan.prepare_any(combination, words)
    name = '' if isinstance(combination.scenario, Family) else setup.scn.name
    base = drive_plan.base_key(combination, words)
    return name, setup.controller, base, drive_plan.describe_misfit(combination, words)


def _refuse_equal_names(study, combinations, names):
    """Refuse two scenario files of one name: their rows would have the same name."""
    files: dict[str, str] = {}
    for combination, (name, _) in zip(combinations, names):
        other = files.setdefault(name, combination.scenario) if name else combination.scenario
        if other != combination.scenario:
            raise BagError(
                f'{study.path}: scenarios: {other} and {combination.scenario} have one name, '
                f'{name!r}; give one of them another'
            )


def _simulate_missing(plan, records, errors, pool, limit_s, progress, simulate_drive):
    """Simulate each drive without a record once, also where it is in several rows."""
    missing: dict[str, Drive] = {}
    done = 0
    for key, drive in zip(plan.keys, plan.drives()):
        done += key in records
        if key not in records:
            missing.setdefault(key, drive)
    tasks = [
        (simulate_drive, drive, plan.bases[drive.combination, drive.draw.words])
        for drive in missing.values()
    ]
    groups = [drive.formulation for drive in missing.values()]
    ended = pool.finish_each(_drive, tasks, groups, limit_s)
    record_each(ended, list(missing), done + len(missing), records, errors, progress)


def _drive(simulate_drive, drive, base):
    """Return the results of a drive, in a worker."""
    return simulate_drive(drive_plan.prepare_unchanged(drive, base))


def build_rows(
    plan: Plan, records: DriveRecords, errors: dict[str, str]
) -> Iterator[dict[str, Any]]:
    """Yield the row of every drive that has ended, in the order of the plan."""
    names = dict(zip(plan.combinations, plan.names))
    runs = {perturbation: run for run, perturbation in enumerate(plan.perturbations, start=1)}
    for key, drive in zip(plan.keys, plan.drives()):
        if key not in records and key not in errors:
            continue
        results = json.loads(records[key]) if key in records else {}
        road, draw = drive.combination.scenario, drive.draw
        scenario, controller = names[drive.combination]
        is_family = isinstance(road, Family)
        yield {
            'scenario': road.scenario_name(draw.number) if is_family else scenario,
            'controller': controller,
            **({'family': str(road) if is_family else None} if plan.study.families else {}),
            **_draw_columns(plan, draw),
            **dict(drive.combination.settings),
            **dict(draw.values),
            'run': runs[drive.perturbation],
            'seed': plan.study.seed,
            **{
                f'perturbation.{name}': value
                for name, value in drive.perturbation._asdict().items()
            },
            'error': errors.get(key, ''),
            'code_version': code_version.digest(),
            **{name: results.pop(name, None) for name in TIMES},
            **results,
        }


def _draw_columns(plan, draw):
    """Return the number of the draw where the study has draws, None in rows without."""
    if not (plan.study.drawn or plan.study.families):
        return {}
    return {'draw': None if draw is NOT_DRAWN else draw.number}


def _notes(study):
    """Return what the table says about its origin."""
    return {
        'study': study.text,
        'versions': json.dumps(provenance.versions(), sort_keys=True),
        'machine': json.dumps(provenance.machine(), sort_keys=True),
        'git_commit': provenance.commit(),
    }
