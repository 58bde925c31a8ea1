"""After any damage, what the checksums vouch for comes back, and nothing else does."""

import shutil
from itertools import pairwise
from typing import NamedTuple

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.opcode import Opcode
from mcap.reader import make_reader
from rosbags.rosbag2 import Reader

from bags import cli
from bags.errors import BagError
from bags.storage import read, repair
from bags.storage.mcap_reader import read_mcap
from bags.storage.mcap_scan import scan_records

CHUNKS = 10
PER_CHUNK = 20


class Healthy(NamedTuple):
    """A complete file and what it holds."""

    data: bytes
    messages: list[tuple]
    chunk_ends: list[int]  # offsets in the file

    def __repr__(self):
        return 'the healthy bag'


def messages_of(contents):
    """Return channel, number, times and bytes of every message of a file."""
    c = contents
    columns = (c.channel, c.sequence, c.log_ns, c.publish_ns)
    return list(zip(*(column.tolist() for column in columns), c.payloads))


@pytest.fixture(scope='module')
def healthy(write_chunks):
    """A small bag of ten chunks."""
    folder = write_chunks(['/vehicle/odometry', '/controller/why'], CHUNKS, PER_CHUNK)
    data = (folder / 'bag_0.mcap').read_bytes()
    result = list(scan_records(data))
    ends = [after.offset for item, after in pairwise(result) if item.opcode == Opcode.CHUNK]
    return Healthy(data, messages_of(read_mcap(folder / 'bag_0.mcap')), ends)


@pytest.fixture(scope='module')
def damage(tmp_path_factory):
    """damage(bytes) -> a bag folder that holds them."""
    folder = tmp_path_factory.mktemp('damaged') / 'bag'

    def make(data):
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir()
        (folder / 'bag_0.mcap').write_bytes(data)
        return folder

    return make


def attempt(folder):
    """Repair; None when the bag is refused, which must be said by name."""
    try:
        return repair.repair_bag(folder)
    except BagError as error:
        return None if 'bag_0.mcap' in str(error) else error


def assert_complete(folder, messages):
    """The bag is as good as one that was closed, for other readers too."""
    result = read_mcap(folder / 'bag_0.mcap')
    assert not result.damage
    assert result.indexed
    assert messages_of(result) == messages
    with open(folder / 'bag_0.mcap', 'rb') as file:
        summary = make_reader(file).get_summary()
        assert summary.statistics.message_count == len(messages)
    with Reader(folder) as reader:
        assert reader.message_count == len(messages)


@settings(max_examples=100)
@given(keep=st.floats(0.0, 1.0))
def test_file_cut_off_anywhere_gives_back_its_beginning(healthy, damage, keep):
    data, messages, ends = healthy
    cut = data[: round(keep * (len(data) - 1))]
    folder = damage(cut)
    done = attempt(folder)
    if done is None:
        assert len(cut) < ends[0]
        assert (folder / 'bag_0.mcap').read_bytes() == cut
        return
    recovered = sum(done.messages.values())
    assert_complete(folder, messages[:recovered])
    # every chunk that is whole is recovered
    assert recovered >= 2 * PER_CHUNK * sum(end <= len(cut) for end in ends)
    assert done.files[0].kept.read_bytes() == cut
    assert done.files[0].damage[0].offset <= len(cut)


@settings(max_examples=200)
@given(place=st.floats(0.0, 1.0, exclude_max=True), bit=st.integers(0, 7))
def test_one_wrong_bit_is_noticed_and_costs_no_chunk_but_its_own(healthy, damage, place, bit):
    data, messages, _ = healthy
    wrong = bytearray(data)
    wrong[int(place * len(data))] ^= 1 << bit
    folder = damage(wrong)
    done = repair.repair_bag(folder)
    assert not done.intact
    result = set(messages_of(read_mcap(folder / 'bag_0.mcap')))
    chunks = [messages[k : k + 2 * PER_CHUNK] for k in range(0, len(messages), 2 * PER_CHUNK)]
    kept = [chunk for chunk in chunks if chunk[0] in result]
    assert len(kept) >= CHUNKS - 1
    assert_complete(folder, [message for chunk in kept for message in chunk])


