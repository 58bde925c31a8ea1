"""Rows driven by a pool: finished ones are kept one by one, and a table is written at the end.

`folder`/drives.jsonl has a line per finished drive, so that an interrupted call goes on, and
`folder`/results.parquet a row per drive: first the columns that tell it apart, all settings among
them, then `error`, then its results.
"""

import argparse
import importlib.util
import json
import os
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from rich.console import Console

from bags.command_line import print_text
from bags.errors import BagError
from bags.evaluation.metrics import METRICS
from experiments import code_version, drive_row
from experiments.drive_records import DriveRecords
from experiments.drive_row import Row
from experiments.pool import Pool
from experiments.simulation import Setup
from node_runtime import provenance

TABLE = 'results.parquet'
TIMES = ('wall_s', 'cpu_s')  # of a drive
# columns of results in the order of comparison.json, whatever the first drive has
ORDER = {
    name: place for place, name in enumerate((*TIMES, 'friction', 'verdict', *METRICS, 'solver'))
}


def driving(options: argparse.Namespace, console: Console) -> Pool:
    """Return the pool of the options --jobs and --dask, which shows its progress."""
    return Pool(options.jobs, options.dask, code_version.describe, console)


def run_rows(
    rows: Sequence[Row],
    folder: Path,
    pool: Pool,
    limit_s: float,
    notes: Mapping[str, str],
    drive: Callable[[Setup], dict[str, Any]] = drive_row.drive,
) -> list[dict[str, Any]]:
    """Drive each row that has no record in `folder` once; return the lines of the table of all.

    A row that raises, ends its process or takes longer than `limit_s` [s] of wall time costs its
    line of the table, which says why; the next call tries it again. `notes` are metadata of the
    table, `drive` is what the processes call. Raises BagError for a row that cannot be prepared,
    without the package that writes tables, or while another program writes the records, and
    KeyboardInterrupt after the table of the rows so far was written.
    """
    begin_s = time.monotonic()
    # before hours of drives, not after
    if importlib.util.find_spec('pyarrow') is None:
        raise BagError(
            f'{TABLE} needs the package pyarrow, which is not installed; pip install pyarrow'
        )
    drive_row.forget_files()
    errors: dict[str, str] = {}  # by key
    interrupted = False
    with DriveRecords(folder) as records:
        if records.damaged:
            text = f'{records.path}: {records.damaged} damaged records are simulated again'
            print_text(pool.progress.console, text)
        keys = []
        for row in rows:
            keys.append(drive_row.key(row))
            pool.progress.show('drawn', len(keys), len(rows))
        kept = sum(key in records for key in keys)
        # what a process prepared for a controller serves its next rows
        ordered = sorted(zip(keys, rows), key=lambda pair: pair[1].formulation)
        tasks = {key: (row, key, drive) for key, row in ordered}
        try:
            records.finish(pool, drive_row.drive_unchanged, tasks, errors, limit_s)
        except KeyboardInterrupt:
            interrupted = True
        ended_rows = [
            (row.columns(), errors.get(key, ''), json.loads(records.get(key, '{}')))
            for key, row in zip(keys, rows)
            if key in records or key in errors
        ]
    lines = _lines(ended_rows)
    table = folder / TABLE
    if lines:
        _write(lines, notes, table)
    failed = sum(bool(line['error']) for line in lines)
    if interrupted:
        raise KeyboardInterrupt(
            f'{len(lines) - failed:,} of {len(rows):,} drives are kept; the same command goes on'
        ) from None
    print_text(
        pool.progress.console,
        f'{len(lines):,} drives: {kept:,} were kept, {failed:,} failed; '
        f'{time.monotonic() - begin_s:.1f} s; {table}',
    )
    return lines


def _lines(ended):
    """Return every row with all columns; what it does not have is None."""
    inputs = dict.fromkeys(name for columns, _, _ in ended for name in columns)
    results = dict.fromkeys(name for _, _, values in ended for name in values)
    ordered = sorted(results, key=lambda name: ORDER.get(name.partition('.')[0], len(ORDER)))
    code = code_version.digest()
    return [
        {name: columns.get(name) for name in inputs}
        | {'error': error, 'code_version': code}
        | dict.fromkeys((*TIMES, 'survived', 'lost_by', 'verdict'))
        | {name: values.get(name) for name in ordered}
        for columns, error, values in ended
    ]


def _write(lines, notes, path):
    """Write the table, whole or not at all."""
    import pyarrow
    from pyarrow import parquet

    table = pyarrow.table({name: [line[name] for line in lines] for name in lines[0]})
    origin = {
        'versions': json.dumps(provenance.versions(), sort_keys=True),
        'machine': json.dumps(provenance.machine(), sort_keys=True),
        'git_commit': provenance.commit(),
    }
    part = path.with_suffix('.part')
    parquet.write_table(table.replace_schema_metadata({**notes, **origin}), part)
    os.replace(part, path)
