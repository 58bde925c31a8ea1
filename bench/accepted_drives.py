"""Drive the accepted settings of the study again, those alone.

    .venv/bin/python bench/accepted_drives.py paper/settings --out DIR [--jobs N] [--code FOLDER]

`paper/settings/RUN/accepted_settings.csv` says which settings these are: of the run's 21,727 drives
3,568 are enough. Writes accepted_drives.parquet, the drives that claims rest on, into DIR/RUN,
beside a copy of the published claims, so that

    experiments study recompute DIR

says what differs from them. Finished drives are kept in DIR/RUN: the same command goes on. Prints
which settings are no longer at P3, and how many drives have equal rows where a table of them is
published.

--code FOLDER drives with the code of another state: a working tree, made by
`git worktree add FOLDER COMMIT`. The published runs are of the commit 3150161a; later ones moved
the controllers' commands by rounding, by which a car at the limit may spin or not.
"""

import argparse
import csv
import json
import os
import shutil
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

FILE, SETTINGS, CLAIMS = 'accepted_drives.parquet', 'accepted_settings.csv', 'claims.json'
RUNS = ('confirmatory', 'repetition')
PACKAGES = (
    *('msgs_yaml', 'node_runtime', 'stage_solver', 'scenario_publisher'),
    *('mpcc_controller', 'vehicle_plant', 'bags', 'experiments'),
)
TIMES = ('wall_s', 'cpu_s')
LIMIT_S = 600.0  # of wall time for one drive


def read_settings(file: Path) -> dict[str, set[int]]:
    """Return the numbers of the settings at P3 by version of the baseline."""
    with file.open(encoding='utf-8', newline='') as lines:
        rows = list(csv.DictReader(lines))
    versions = [name for name in rows[0] if name != 'setting']
    return {name: {int(row['setting']) for row in rows if row[name] == 'True'} for name in versions}


def drive(run: str, numbers: Sequence[int], folder: Path, jobs: int) -> list[dict[str, Any]]:
    """Drive settings of a run of the preregistration; return a row per drive.

    All arms drive the undisturbed start; the others are driven by the MPCC, and by the versions of
    the baseline with which the setting is at P3.
    """
    from experiments.drive_records import DriveRecords
    from experiments.pool import Pool
    from experiments.settings import arms, outcomes, preregistration
    from experiments.settings import drive as drives
    from experiments.settings import setting as settings

    plan = preregistration.load()
    seed = getattr(plan.runs, run).seed
    rows: dict[tuple[int, str, int], dict[str, Any]] = {}
    with DriveRecords(folder) as records, Pool(jobs) as pool:

        def drive_all(tasks):
            keys = [drives.key(task) for task in tasks]
            missing = {key: task for key, task in zip(keys, tasks) if key not in records}
            alone = [(task,) for task in missing.values()]
            errors, done = {}, len(tasks) - len(missing)
            for ended in pool.finish_each(drives.run, alone, LIMIT_S):
                key, done = list(missing)[ended.number], done + 1
                if ended.error:
                    errors[key] = ' '.join(str(ended.error).split())
                else:
                    records.add(key, ended.value)
                if done % 100 == 0:
                    print(f'{run}: {done:,} of {len(tasks):,} drives', flush=True)
            for key, task in zip(keys, tasks):
                results = json.loads(records[key]) if key in records else {}
                named = task.setting.number, task.name, task.perturbation
                rows[named] = {
                    **dict(zip(('setting', 'arm', 'perturbation'), named)),
                    **dict(settings.describe(task.setting)),
                    'error': errors.get(key, ''),
                    **{name: value for name, value in results.items() if name not in TIMES},
                }

        # drawing many points at once takes as long as one
        drawn = settings.draw(plan, seed, 0, max(numbers) + 1)
        chosen = [settings.build(plan, number, drawn[number]) for number in numbers]
        known = (arms.MATCHED, arms.LINEAGE)
        undisturbed = (arms.NO_CA, arms.MPCC, *known)
        drive_all([drives.plan_drive(plan, built, arm) for built in chosen for arm in undisturbed])
        further = []
        for built in chosen:
            own = {(arm, 0): rows[built.number, arm, 0] for arm in undisturbed}
            at_p3 = [arm for arm in known if outcomes.is_accepted(plan, own, (arm,))]
            further += [
                drives.plan_drive(plan, built, arm, start)
                for arm in ([arms.MPCC, *at_p3] if at_p3 else [])
                for start in range(1, len(plan.perturbations))
            ]
        drive_all(further)
    return [rows[named] for named in sorted(rows)]


