"""Staging of a run: recorded in a hidden folder, moved to its final one when it is complete."""

import fcntl
import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from itertools import count
from pathlib import Path

from bags.errors import BagError
from node_runtime.provenance import LABEL_SIGN

LOGS = 'logs'
REPLACED = 'replaced'  # bags on their way out
OLDER = 'older'  # bags on their way to a number
MARKER_FILE = '.bags_workshop'  # in a folder that `recover` may remove


@contextmanager
def created_folder(folder: Path, option: str) -> Iterator[None]:
    """Create a folder and its parents for a `with` block; afterwards remove the empty ones.

    Raises BagError when it cannot be created or written to; the message begins with `option`, the
    argument of the user.
    """
    # not Path.exists, which raises below a folder that may not be entered
    created = [path for path in (folder, *folder.parents) if not os.path.exists(path)]
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        _remove_empty(created)
        there = next(path for path in (folder, *folder.parents) if os.path.lexists(path))
        reason = error.strerror if os.path.isdir(there) else f'{there} is not a folder'
        raise BagError(f'{option}: cannot create the folder {folder}: {reason}') from None
    try:
        if not os.access(folder, os.W_OK | os.X_OK):
            raise BagError(f'{option}: no permission to write to the folder {folder}')
        yield
    finally:
        _remove_empty(created)


def _remove_empty(folders):
    """Remove folders, the innermost first, up to the first that is not empty."""
    with suppress(OSError):
        for folder in folders:
            folder.rmdir()


class StagingDirectory:
    """A hidden folder beside the final one, so that moving is one rename.

    It is locked while this program runs; `recover` clears those of killed programs.

    bag     folder that the recorder creates
    logs    logs and parameter files of the nodes
    """

    def __init__(self, scenario_folder: Path, name: str):
        scenario_folder.mkdir(parents=True, exist_ok=True)
        self.final = scenario_folder / name
        self.failed = scenario_folder / f'{name}.failed'
        self.interrupted = scenario_folder / f'{name}.interrupted'
        self.root = Path(tempfile.mkdtemp(prefix=f'.{name}.', dir=scenario_folder))
        self._lock = _lock(self.root)
        self.bag = self.root / name
        self.keeps_older = True  # whether `keep` leaves the older bag under a number
        self.older: Path | None = None  # where it did
        self.has_replaced = False  # whether `keep` removed it
        self.logs = self.root / LOGS
        try:
            (self.root / MARKER_FILE).touch()
            self.logs.mkdir()
        except OSError:
            self.discard()
            raise

    @property
    def is_closed(self) -> bool:
        """Whether the recorder completed the bag."""
        return _is_closed(self.bag)

    def keep(self) -> Path:
        """Move the bag with its logs to its final folder; return that.

        An older bag there gets the next number, as `mpcc@1`, or is removed (`keeps_older`).
        """
        return self._keep(self.final, OLDER if self.keeps_older else REPLACED)

    def keep_interrupted(self) -> Path | None:
        """Move an interrupted recording beside the final folder; return its path.

        A complete bag goes to `<name>.interrupted`, one that was not closed to `<name>.failed`.
        Without a recording nothing is kept, and None returned.
        """
        if self.is_closed:
            return self._keep(self.interrupted, REPLACED)
        if _has_recording(self.bag):
            return self.keep_failed() / self.bag.name
        self.discard()
        return None

    def keep_failed(self) -> Path:
        """Move everything to `<name>.failed`, for inspection; return that folder."""
        return self._replace(self.failed, self.root, REPLACED)

    def describe_recording(self) -> str:
        """Return one line about the recording: its path, and whether it is complete."""
        if self.is_closed:
            return f'recorded until then: {self.bag}'
        if _has_recording(self.bag):
            return f'recorded until then, not closed: `bags repair {self.bag}` completes it'
        return 'nothing was recorded'

    def _keep(self, target, aside):
        self.logs.rename(self.bag / LOGS)
        try:
            return self._replace(target, self.bag, aside)
        except OSError:
            with suppress(OSError):
                (self.bag / LOGS).rename(self.logs)
            raise

    def _replace(self, target, new, aside):
        """Move a folder to `target`, replacing it; an OSError leaves everything unchanged.

        What was there goes to the folder `aside` of this one, and from OLDER on to its number.
        """
        # after a kill between the renames `recover` finds the old one
        old = self.root / aside / target.name
        if target.exists():
            old.parent.mkdir(exist_ok=True)
            target.rename(old)
        try:
            new.rename(target)
        except OSError:
            if old.exists():
                old.rename(target)
            raise
        if aside == OLDER and old.exists():
            self.older = _number(old, target)
        self.has_replaced = aside == REPLACED and old.exists()
        shutil.rmtree(target / REPLACED, ignore_errors=True)
        (target / MARKER_FILE).unlink(missing_ok=True)
        self.discard()
        return target

    def discard(self) -> None:
        """Remove the folder and release its lock."""
        shutil.rmtree(self.root, ignore_errors=True)
        if self._lock is not None:
            os.close(self._lock)
            self._lock = None


def recover(scenario_folder: Path) -> list[str]:
    """Clear up after killed runs; return a line about each that left something.

    Bags that they were replacing are restored. Runs in progress and folders that no
    StagingDirectory created are left alone.
    """
    lines = []
    for root in sorted(marker.parent for marker in scenario_folder.glob(f'.*.*/{MARKER_FILE}')):
        lock = _lock(root)
        if lock is not None:
            lines += _clear(root)
            os.close(lock)
    return lines


def _clear(root):
    for old in (*root.glob(f'{REPLACED}/*'), *root.glob(f'{OLDER}/*')):
        target = root.parent / old.name
        if not target.exists():
            old.rename(target)
            yield f'{target}: put back; a run was killed while it was replaced'
        elif old.parent.name == OLDER:
            yield f'{_number(old, target)}: an older run, kept; the run that replaced it was killed'
    name = root.name[1:].rpartition('.')[0]
    if (root / name).exists() or (root / LOGS).exists():
        yield _describe_remains(root, name)
    else:
        shutil.rmtree(root)


def _number(old, target):
    """Move an older bag beside the newer one `target` under the first free number; return it."""
    taken = {path.name for path in target.parent.iterdir()}
    names = (f'{target.name}{LABEL_SIGN}{number}' for number in count(1))
    return old.rename(target.with_name(next(name for name in names if name not in taken)))


def _describe_remains(root, name):
    bag = root / name
    remains = f'a run of {name} was killed and left {root}'
    if _is_closed(bag):
        return f'{remains}: its bag {bag} is whole; move it where you want it, or delete the folder'
    if _has_recording(bag):
        return f'{remains}: `bags repair {bag}` makes a complete bag of it; or delete the folder'
    return f'{remains}: it holds no bag, only the logs of the nodes; delete it'


def _is_closed(bag):
    return (bag / 'metadata.yaml').is_file()


def _has_recording(bag):
    return any(bag.glob('*.mcap'))


def _lock(folder):
    """Return the descriptor of a locked folder, None when another program holds it."""
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        os.close(descriptor)
        return None
    return descriptor
