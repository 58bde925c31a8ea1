"""Finished drives, kept one by one in the folder of a batch, so that an interrupted one continues.

One line of JSON per drive, with its key and its results, written when the drive ends: a line that a
kill or a full disk tore is noticed, and its drive is simulated again.
"""

import fcntl
import json
from pathlib import Path

from bags.errors import BagError

FILE = 'drives.jsonl'
KEY, RESULTS = 'key', 'results'


class DriveRecords:
    """A context: the results of finished drives, as JSON by key, in `folder`/drives.jsonl.

    Entering it raises BagError while another program writes the file.
    """

    def __init__(self, folder: Path):
        self.path = folder / FILE
        self.damaged = 0  # lines of the file that are no records
        self._results: dict[str, str] = {}

    def __enter__(self):
        self.path.parent.mkdir(parents=True, exist_ok=True)
        self._file = self.path.open('ab', buffering=0)
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            self._read()
        except BlockingIOError:
            self._file.close()
            raise BagError(f'{self.path}: another batch is writing this file') from None
        return self

    def __exit__(self, *error):
        self._file.close()

    def __contains__(self, key: str) -> bool:
        return key in self._results

    def __getitem__(self, key: str) -> str:
        return self._results[key]

    def add(self, key: str, results: str) -> None:
        """Keep the results of a drive, a JSON object. Raises BagError when the disk is full."""
        line = f'{{"{KEY}": "{key}", "{RESULTS}": {results}}}\n'.encode()
        try:
            reason = '' if self._file.write(line) == len(line) else 'no space left'
        except OSError as error:
            reason = error.strerror
        if reason:
            raise BagError(f'{self.path}: {reason}; the drives before this one are kept')
        self._results[key] = results

    def _read(self):
        end = 0
        with self.path.open('rb') as file:
            for line in file:
                if not line.endswith(b'\n'):
                    # the next record must begin a line
                    self._file.truncate(end)
                    self.damaged += 1
                    break
                end += len(line)
                try:
                    record = json.loads(line)
                    self._results[record[KEY]] = json.dumps(record[RESULTS])
                except (ValueError, KeyError, TypeError):
                    self.damaged += 1