def notes_of(run: str, claims: dict[str, Any]) -> dict[str, str]:
    """Return the metadata of a table: what the published run says of itself, and this code."""
    from experiments.settings import preregistration
    from node_runtime import provenance

    plan, study = preregistration.load(), claims['provenance']['study']
    return {
        'preregistration': plan.text,
        'seed': str(getattr(plan.runs, run).seed),
        'points': study['points'],
        'screened': 'true',
        'rejected': study['rejected'],
        'interrupted': 'false',
        'versions': json.dumps(provenance.versions(), sort_keys=True),
        'machine': json.dumps(provenance.machine(), sort_keys=True),
        'git_commit': provenance.commit(),
    }


def write(rows: Sequence[dict[str, Any]], notes: dict[str, str], path: Path) -> None:
    """Write a table of drives, as small as it gets."""
    import pyarrow
    from pyarrow import parquet

    names = list(dict.fromkeys(name for row in rows for name in row))
    columns = {name: [row.get(name) for row in rows] for name in names}
    table = pyarrow.table(columns).replace_schema_metadata(notes)
    parquet.write_table(table, path, compression='zstd', compression_level=19)


def compare(rows: Sequence[dict[str, Any]], published: Path) -> Iterator[str]:
    """Yield what the rows have otherwise than those of a published run, in words."""
    from pyarrow import parquet

    from experiments.settings import outcomes, preregistration

    plan = preregistration.load()
    drives = outcomes.group(rows)
    for baseline, then in read_settings(published / SETTINGS).items():
        now = {n for n in drives if outcomes.is_accepted(plan, drives[n], (baseline,))}
        gone, new = (
            ', '.join(map(str, sorted(part))) or 'none' for part in (then - now, now - then)
        )
        yield f'{baseline}: {len(then)} settings at P3, now {len(now)}; gone: {gone}; new: {new}'
    if (published / FILE).is_file():
        before, after = (
            {(row['setting'], row['arm'], row['perturbation']): row for row in table}
            for table in (parquet.read_table(published / FILE).to_pylist(), rows)
        )
        both = before.keys() & after.keys()
        equal = sum(before[named] == after[named] for named in both)
        yield f'{equal:,} of {len(both):,} drives have equal rows'


def main() -> None:
    """Drive both runs; in a process of its own where another state of the code is wanted."""
    parser = argparse.ArgumentParser(description=__doc__.partition('\n')[0])
    parser.add_argument('published', type=Path, metavar='DIR', help='a folder per run')
    parser.add_argument('--out', type=Path, required=True, metavar='DIR')
    parser.add_argument('--jobs', type=int, default=os.cpu_count(), metavar='N')
    parser.add_argument('--code', type=Path, metavar='FOLDER', help='working tree of another state')
    options = parser.parse_args()
    if options.code:
        folders = [str(options.code.absolute() / package) for package in PACKAGES]
        arguments = [str(options.published), '--out', str(options.out), '--jobs', str(options.jobs)]
        environment = os.environ | {'PYTHONPATH': os.pathsep.join(folders)}
        os.execve(sys.executable, [sys.executable, __file__, *arguments], environment)
    for run in RUNS:
        published, folder = options.published / run, options.out / run
        if not (published / SETTINGS).is_file():
            continue
        numbers = sorted(set.union(*read_settings(published / SETTINGS).values()))
        rows = drive(run, numbers, folder, options.jobs)
        claims = json.loads((published / CLAIMS).read_text(encoding='utf-8'))
        for line in compare(rows, published):
            print(f'{run}: {line}')
        write(rows, notes_of(run, claims), folder / FILE)
        shutil.copy(published / CLAIMS, folder)
    pooled = options.out / 'pooled'
    pooled.mkdir(parents=True, exist_ok=True)
    shutil.copy(options.published / 'pooled' / CLAIMS, pooled)


if __name__ == '__main__':
    main()
