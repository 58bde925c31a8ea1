"""Finished drives, kept one by one in the folder of a batch, so that an interrupted one continues.

One line of JSON per drive, with its key and its results, written by one system call: a line that a
full disk or a power cut tore is noticed, and its drive is simulated again.
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
        self._file = self.path.open('a+b', buffering=0)
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
        """Keep the results of a drive, a JSON object."""
        self._file.write(f'{{"{KEY}": "{key}", "{RESULTS}": {results}}}\n'.encode())
        self._results[key] = results

    def _read(self):
        self._file.seek(0)
        end = 0
        for line in self._file.read().splitlines(keepends=True):
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
