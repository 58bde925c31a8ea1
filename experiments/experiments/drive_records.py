"""Finished drives, kept one by one in a folder, so that an interrupted command continues.

One line of JSON per drive, with its key and its results, written when the drive ends: a line that a
kill or a full disk tore is noticed, and its drive is simulated again.
"""

import fcntl
import json
from collections.abc import Iterator, Sequence
from io import BytesIO
from pathlib import Path

from bags.errors import BagError
from experiments.pool import Finished
from experiments.progress import CountProgress

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


def record_each(
    ended: Iterator[Finished],
    keys: Sequence[str],
    total: int,
    records: DriveRecords,
    errors: dict[str, str],
    progress: CountProgress,
) -> None:
    """Add the results of each drive to the records, or its error to `errors`, by its key.

    `keys` are those of the drives that are yet to end, by their number; `total` counts the recorded
    ones, too.
    """
    done = total - len(keys)
    progress.show('drives', done, total)
    for finished in ended:
        key = keys[finished.number]
        if finished.error:
            # those that a person was meant to read have no class
            known = isinstance(finished.error, BagError)
            kind = '' if known else f'{type(finished.error).__name__}: '
            errors[key] = ' '.join(f'{kind}{finished.error}'.split())
        else:
            records.add(key, finished.value)
        done += 1
        note = f'{len(errors):,} failed' if errors else ''
        progress.show('drives', done, total, note)
        if done * LINES // total > (done - 1) * LINES // total:
            progress.print_line(' '.join((f'{done:,} of {total:,}', note)).rstrip())
