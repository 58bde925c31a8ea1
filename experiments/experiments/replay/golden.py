"""Golden recordings: small bags whose answers every later controller must give again.

They hold what a replay reads, message by message as it was recorded: states and actuators of the
ticks, path and edges once, obstacles, and every answer. They are complete bags all the same.
"""

import json
import os
import shutil
import tempfile
from collections.abc import Sequence
from pathlib import Path

from rich.console import Console

from bags.errors import BagError
from bags.storage import read
from bags.storage.bag_writer import BagWriter
from experiments.replay import feed
from experiments.run import batch

LARGEST_BYTES = 2_000_000
TIME_LIMIT_S = 300.0
# of the notes, what says how the numbers came about and nothing of where they were made
ROLES = ('controller', 'plant')
MACHINE = ('processor', 'architecture', 'libc')


def refresh(scenario: str, controllers: Sequence[str], out: Path, console: Console) -> int:
    """Drive, record over the node graph in lockstep, and replace the golden bags in `out`.

    Returns 0 when every run completed; otherwise nothing is replaced. Raises BagError.
    """
    out.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix='.golden.', dir=out) as folder:
        work = Path(folder)
        plan = batch.Batch(scenario, controllers, 'lockstep', work, (), TIME_LIMIT_S)
        code = batch.run_and_compare(plan, console)
        if code:
            return code
        for bag in sorted(work.glob('*/*/metadata.yaml')):
            made = cut(read.load(bag.parent), work / 'cut' / bag.parent.name)
            final = out / bag.parent.parent.name / bag.parent.name
            _replace(final, made)
            size = sum(file.stat().st_size for file in final.iterdir())
            console.print(f'{os.path.relpath(final)}: {size / 1000:.0f} kB', highlight=False)
    return 0


def cut(bag: read.Bag, folder: Path) -> Path:
    """Write what a replay reads of a lockstep bag into a new `folder`; return it.

    Raises BagError when it cannot be replayed, or is too large to be kept with the source.
    """
    answered = {tick.stamp_ns for tick in feed.ticks(bag)}
    names = [name for name in (*feed.NEEDED, feed.PREDICTION) if name in bag.recordings]
    writer = BagWriter(
        folder, [bag.recordings[name].topic for name in names], {'run': notes(bag.run_info)}
    )
    rows = []
    for index, name in enumerate(names):
        one = bag.recordings[name]
        for row in _kept(bag, name, answered):
            times = int(one.log_ns[row]), int(one.publish_ns[row])
            rows.append((times[0], index, (*times, one.payloads[row], int(one.sequence[row]))))
    for _, index, message in sorted(rows, key=lambda one: one[:2]):
        writer.write(index, *message)
    writer.close()
    size = sum(file.stat().st_size for file in folder.iterdir())
    if size > LARGEST_BYTES:
        raise BagError(f'{folder}: {size} bytes; golden bags have at most {LARGEST_BYTES}')
    return folder


def notes(run_info: dict[str, str]) -> dict[str, str]:
    """Return the notes of a run without folders and the like of where it was made."""
    kept = dict(run_info)
    for name, wanted in (('parameters', ROLES), ('machine', MACHINE)):
        read_ = json.loads(run_info.get(name, '{}'))
        kept[name] = json.dumps({k: read_[k] for k in wanted if k in read_}, sort_keys=True)
    return kept


def _kept(bag, name, answered):
    """Return the rows of a topic that a replay reads."""
    topic = feed.Topic(bag, name)
    if name in (feed.STATE, feed.ACTUATORS):
        return [topic.rows[row] for stamp_ns, row in topic.row_of.items() if stamp_ns in answered]
    rows = range(len(topic.payloads))
    if name in (feed.REFERENCE, feed.EDGES):
        values = [topic.value(row) for row in rows]
        rows = [row for row in rows if not row or not feed.same(values[row], values[row - 1])]
    return topic.rows[[*rows]]


def _replace(final, made):
    # the MCAP file is named after its folder, which moving does not change
    final.parent.mkdir(parents=True, exist_ok=True)
    if final.exists():
        shutil.rmtree(final)
    made.rename(final)
