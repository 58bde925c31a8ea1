"""Bags cut off, with wrong bytes, or without a file: what checksums vouch for comes back.

So many damaged bags as DAMAGED_BAGS says:
DAMAGED_BAGS=1000 pytest tests/bags/storage/test_damage.py
"""

import os
import resource
import shutil
import struct
import tracemalloc
import warnings
from contextlib import contextmanager
from itertools import pairwise
from typing import NamedTuple

import lz4.frame
import pytest
import zstandard
from hypothesis import example, given, settings
from hypothesis import strategies as st
from mcap.opcode import Opcode
from mcap.reader import make_reader
from one_second import write_recordings
from rosbags.rosbag2 import Reader

from bags.errors import BagError, DamagedBagWarning
from bags.evaluation.bag_summary import summarize_bag
from bags.player_node import build_playlist
from bags.storage import mcap_reader, read, repair
from bags.storage.bag_writer import BagWriter
from bags.storage.mcap_reader import mcap_files, read_mcap

BAGS = int(os.environ.get('DAMAGED_BAGS', '150'))
CHUNKS = 8
PER_CHUNK = 12  # messages of each topic
TOPICS = ('/vehicle/odometry', '/controller/command', '/controller/why', '/clock')
IN_CHUNK = PER_CHUNK * len(TOPICS)
places = st.floats(0.0, 1.0, exclude_max=True)


class Healthy(NamedTuple):
    """A complete file and what it holds."""

    data: bytes
    messages: list[tuple]
    parts: list[tuple[int, int]]  # begin and end of each chunk, and of the summary

    def __repr__(self):
        return 'the healthy bag'


def messages_of(file):
    """Return channel, number, times and bytes of every message of a file."""
    c = read_mcap(file)
    columns = (c.channel, c.sequence, c.log_ns, c.publish_ns)
    return list(zip(*(column.tolist() for column in columns), c.payloads))


@pytest.fixture(scope='module')
def healthy(tmp_path_factory, bag_folder):
    chosen = [read.load(bag_folder).recordings[name] for name in TOPICS]
    folder = tmp_path_factory.mktemp('healthy') / 'bag'
    writer = BagWriter(folder, [r.topic for r in chosen], {'run': {'scenario': 'straight'}})
    for i in range(CHUNKS * PER_CHUNK):
        for index, recorded in enumerate(chosen):
            data = recorded.payloads[i % len(recorded.payloads)]
            writer.write(index, 1000 + i, 2000 + i, data, i + 1)
        if i % PER_CHUNK == PER_CHUNK - 1:
            writer.flush()
    writer.close()
    file = folder / 'bag_0.mcap'
    data = file.read_bytes()
    records = list(mcap_reader.scan_records(data))
    parts = [
        (item.offset, after.offset)
        for item, after in pairwise(records)
        if item.opcode == Opcode.CHUNK
    ]
    (summary,) = (item.offset for item in records if item.opcode == Opcode.DATA_END)
    return Healthy(data, messages_of(file), [*parts, (summary, len(data))])


@pytest.fixture(scope='module')
def damage(tmp_path_factory):
    """Return damage(bytes) -> a bag folder that holds them."""
    folder = tmp_path_factory.mktemp('damaged') / 'bag'

    def make(data):
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir()
        (folder / 'bag_0.mcap').write_bytes(data)
        return folder

    return make


def attempt(action, *arguments):
    """Return what an action returns; None when it refuses the bag, which must be named."""
    with warnings.catch_warnings():
        warnings.simplefilter('ignore', DamagedBagWarning)
        refused = []
        try:
            return action(*arguments)
        except BagError as error:
            refused.append(str(error))
    assert 'bag_0.mcap' in refused[0]
    return None


def assert_complete(folder, messages):
    """Assert that a bag is as good as one that was closed, for other readers, too."""
    assert messages_of(folder / 'bag_0.mcap') == messages
    with warnings.catch_warnings():
        warnings.simplefilter('error', DamagedBagWarning)
        assert read_mcap(folder / 'bag_0.mcap').indexed
    with open(folder / 'bag_0.mcap', 'rb') as file:
        assert make_reader(file).get_summary().statistics.message_count == len(messages)


def assert_read_by_rosbags(folder, messages):
    with Reader(folder) as reader:
        assert reader.message_count == len(messages)


