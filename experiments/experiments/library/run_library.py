"""`experiments library`: drive draws or entries, keep finished drives, write and show the table."""

import json
import time
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from rich.console import Console

from bags.command_line import print_text
from experiments import code_version, pass_criteria
from experiments.batch import results_table
from experiments.batch.drive_records import DriveRecords, record_each
from experiments.cluster_pool import open_pool
from experiments.configuration import node_config, set_option
from experiments.library import library_drive, survival_table
from experiments.library.library_drive import ENTRIES, LibraryDrive
from experiments.progress import CountProgress
from node_runtime import provenance
from scenario_publisher import scenario

TIMES = ('wall_s', 'cpu_s')  # of a drive
SHOWN_LOSSES = 200


class Request(NamedTuple):
    """The arguments of `experiments library` when it drives."""

    families: Sequence[str]  # empty with `entries`
    entries: Sequence[str]
    draws: int  # per family
    first: int  # index of the first draw
    seed: int
    difficulty: str
    controllers: Sequence[str]
    settings: Sequence[str]  # of --set
    folder: Path  # of the results
    jobs: int
    limit_s: float  # of wall time for one drive
    at_least: float | None  # share that each family has to survive
    dask: str = ''  # address of a scheduler, whose workers drive in place of `jobs` processes


def run(request: Request, console: Console) -> int:
    """Drive what is missing, write the table and show it; return 0 when all is well.

    1 when a drive has no result, an expectation of an entry is not met, or a family survived less
    than `at_least`. Raises BagError for unusable input, and KeyboardInterrupt after the table of
    the drives so far was written.
    """
    begin_s = time.monotonic()
    results_table.check_format()
    drives = list(plan_drives(request))
    for name in request.entries:
        pass_criteria.check_names(scenario.load(name).expect, name)
    errors: dict[str, str] = {}  # by key, of the drives that failed
    with (
        CountProgress(console) as progress,
        DriveRecords(request.folder) as records,
        open_pool(request.jobs, request.dask, code_version.describe) as pool,
    ):
        if drives:
            # in this process: an error in a setting is reported before anything is driven
            library_drive.prepare(drives[0])
        keys = _keys(drives, progress)
        kept = sum(key in records for key in keys)
        interrupted = None
        try:
            _drive_missing(drives, keys, records, errors, pool, request.limit_s, progress)
        except KeyboardInterrupt as interrupt:
            interrupted = interrupt
        rows = list(build_rows(drives, keys, records, errors))
        table = None
        if rows:
            columns = results_table.build_columns(rows)
            table = results_table.write(columns, _notes(request), request.folder)
    if interrupted:
        raise KeyboardInterrupt(
            f'{len(rows) - len(errors):,} of {len(drives):,} drives are kept; '
            'the same command goes on'
        ) from None
    is_well = _show(request, rows, console)
    print_text(
        console,
        f'{len(rows):,} drives: {kept:,} were kept, {len(errors):,} failed; '
        f'{time.monotonic() - begin_s:.1f} s; {table}',
    )
    return 0 if is_well and not errors else 1


def plan_drives(request: Request) -> Iterator[LibraryDrive]:
    """Yield every drive, family by family, draw by draw, controller by controller."""
    controllers = node_config.find_controllers(request.controllers)
    overrides = set_option.parse_overrides(request.settings)
    settings = tuple(
        (role, name, tuple(value) if isinstance(value, list) else value)
        for role, values in overrides.items()
        for name, value in values.items()
    )
    named = [(ENTRIES, name, 0, 0, '') for name in request.entries]
    indices = range(request.first, request.first + request.draws)
    drawn = [
        (family, '', request.seed, index, request.difficulty)
        for family in request.families
        for index in indices
    ]
    for what in (*named, *drawn):
        for controller in controllers:
            yield LibraryDrive(*what, controller.name_or_path, settings)


def _keys(drives, progress):
    keys = []
    for done, drive in enumerate(drives, start=1):
        keys.append(library_drive.key(drive))
        progress.show('drawn', done, len(drives))
    return keys


def _drive_missing(drives, keys, records, errors, pool, limit_s, progress):
    missing = {key: drive for key, drive in zip(keys, drives) if key not in records}
    tasks = [(drive, key) for key, drive in missing.items()]
    groups = [drive.controller for drive in missing.values()]
    ended = pool.finish_each(library_drive.run, tasks, groups, limit_s)
    record_each(ended, list(missing), len(drives), records, errors, progress)


def build_rows(
    drives: Sequence[LibraryDrive],
    keys: Sequence[str],
    records: DriveRecords,
    errors: Mapping[str, str],
) -> Iterator[dict[str, Any]]:
    """Yield the row of every drive that has ended, in the order of the plan."""
    for drive, key in zip(drives, keys):
        if key not in records and key not in errors:
            continue
        results = json.loads(records[key]) if key in records else {}
        yield {
            'drive': str(drive),
            'family': drive.family,
            'difficulty': drive.difficulty,
            'seed': drive.seed,
            'index': drive.index,
            'controller': drive.controller_name,
            'settings': library_drive.settings_text(drive.settings),
            'friction': library_drive.load_scenario(drive).friction,
            'error': errors.get(key, ''),
            'code_version': code_version.digest(),
            **{name: results.pop(name, None) for name in TIMES},
            'survived': None,
            'lost_by': None,
            'verdict': '',
            **results,
        }


def _show(request, rows, console):
    """Show what came out; return whether every requirement is met."""
    console.print(survival_table.build_table(rows))
    losses = list(survival_table.describe_losses(rows))
    for line in losses[:SHOWN_LOSSES]:
        print_text(console, line)
    if len(losses) > SHOWN_LOSSES:
        print_text(console, f'and {len(losses) - SHOWN_LOSSES:,} more, see the table')
    unmet = _check_entries(rows, console) if request.entries else 0
    below = []
    if request.at_least is not None:
        below = survival_table.families_below(rows, request.at_least)
        for line in below:
            print_text(console, f'less than {request.at_least:.1%} survived: {line}')
    return not unmet and not below


def _check_entries(rows, console):
    """Show what the entries expect and return how many expectations are not met."""
    outcomes = [
        (f'{row["drive"]} {row["controller"]}', outcome)
        for row in rows
        if row['family'] == ENTRIES
        for outcome in pass_criteria.judge(scenario.load(row['drive']).expect, row)
    ]
    unmet = [pair for pair in outcomes if not pair[1].is_met]
    if unmet:
        console.print(pass_criteria.build_table(unmet))
    print_text(console, f'{len(outcomes) - len(unmet)} of {len(outcomes)} expectations are met')
    return len(unmet)


def _notes(request):
    """Return what the table says about its origin."""
    return {
        'library': json.dumps(request._asdict(), default=str),
        'versions': json.dumps(provenance.versions(), sort_keys=True),
        'machine': json.dumps(provenance.machine(), sort_keys=True),
        'git_commit': provenance.commit(),
    }