@settings(max_examples=150)
@given(
    places=st.lists(st.floats(0.0, 1.0, exclude_max=True), min_size=1, max_size=40),
    keep=st.floats(0.0, 1.0),
    data=st.data(),
)
def test_no_damage_at_all_makes_repair_crash(healthy, damage, places, keep, data):
    whole, messages, _ = healthy
    wrong = bytearray(whole)
    for place in places:
        wrong[int(place * len(wrong))] = data.draw(st.integers(0, 255))
    folder = damage(wrong[: round(keep * len(wrong))])
    if attempt(folder) is None:
        assert [path.name for path in folder.iterdir()] == ['bag_0.mcap']
    else:
        result = read_mcap(folder / 'bag_0.mcap')
        assert result.indexed
        assert not result.damage
        assert len(result.payloads) <= len(messages)


def test_facts_of_the_run_and_definitions_survive(healthy, damage):
    folder = damage(healthy.data[:-50])
    before = read_mcap(folder / 'bag_0.mcap').topics
    repair.repair_bag(folder)
    assert read.run_info(folder) == {'scenario': 'straight'}
    assert read_mcap(folder / 'bag_0.mcap').topics == before


def test_complete_bag_is_not_touched(healthy, damage):
    folder = damage(healthy.data)
    repair.repair_bag(folder)
    modified = [path.stat().st_mtime_ns for path in sorted(folder.iterdir())]
    done = repair.repair_bag(folder)
    assert done.intact
    assert done.files[0].kept is None
    assert [path.stat().st_mtime_ns for path in sorted(folder.iterdir())] == modified


def test_missing_metadata_file_is_written(healthy, damage):
    folder = damage(healthy.data)
    done = repair.repair_bag(folder)
    assert done.intact
    assert done.wrote_metadata
    assert_complete(folder, healthy.messages)


def test_second_repair_keeps_both_damaged_files(healthy, damage):
    folder = damage(healthy.data[:-50])
    repair.repair_bag(folder)
    shutil.copy(folder / 'bag_0.mcap.damaged', folder / 'bag_0.mcap')
    assert repair.repair_bag(folder).files[0].kept.name == 'bag_0.mcap.damaged2'
    assert (folder / 'bag_0.mcap.damaged').exists()


def test_draft_of_an_interrupted_repair_is_no_obstacle(healthy, damage):
    folder = damage(healthy.data[:-50])
    (folder / 'bag_0.mcap.repaired').write_bytes(b'half')
    repair.repair_bag(folder)
    assert_complete(folder, healthy.messages)
    assert not (folder / 'bag_0.mcap.repaired').exists()


def test_file_alone_is_repaired_without_metadata_beside_it(healthy, tmp_path):
    (tmp_path / 'download.mcap').write_bytes(healthy.data[:-50])
    repair.repair_bag(tmp_path / 'download.mcap')
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        'download.mcap',
        'download.mcap.damaged',
    ]


def test_what_holds_nothing_is_refused_and_stays(tmp_path):
    (tmp_path / 'noise.mcap').write_bytes(b'\x89MCAP0\r\n' + bytes(range(256)) * 8)
    with pytest.raises(BagError, match='nothing can be recovered'):
        repair.repair_bag(tmp_path / 'noise.mcap')
    assert [path.name for path in tmp_path.iterdir()] == ['noise.mcap']


def test_command_says_what_was_recovered_and_where_the_damage_is(healthy, damage, capsys):
    folder = damage(healthy.data[: len(healthy.data) // 2])
    assert cli.main(['repair', str(folder)]) == 0
    output = capsys.readouterr().out
    assert 'repaired; the damaged file is kept as bag_0.mcap.damaged' in output
    assert 'damage at byte' in output
    assert '/vehicle/odometry' in output
    assert cli.main(['repair', str(folder)]) == 0
    assert 'complete, nothing to repair' in capsys.readouterr().out
    assert cli.main(['repair', str(folder / 'none')]) == 1
    assert 'no such bag' in capsys.readouterr().err