def test_a_broken_record_behind_the_last_chunk_does_not_hide_the_summary(healthy, damage):
    whole, messages, (*chunks, _) = healthy
    wrong = bytearray(whole)
    wrong[chunks[0][0] + 100] ^= 1  # topics are described in the first chunk, and in the summary
    wrong[chunks[-1][1] + 5] ^= 1  # of the length of the record
    folder = damage(wrong)
    repair.repair_bag(folder)
    assert_complete(folder, messages[IN_CHUNK:])


@pytest.mark.parametrize('named', [True, False], ids=['its own name', 'another name'])
def test_a_damaged_description_beside_a_sound_one_describes_no_topic(healthy, damage, named):
    whole, messages, (*_, summary) = healthy
    wrong = bytearray(whole)
    records = mcap_reader.scan_records(whole)
    at = max(r.offset for r in records if getattr(r, 'opcode', None) == Opcode.CHANNEL)
    assert at > summary[0]
    wrong[at + mcap_reader.RECORD_PREFIX.size] ^= 64  # its number
    wrong[whole.index(b'nsec', at)] ^= 1  # in the QoS
    if not named:
        wrong[whole.index(b'/', at)] ^= 1
    folder = damage(wrong)
    repair.repair_bag(folder)
    assert_complete(folder, messages)
    assert_read_by_rosbags(folder, messages)
    assert set(read.load(folder).recordings) == set(TOPICS)


@settings(max_examples=BAGS)
@given(
    # bits to flip, as place and bit; bytes to set; how much of the file is left
    flips=st.lists(st.tuples(places, st.integers(0, 7)), max_size=8),
    others=st.lists(st.tuples(places, st.integers(0, 255)), max_size=20) | st.just([]),
    keep=st.just(1.0) | places,
)
@example(flips=[], others=[], keep=0.999)
@example(flips=[(0.4, 3)], others=[], keep=1.0)
def test_whatever_is_readable_of_a_damaged_bag_comes_back(healthy, damage, flips, others, keep):
    whole, messages, (*chunks, summary) = healthy
    wrong = bytearray(whole)
    for place, bit in flips:
        wrong[int(place * len(wrong))] ^= 1 << bit
    for place, value in others:
        wrong[int(place * len(wrong))] = value
    del wrong[round(keep * len(wrong)) :]

    def is_sound(part):
        return wrong[slice(*part)] == whole[slice(*part)]

    folder = damage(wrong)
    bag = attempt(read.load, folder)
    first = next((k for k, pair in enumerate(zip(whole, wrong)) if pair[0] != pair[1]), len(wrong))
    before = sum(end <= first for _, end in chunks)
    assert bag is not None or before == 0
    if bag is not None:
        for channel, name in enumerate(TOPICS, start=1):
            payloads = bag.recordings[name].payloads if name in bag.recordings else []
            sent = [data for number, *_, data in messages if number == channel]
            assert payloads == sent[: len(payloads)]
            assert len(payloads) >= before * PER_CHUNK
        for use in (summarize_bag, build_playlist):
            assert attempt(use, bag) is not None
        attempt(read.columns, bag)
    done = attempt(repair.repair_bag, folder)
    # topics are described in the first chunk and once more in the summary
    assert done is not None or not (is_sound(chunks[0]) or is_sound(summary))
    if done is None:
        assert [path.name for path in folder.iterdir()] == ['bag_0.mcap']
        assert (folder / 'bag_0.mcap').read_bytes() == wrong
        return
    assert done.intact == (wrong == whole)
    if not done.intact:
        assert done.files[0].kept.read_bytes() == wrong
        assert done.files[0].damage[0].offset <= len(wrong)
    recovered = messages_of(folder / 'bag_0.mcap')
    assert sum(done.messages.values()) == len(recovered) <= len(messages)
    assert_complete(folder, recovered)
    if not is_sound(chunks[0]) and not is_sound(summary):
        return
    assert_read_by_rosbags(folder, recovered)
    kept = {message[1:] for message in recovered}  # channels may be numbered anew
    parts = [messages[k * IN_CHUNK : (k + 1) * IN_CHUNK] for k in range(CHUNKS)]
    for chunk, part in zip(chunks, parts):
        assert not is_sound(chunk) or kept >= {message[1:] for message in part}
    if len(flips) + len(others) < 2 and (keep == 1.0 or not (flips or others)):
        # a single wrong byte, or a cut: nothing is invented, and no chunk is lost but its own
        assert kept <= {message[1:] for message in messages}
        assert len(recovered) >= len(messages) - IN_CHUNK or keep < 1.0


