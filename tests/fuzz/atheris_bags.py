"""A damaged or artificial bag causes no error but BagError, and repair loses nothing.

By hand: `python tests/fuzz/atheris_bags.py -runs=100000 [corpus]`, see docs/faults.md.
"""

import shutil
import warnings
from pathlib import Path

import coverage_guided

with coverage_guided.instrumented('bags', 'msgs_yaml'):
    from mcap.reader import make_reader
    from mcap_pieces import changed, small_bags

    from bags.errors import BagError, DamagedBagWarning
    from bags.evaluation.bag_summary import summarize_bag
    from bags.playback import build_playlist
    from bags.storage import read, repair

REFERENCE = Path(__file__).parents[2] / 'bags' / 'reference' / 'double_lane_change' / 'mpcc'
FOLDER = coverage_guided.scratch() / 'bag'


def look(data: bytes) -> None:
    """Read a bag in every way, repair it, and read it again."""
    FOLDER.mkdir()
    try:
        check(data)
    finally:
        shutil.rmtree(FOLDER)


def check(data: bytes) -> None:
    """Do what `look` says, in an empty folder."""
    file = FOLDER / f'{FOLDER.name}_0.mcap'
    file.write_bytes(data)
    with warnings.catch_warnings():
        # numbers that no column can hold must be refused, not cast
        warnings.simplefilter('error')
        warnings.simplefilter('ignore', DamagedBagWarning)
        before = attempt(read.load, FOLDER)
        if before is not None:
            use(before)
        repaired = attempt(repair.repair_bag, FOLDER)
        if repaired is not None:
            assert repair.describe_repair(repaired)
            compare(before, repaired, data)


def attempt(action, *arguments):
    """Return the result of an action; None for a BagError with a text."""
    try:
        return action(*arguments)
    except BagError as error:
        if not str(error):
            raise
        return None


def use(bag: read.Bag) -> None:
    """Call every reader of a bag."""
    attempt(summarize_bag, bag)
    attempt(build_playlist, bag)
    for topic in bag.recordings:
        attempt(read.columns, bag, [topic])
        attempt(read.values, bag, topic)


def compare(before: read.Bag | None, repaired: repair.Repair, data: bytes) -> None:
    """Assert that nothing is lost and that the repaired file is complete, for other readers too."""
    ((file, kept, *_),) = repaired.files
    assert (kept or file).read_bytes() == data
    messages = sum(repaired.messages.values())
    after = attempt(read.load, FOLDER)
    if after is not None:
        assert after.damage is None
        assert sum(len(one.payloads) for one in after.recordings.values()) == messages
    if before is not None and before.damage is None:
        for topic, recorded in before.recordings.items():
            assert after.recordings[topic].payloads == recorded.payloads
    if kept:
        with file.open('rb') as opened:
            assert make_reader(opened).get_summary().statistics.message_count == messages


if __name__ == '__main__':
    coverage_guided.run(look, changed, small_bags(read.load(REFERENCE)))
