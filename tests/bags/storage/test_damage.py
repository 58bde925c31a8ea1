"""Bags cut off, with flipped bits, or both: no crash, no hang, nothing readable is lost.

A fifth of them by default; all 1,000: DAMAGED_BAGS=1000 pytest tests/bags/storage/test_damage.py
"""

import os
import shutil
import warnings
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import pytest
from mcap.opcode import Opcode
from mcap.reader import make_reader

from bags.errors import BagError, DamagedBagWarning
from bags.evaluation.bag_summary import summarize_bag
from bags.playback import build_playlist
from bags.storage import read, repair
from bags.storage.mcap_scan import RECORD_PREFIX, scan_records

BAGS = int(os.environ.get('DAMAGED_BAGS', '200'))
BATCH = 100
SEED = 20260101
CHUNKS = 8
PER_CHUNK = 12  # messages of each topic
TOPICS = ('/vehicle/odometry', '/controller/command', '/controller/why', '/clock')


class Healthy(NamedTuple):
    """A complete file, and where its chunks lie."""

    data: bytes
    payloads: dict[str, list[bytes]]
    chunks: list[tuple[int, int]]  # begin and end of each
    summary: tuple[int, int]

    def __repr__(self):
        return 'the healthy bag'


class Case(NamedTuple):
    """One damaged file."""

    data: bytes
    cut: int | None  # its length, where it was cut off
    flipped: list[int]  # bytes with a wrong bit


@pytest.fixture(scope='module')
def healthy(write_chunks):
    folder = write_chunks(TOPICS, CHUNKS, PER_CHUNK)
    data = (folder / 'bag_0.mcap').read_bytes()
    chunks = [
        (
            item.offset,
            item.offset + RECORD_PREFIX.size + RECORD_PREFIX.unpack_from(data, item.offset)[1],
        )
        for item in scan_records(data)
        if item.opcode == Opcode.CHUNK
    ]
    assert len(chunks) == CHUNKS
    assert all(end <= begin for (_, end), (begin, _) in pairwise(chunks))
    payloads = {name: r.payloads for name, r in read.load(folder).recordings.items()}
    (end_of_data,) = (item.offset for item in scan_records(data) if item.opcode == Opcode.DATA_END)
    return Healthy(data, payloads, chunks, (end_of_data, len(data)))


def damaged(whole, generator):
    """Cut it off, flip up to eight bits, or both."""
    data, cut, flipped = bytearray(whole), None, []
    kind = generator.choice(['cut', 'flip', 'both'])
    if kind != 'cut':
        flipped = generator.integers(len(data), size=generator.integers(1, 9)).tolist()
        for at in flipped:
            data[at] ^= 1 << int(generator.integers(8))
    if kind != 'flip':
        cut = int(generator.integers(len(data)))
        del data[cut:]
        flipped = [at for at in flipped if at < cut]
    return Case(bytes(data), cut, flipped)


def is_whole(chunk, case):
    begin, end = chunk
    return (case.cut is None or end <= case.cut) and not any(
        begin <= at < end for at in case.flipped
    )


def attempt(action, *arguments):
    """Return what an action finds; None when it refuses."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter('ignore', DamagedBagWarning)
            return action(*arguments)
    except BagError:
        return None


def counts(bag):
    return [len(bag.recordings[n].payloads) if n in bag.recordings else 0 for n in TOPICS]


def check_reading(folder, healthy, case):
    """Everything before the damage is there, nothing is invented, no tool crashes."""
    bag = attempt(read.load, folder)
    first = min([len(case.data) if case.cut is not None else len(healthy.data), *case.flipped])
    before = sum(end <= first for _, end in healthy.chunks)
    if bag is None:
        assert before == 0
        return
    assert min(counts(bag)) >= before * PER_CHUNK
    for name, recorded in bag.recordings.items():
        assert recorded.payloads == healthy.payloads[name][: len(recorded.payloads)]
    assert attempt(summarize_bag, bag) is not None
    assert attempt(build_playlist, bag) is not None
    attempt(read.columns, bag)


def check_repair(folder, healthy, case):
    """Every chunk that is whole is recovered, and others can read the result.

    Topics are described in the first chunk and once more in the summary.
    """
    done = attempt(repair.repair_bag, folder)
    whole = [k for k, chunk in enumerate(healthy.chunks) if is_whole(chunk, case)]
    if not is_whole(healthy.chunks[0], case) and not is_whole(healthy.summary, case):
        return
    assert done is not None
    assert min(done.messages.values()) >= len(whole) * PER_CHUNK
    with warnings.catch_warnings():
        warnings.simplefilter('error', DamagedBagWarning)
        bag = attempt(read.load, folder)
    for k in whole:
        for name in TOPICS:
            wanted = healthy.payloads[name][k * PER_CHUNK : (k + 1) * PER_CHUNK]
            sequence = bag.recordings[name].sequence.tolist()
            at = sequence.index(k * PER_CHUNK + 1)
            assert bag.recordings[name].payloads[at : at + PER_CHUNK] == wanted
    with (folder / 'bag_0.mcap').open('rb') as file:
        statistics = make_reader(file).get_summary().statistics
    assert statistics.message_count == sum(done.messages.values())


@pytest.mark.parametrize('batch', range(BAGS // BATCH))
def test_a_hundred_damaged_bags_give_back_what_is_readable(healthy, tmp_path, batch):
    generator = np.random.default_rng([SEED, batch])
    folder = tmp_path / 'bag'
    for _ in range(BATCH):
        case = damaged(healthy.data, generator)
        folder.mkdir()
        (folder / 'bag_0.mcap').write_bytes(case.data)
        check_reading(folder, healthy, case)
        check_repair(folder, healthy, case)
        shutil.rmtree(folder)
