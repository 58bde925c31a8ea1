"""The file that keeps the trials of a search: an optuna journal, for one program at a time."""

import fcntl
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import optuna
from optuna.storages import BaseStorage, JournalStorage
from optuna.storages.journal import JournalFileBackend

from bags.errors import BagError


@contextmanager
def open_journal(path: Path, verbosity: int = optuna.logging.WARNING) -> Iterator[BaseStorage]:
    """Yield the storage of a file, which is created with its folder and locked meanwhile.

    `verbosity` is what optuna logs. Raises BagError when another program has it open.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    optuna.logging.set_verbosity(verbosity)
    with path.open('ab') as lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise BagError(f'{path}: another search is writing this file') from None
        yield JournalStorage(JournalFileBackend(str(path)))