def test_complete_bag_is_not_touched(healthy, damage):
    folder = damage(healthy.data)
    first = repair.repair_bag(folder)
    assert (first.intact, first.wrote_metadata) == (True, True)
    assert_complete(folder, healthy.messages)
    assert_read_by_rosbags(folder, healthy.messages)
    modified = [path.stat().st_mtime_ns for path in sorted(folder.iterdir())]
    done = repair.repair_bag(folder)
    assert (done.intact, done.files[0].kept, done.wrote_metadata) == (True, None, False)
    assert [path.stat().st_mtime_ns for path in sorted(folder.iterdir())] == modified


def test_a_repair_keeps_what_it_found_and_what_an_earlier_one_kept(healthy, damage):
    folder = damage(healthy.data[:-50])
    described = read_mcap(folder / 'bag_0.mcap').topics
    (folder / 'bag_0.mcap.repaired').write_bytes(b'half')  # of a repair that was interrupted
    repair.repair_bag(folder)
    assert_complete(folder, healthy.messages)
    assert read.run_info(folder) == {'scenario': 'straight'}
    assert read_mcap(folder / 'bag_0.mcap').topics == described
    assert not (folder / 'bag_0.mcap.repaired').exists()
    shutil.copy(folder / 'bag_0.mcap.damaged', folder / 'bag_0.mcap')
    assert repair.repair_bag(folder).files[0].kept.name == 'bag_0.mcap.damaged2'
    assert (folder / 'bag_0.mcap.damaged').exists()


def test_a_file_alone_is_repaired_without_metadata_and_noise_is_refused(healthy, tmp_path):
    (tmp_path / 'alone.mcap').write_bytes(healthy.data[:-50])
    repair.repair_bag(tmp_path / 'alone.mcap')
    names = ['alone.mcap', 'alone.mcap.damaged']
    assert sorted(path.name for path in tmp_path.iterdir()) == names
    (tmp_path / 'noise.mcap').write_bytes(b'\x89MCAP0\r\n' + bytes(range(256)) * 8)
    with pytest.raises(BagError, match='nothing can be recovered'):
        repair.repair_bag(tmp_path / 'noise.mcap')
    assert sorted(path.name for path in tmp_path.iterdir()) == [*names, 'noise.mcap']


