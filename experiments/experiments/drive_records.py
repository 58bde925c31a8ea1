"""Finished drives, kept one by one in a folder, so that an interrupted command continues.

One line of JSON per drive, with its key and its results, written when the drive ends: a line that a
kill or a full disk tore is noticed, and its drive is simulated again.
"""

import fcntl
import json
import math
from collections.abc import Callable, Mapping
from io import BytesIO
from pathlib import Path

from bags.errors import BagError
from experiments.pool import Pool

FILE = 'drives.jsonl'
KEY, RESULTS = 'key', 'results'
LINES = 10  # of progress where there is no terminal


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
