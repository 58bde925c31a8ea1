"""Drives the rows of the study that have no record yet, and keeps a line of the table for each."""

import json
from collections.abc import Mapping, Sequence
from typing import Any

from experiments import drive_row
from experiments.decisive import outcome
from experiments.drive_records import DriveRecords
from experiments.drive_row import Row
from experiments.pool import Pool, WorkerError
from experiments.progress import CountProgress

LIMIT_S = 120.0  # of wall time for a drive


class Driver:
    """Drives rows that have no record, and keeps a line of the table for each."""

    def __init__(self, records: DriveRecords, pool: Pool, progress: CountProgress):
        self.records, self.pool, self.progress = records, pool, progress
        self.lines: list[dict[str, Any]] = []

    def drive(self, rows: Sequence[Row], **labels: Any) -> list[Mapping[str, Any]]:
        """Return the outcome of each row.

        That of a drive that takes too long or ends its process is a failure. Raises whatever else a
        drive raises, as BagError for a file that was changed meanwhile.
        """
        keys = [drive_row.key(row) for row in rows]
        missing = {key: row for key, row in zip(keys, rows) if key not in self.records}
        errors: dict[str, str] = {}
        tasks = [(row, key, outcome.measure) for key, row in missing.items()]
        ended = self.pool.finish_each(drive_row.drive_unchanged, tasks, LIMIT_S)
        for done, finished in enumerate(ended, start=len(rows) - len(missing) + 1):
            key = list(missing)[finished.number]
            if finished.error and not isinstance(finished.error, WorkerError):
                raise finished.error
            if finished.error:
                errors[key] = ' '.join(str(finished.error).split())
            else:
                self.records.add(key, finished.value)
            self.progress.show('drives', done, len(rows), f'{len(self.lines):,} before')
        results = []
        for row, key in zip(rows, keys):
            values = json.loads(self.records.get(key, json.dumps(outcome.FAILED)))
            self.lines.append(
                {**labels, **dict(row.labels), **values, 'error': errors.get(key, '')}
            )
            results.append(values)
        return results