def test_commands_say_what_is_damaged_and_what_was_recovered(healthy, damage, bags_prints):
    folder = damage(healthy.data[: len(healthy.data) // 2])
    with pytest.warns(DamagedBagWarning, match=r'damaged at byte \d+ .*cut off.*`bags repair'):
        read.load(folder)
    assert 'bags repair' in ' '.join(bags_prints('info', folder).split())
    output = bags_prints('repair', folder)
    assert 'repaired; the damaged file is kept as bag_0.mcap.damaged' in output
    assert 'damage at byte' in output
    assert f'recovered {len(messages_of(folder / "bag_0.mcap"))} messages, ' in output
    assert '    /vehicle/odometry ' in output
    assert 'complete, nothing to repair' in bags_prints('repair', folder)


# chunks that mislead a reader


def first_of(codec, data, size):
    """Return the first thing in a file that begins with a chunk without a checksum."""
    body = mcap_reader.CHUNK_HEADER.pack(0, 0, size, 0, len(codec)) + codec
    body += struct.pack('<Q', len(data)) + data
    head = mcap_reader.RECORD_PREFIX.pack(Opcode.CHUNK, len(body))
    return next(mcap_reader.scan_records(mcap_reader.MCAP0_MAGIC + head + body))


UNSAID = zstandard.ZstdCompressor(write_content_size=False)
PACKED = {b'zstd': UNSAID.compress, b'lz4': lz4.frame.compress}


@pytest.mark.parametrize('codec', PACKED)
def test_chunk_that_does_not_say_its_size_is_read_within_what_its_head_claims(codec):
    contents = bytes(range(256)) * 40
    assert first_of(codec, PACKED[codec](contents), len(contents)).body == contents
    packed = PACKED[codec](bytes(100_000_000))
    tracemalloc.start()
    result = first_of(codec, packed, 1000)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert isinstance(result, mcap_reader.Damage)
    assert peak < 10_000_000


# a recorder that ends in the middle


@contextmanager
def full_disk(size):
    """Let no file be larger than `size` bytes."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


def test_full_disk_is_a_clear_error_and_what_was_flushed_stays_complete(tmp_path, bag_folder):
    recorded = read.load(bag_folder).recordings['/vehicle/odometry']
    writer = BagWriter(tmp_path / 'bag', [recorded.topic], {})
    flushed = []

    def record_until_the_disk_is_full():
        while True:
            for log_ns, data in zip(recorded.log_ns.tolist(), recorded.payloads):
                writer.write(0, log_ns, log_ns, data)
            writer.flush()
            flushed.extend(recorded.payloads)

    why = r'File too large; the first \d+ bytes are kept'
    with full_disk(100_000), pytest.raises(BagError, match=why):
        record_until_the_disk_is_full()
    before = (tmp_path / 'bag/bag_0.mcap').read_bytes()
    with full_disk(50_000), pytest.raises(BagError, match=r'cannot be repaired: .*it is unchanged'):
        repair.repair_bag(tmp_path / 'bag')
    assert (tmp_path / 'bag/bag_0.mcap').read_bytes() == before
    assert not repair.repair_bag(tmp_path / 'bag').intact
    result = read.load(tmp_path / 'bag').recordings['/vehicle/odometry'].payloads
    assert len(flushed) <= len(result) <= len(flushed) + len(recorded.payloads)
    assert result == (flushed + recorded.payloads)[: len(result)]


# a bag in several files


@pytest.fixture(scope='module')
def split_folder(tmp_path_factory, bag_folder):
    """Return a bag in eleven files of a tenth of a second each, and what is left of it."""
    folder = tmp_path_factory.mktemp('split') / 'bag'
    whole = read.load(bag_folder)
    recordings = whole.recordings.values()
    return write_recordings(folder, recordings, whole.run_info, split_ns=90_000_000)


def states(bag):
    return bag.recordings['/vehicle/odometry'].payloads


@pytest.fixture
def copied(tmp_path, split_folder):
    return shutil.copytree(split_folder, tmp_path / 'bag')


def test_damage_in_a_file_ends_a_split_bag_there_and_repair_mends_that_file_only(
    copied, bag_folder, split_folder
):
    (copied / 'metadata.yaml').unlink()
    third = copied / 'bag_2.mcap'
    third.write_bytes(third.read_bytes()[:-20])
    with pytest.warns(DamagedBagWarning, match=r'bag_2.mcap: damaged at byte'):
        left = states(read.load(copied))
    assert 180 <= len(left) <= 271
    assert left == states(read.load(bag_folder))[: len(left)]
    done = repair.repair_bag(copied)
    assert [file.path.name for file in done.files if file.kept] == ['bag_2.mcap']
    assert done.wrote_metadata
    assert states(read.load(copied)) == states(read.load(split_folder))
    with Reader(copied) as reader:
        assert reader.message_count == sum(done.messages.values())
    assert repair.repair_bag(copied).intact
    assert repair.repair_bag(copied / 'bag_0.mcap').intact


def test_missing_file_ends_a_split_bag_there(copied):
    (copied / 'bag_3.mcap').unlink()
    with pytest.warns(DamagedBagWarning, match=r'bag_3.mcap is missing; read up to there'):
        assert len(states(read.load(copied))) == 270
    done = repair.repair_bag(copied)
    assert (done.missing, done.intact) == (('bag_3.mcap',), False)
    assert 'bag_3.mcap is missing' in repair.describe_repair(done)


@pytest.mark.parametrize('left', [0, 60])
def test_file_that_was_just_begun_when_the_recorder_was_killed_becomes_an_empty_one(copied, left):
    (copied / 'bag_12.mcap').write_bytes((copied / 'bag_0.mcap').read_bytes()[:left])
    (copied / 'metadata.yaml').unlink()
    before = {file: file.read_bytes() for file in mcap_files(copied)[:-1]}
    done = repair.repair_bag(copied)
    assert [file.path.name for file in done.files if file.kept] == ['bag_12.mcap']
    assert {file: file.read_bytes() for file in before} == before
    assert read.load(copied).damage is None
    with Reader(copied) as reader:
        assert reader.message_count == sum(done.messages.values())
