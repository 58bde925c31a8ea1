"""Golden recordings: small bags whose answers every later controller must repeat.

They hold the messages that a replay reads, unchanged: states and actuators of the ticks, path and
edges once, obstacles, and every answer. They are complete bags all the same.
"""

import json
import os
import shutil
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path

from rich.console import Console

from bags.errors import BagError
from bags.storage import read
from bags.storage.bag_writer import BagWriter
from experiments.replay import recorded_ticks
from experiments.replay.recorded_ticks import RecordedTopic
from experiments.run import run_and_compare

LARGEST_BYTES = 2_000_000
TIME_LIMIT_S = 300.0
# kept of the run information: what decides the numbers, without traces of the machine
ROLES = ('controller', 'plant')
MACHINE = ('processor', 'architecture', 'libc')


def refresh(drives: Mapping[str, Sequence[str]], out: Path, console: Console) -> int:
    """Run and record the node graph in lockstep, and replace the golden bags in `out`.

    `drives` are the controllers by scenario: a bag `out`/<scenario>/<controller> each.
    Returns 0 when every run completed; otherwise nothing is replaced. Raises BagError.
    """
    out.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix='.golden.', dir=out) as folder:
        work = Path(folder)
        for scenario, controllers in drives.items():
            runs = run_and_compare.Request(
                scenario, controllers, 'lockstep', work, (), TIME_LIMIT_S, overwrite=True
            )
            code = run_and_compare.run(runs, console)
            if code:
                return code
        for bag in sorted(work.glob('*/*/metadata.yaml')):
            reduced = cut(read.load(bag.parent), work / 'cut' / bag.parent.name)
            final = out / bag.parent.parent.name / bag.parent.name
            # the MCAP file is named after its folder, which moving does not change
            final.parent.mkdir(parents=True, exist_ok=True)
            shutil.rmtree(final, ignore_errors=True)
            reduced.rename(final)
            size = sum(file.stat().st_size for file in final.iterdir())
            console.print(f'{os.path.relpath(final)}: {size / 1000:.0f} kB', highlight=False)
    return 0


def cut(bag: read.Bag, folder: Path) -> Path:
    """Write the messages that a replay reads of a lockstep bag into a new `folder`; return it.

    Raises BagError when it cannot be replayed, or is too large to be kept with the source.
    """
    answered = {tick.stamp_ns for tick in recorded_ticks.read_ticks(bag)}
    topics = (*recorded_ticks.NEEDED, recorded_ticks.PREDICTION)
    names = [name for name in topics if name in bag.recordings]
    kept = dict(bag.run_info)
    for name, wanted in (('parameters', ROLES), ('machine', MACHINE)):
        values = json.loads(kept.get(name, '{}'))
        kept[name] = json.dumps({k: values[k] for k in wanted if k in values}, sort_keys=True)
    writer = BagWriter(folder, [bag.recordings[name].topic for name in names], {'run': kept})
    rows = []
    for index, name in enumerate(names):
        recorded = bag.recordings[name]
        for row in _kept_rows(bag, name, answered):
            log_ns, publish_ns = int(recorded.log_ns[row]), int(recorded.publish_ns[row])
            message = (log_ns, publish_ns, recorded.payloads[row], int(recorded.sequence[row]))
            rows.append((log_ns, index, message))
    for _, index, message in sorted(rows, key=lambda row: row[:2]):
        writer.write(index, *message)
    writer.close()
    size = sum(file.stat().st_size for file in folder.iterdir())
    if size > LARGEST_BYTES:
        raise BagError(f'{folder}: {size} bytes; golden bags have at most {LARGEST_BYTES}')
    return folder


def _kept_rows(bag, name, answered):
    """Return the rows of a topic that a replay reads."""
    topic = RecordedTopic(bag, name)
    if name in (recorded_ticks.STATE, recorded_ticks.ACTUATORS):
        return [topic.rows[row] for stamp_ns, row in topic.row_of.items() if stamp_ns in answered]
    rows = range(len(topic.payloads))
    if name in (recorded_ticks.REFERENCE, recorded_ticks.EDGES):
        values = [topic.value(row) for row in rows]
        rows = [
            row
            for row in rows
            if not row or not recorded_ticks.has_same_content(values[row], values[row - 1])
        ]
    return topic.rows[[*rows]]
