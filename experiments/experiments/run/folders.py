"""Where a run is recorded, and where it ends up: an older run stays until the new one is whole."""

import fcntl
import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from bags.errors import BagError

LOGS = 'logs'
REPLACED = 'replaced'
MARK = '.bags_workshop'  # in a folder that `recover` may clear


@contextmanager
def created(folder: Path, option: str) -> Iterator[None]:
    """Create a folder and its parents; at the end remove those of them that are still empty.

    Raises BagError when it cannot be created or written to; the message begins with `option`, which
    is what the user gave.
    """
    # not Path.exists, which raises below a folder that may not be entered
    made = [path for path in (folder, *folder.parents) if not os.path.exists(path)]
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        _remove_empty(made)
        raise BagError(
            f'{option}: cannot create the folder {folder}: {_reason(folder, error)}'
        ) from None
    try:
        if not os.access(folder, os.W_OK | os.X_OK):
            raise BagError(f'{option}: no permission to write to the folder {folder}')
        yield
    finally:
        _remove_empty(made)


def _reason(folder, error):
    for path in (folder, *folder.parents):
        if os.path.lexists(path):
            return error.strerror if os.path.isdir(path) else f'{path} is not a folder'
    return error.strerror


def _remove_empty(folders):
    """Remove folders, the innermost first, as far as nothing is in them."""
    with suppress(OSError):
        for folder in folders:
            folder.rmdir()


class Workshop:
    """A hidden folder beside the final place, so that moving is one rename.

    It is locked while this program lives; `recover` cares for those whose program was killed.

    bag     folder that the recorder makes
    logs    what the nodes said, and the parameters they were given
    """

    def __init__(self, scenario_folder: Path, name: str):
        scenario_folder.mkdir(parents=True, exist_ok=True)
        self.final = scenario_folder / name
        self.failed = scenario_folder / f'{name}.failed'
        self.interrupted = scenario_folder / f'{name}.interrupted'
        self.root = Path(tempfile.mkdtemp(prefix=f'.{name}.', dir=scenario_folder))
        self._lock = _lock(self.root)
        self.bag = self.root / name
        self.logs = self.root / LOGS
        try:
            (self.root / MARK).touch()
            self.logs.mkdir()
        except OSError:
            self.discard()
            raise

    @property
    def is_closed(self) -> bool:
        """Tell whether the recorder completed the bag."""
        return _is_closed(self.bag)

    def keep(self) -> Path:
        """Put the bag with its logs in the final place; return it."""
        return self._keep(self.final)

    def keep_interrupted(self) -> Path | None:
        """Put the recording so far beside the final place; return where it is.

        A complete bag goes to `<name>.interrupted`, one that was not closed to `<name>.failed`.
        Returns None when nothing was recorded; then nothing is kept.
        """
        if self.is_closed:
            return self._keep(self.interrupted)
        if _has_recording(self.bag):
            return self.set_aside() / self.bag.name
        self.discard()
        return None

    def set_aside(self) -> Path:
        """Put everything in `<name>.failed`, for a look at what went wrong; return that folder."""
        return self._replace(self.failed, self.root)

    def describe_recording(self) -> str:
        """Return one line about the recording so far: where it is, and what it lacks."""
        if self.is_closed:
            return f'recorded until then: {self.bag}'
        if _has_recording(self.bag):
            return f'recorded until then, not closed: `bags repair {self.bag}` completes it'
        return 'nothing was recorded'

    def after_set_aside(self, text: str) -> str:
        """Return a text with the paths in this workshop as they are after `set_aside`."""
        return text.replace(str(self.root), str(self.failed))

    def _keep(self, place):
        self.logs.rename(self.bag / LOGS)
        try:
            return self._replace(place, self.bag)
        except OSError:
            with suppress(OSError):
                (self.bag / LOGS).rename(self.logs)
            raise

    def _replace(self, place, new):
        """Put a folder in a place; on an OSError everything is where it was."""
        # a kill between the two renames leaves the old one where `recover` finds it
        old = self.root / REPLACED / place.name
        if place.exists():
            old.parent.mkdir(exist_ok=True)
            place.rename(old)
        try:
            new.rename(place)
        except OSError:
            if old.exists():
                old.rename(place)
            raise
        shutil.rmtree(place / REPLACED, ignore_errors=True)
        (place / MARK).unlink(missing_ok=True)
        self.discard()
        return place

    def discard(self):
        """Remove what was not kept."""
        shutil.rmtree(self.root, ignore_errors=True)
        if self._lock is not None:
            os.close(self._lock)
            self._lock = None


def recover(scenario_folder: Path) -> list[str]:
    """Clear up after runs that were killed; return a line about each that left something.

    What they were about to replace is put back. Runs in progress are left alone, and so is every
    folder that no Workshop made.
    """
    said = []
    for root in sorted(mark.parent for mark in scenario_folder.glob(f'.*.*/{MARK}')):
        lock = _lock(root)
        if lock is not None:
            said += _cleared(root)
            os.close(lock)
    return said


def _cleared(root):
    for old in root.glob(f'{REPLACED}/*'):
        place = root.parent / old.name
        if not place.exists():
            old.rename(place)
            yield f'{place}: put back; a run was killed while it was replaced'
    name = root.name[1:].rpartition('.')[0]
    if (root / name).exists() or (root / LOGS).exists():
        yield _left(root, name)
    else:
        shutil.rmtree(root)


def _left(root, name):
    bag = root / name
    told = f'a run of {name} was killed and left {root}'
    if _is_closed(bag):
        return f'{told}: its bag {bag} is whole; move it where you want it, or delete the folder'
    if _has_recording(bag):
        return f'{told}: `bags repair {bag}` makes a complete bag of it; or delete the folder'
    return f'{told}: it holds no bag, only what the nodes said; delete it'


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
