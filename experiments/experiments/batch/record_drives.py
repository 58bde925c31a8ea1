"""Drives that end are recorded, or their error is noted, with progress on the console."""

from collections.abc import Iterator, Sequence

from bags.errors import BagError
from experiments.batch.drive_records import DriveRecords
from experiments.progress import CountProgress
from experiments.worker_pool import Finished

LINES = 10  # of progress where there is no terminal


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
            errors[key] = _describe(finished.error)
        else:
            records.add(key, finished.value)
        done += 1
        note = f'{len(errors):,} failed' if errors else ''
        progress.show('drives', done, total, note)
        if done * LINES // total > (done - 1) * LINES // total:
            progress.print_line(' '.join((f'{done:,} of {total:,}', note)).rstrip())


def _describe(error):
    """Return an error as one line; those that a person was meant to read have no class."""
    text = str(error) if isinstance(error, BagError) else f'{type(error).__name__}: {error}'
    return ' '.join(text.split())
