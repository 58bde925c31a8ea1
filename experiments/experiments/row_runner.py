"""Rows driven by a pool: finished ones are kept one by one, and a table is written at the end.

`folder`/drives.jsonl has a line of JSON per finished drive, with its key and its results, so that
an interrupted call goes on: a line that a kill or a full disk tore is noticed, and its drive is
simulated again. `folder`/results.parquet has a row per drive: first the columns that tell it apart,
all settings among them, then `error`, then its results.
"""

import argparse
import fcntl
import importlib.util
import json
import math
import os
import time
from collections.abc import Callable, Mapping, Sequence
from io import BytesIO
from pathlib import Path
from typing import Any

from rich.console import Console

from bags.command_line import print_text
from bags.errors import BagError
from bags.evaluation.metrics import METRICS
from experiments import code_version, drive_row
from experiments.drive_row import Row
from experiments.pool import Pool
from experiments.simulation import Setup
from node_runtime import provenance

FILE = 'drives.jsonl'
KEY, RESULTS = 'key', 'results'
LINES = 10  # of progress where there is no terminal
TABLE = 'results.parquet'
TIMES = ('wall_s', 'cpu_s')  # of a drive
# columns of results in the order of comparison.json, whatever the first drive has
ORDER = {
    name: place for place, name in enumerate((*TIMES, 'friction', 'verdict', *METRICS, 'solver'))
}


class DriveRecords(dict[str, str]):
    """A context: the results of finished drives, as JSON by key, in `folder`/drives.jsonl.

    Entering it raises BagError while another program writes the file.
    """

    def __init__(self, folder: Path):
        self.path = folder / FILE
        self.damaged = 0  # lines of the file that are no records

    def __enter__(self):
        self.path.parent.mkdir(parents=True, exist_ok=True)
        self._file = self.path.open('ab', buffering=0)
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            self._file.close()
            raise BagError(f'{self.path}: another program is writing this file') from None
        end = 0
        for line in BytesIO(self.path.read_bytes()):  # splitlines would split at other ends, too
            if not line.endswith(b'\n'):
                # the next record must begin a line
                self._file.truncate(end)
                self.damaged += 1
                break
            end += len(line)
            try:
                record = json.loads(line)
                self[record[KEY]] = json.dumps(record[RESULTS])
            except (ValueError, KeyError, TypeError):
                self.damaged += 1
        return self

    def __exit__(self, *error):
        self._file.close()

    def add(self, key: str, results: str) -> None:
        """Keep the results of a drive, a JSON object. Raises BagError when the disk is full."""
        line = f'{{"{KEY}": "{key}", "{RESULTS}": {results}}}\n'.encode()
        try:
            reason = '' if self._file.write(line) == len(line) else 'no space left'
        except OSError as error:
            reason = error.strerror
        if reason:
            raise BagError(f'{self.path}: {reason}; the drives before this one are kept')
        self[key] = results

    def finish(
        self,
        pool: Pool,
        function: Callable,
        tasks: Mapping[str, tuple],
        errors: dict[str, str],
        limit_s: float = math.inf,
        noted: type[Exception] = Exception,
        before: int = 0,
    ) -> None:
        """Do the tasks, by key, that have no record, and show how many have ended.

        function  returns the results, a JSON object, which are kept
        errors    by key, of the class `noted`; others are raised
        limit_s   wall time after which a task fails
        before    drives of the command before these; then lines of progress are left out
        """
        missing = [key for key in tasks if key not in self]
        total, show = len(tasks), pool.progress.show
        done, note = total - len(missing), f'{before:,} before' if before else ''
        show('drives', done, total, note)
        for ended in pool.finish_each(function, [tasks[key] for key in missing], limit_s):
            key, error = missing[ended.number], ended.error
            if not error:
                self.add(key, ended.value)
            elif not isinstance(error, noted):
                raise error
            else:
                # those that a person was meant to read have no class
                kind = '' if isinstance(error, BagError) else f'{type(error).__name__}: '
                errors[key] = ' '.join(f'{kind}{error}'.split())
                note = f'{len(errors):,} failed'
            done += 1
            show('drives', done, total, note)
            if not before and done * LINES // total > (done - 1) * LINES // total:
                pool.progress.print_line(' '.join((f'{done:,} of {total:,}', note)).rstrip())


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
        keys, described = [], []
        for row in rows:
            keys.append(drive_row.key(row))
            described.append(row.columns())
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
            (columns, errors.get(key, ''), json.loads(records.get(key, '{}')))
            for key, columns in zip(keys, described)
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
