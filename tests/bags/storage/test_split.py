"""A bag in several files is one bag, for us and for others."""

import shutil

import pytest
import yaml
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rosbags.highlevel import AnyReader
from rosbags.rosbag2 import Reader

from bags import cli
from bags.errors import BagError, DamagedBagWarning
from bags.evaluation.bag_summary import summarize_bag
from bags.storage import read, repair
from bags.storage.bag_writer import BagWriter, Split
from bags.storage.mcap_reader import mcap_files
from bags.storage.message_definitions import schema_text


def write(folder, bag, split):
    """Write a bag anew with another split, in the order of time."""
    recordings = list(bag.recordings.values())
    writer = BagWriter(folder, [r.topic for r in recordings], bag.records, split)
    messages = [
        (log_ns, index, publish_ns, data, sequence)
        for index, r in enumerate(recordings)
        for log_ns, publish_ns, data, sequence in zip(
            r.log_ns.tolist(), r.publish_ns.tolist(), r.payloads, r.sequence.tolist()
        )
    ]
    for k, (log_ns, index, publish_ns, data, sequence) in enumerate(sorted(messages)):
        writer.write(index, log_ns, publish_ns, data, sequence)
        if k % 100 == 0:
            writer.flush()
    writer.close()
    return folder


@pytest.fixture(scope='module')
def whole(bag_folder):
    return read.load(bag_folder)


@pytest.fixture(scope='module')
def split_folder(tmp_path_factory, whole):
    """Ten files of a tenth of a second, and what is left of it in the eleventh."""
    folder = tmp_path_factory.mktemp('split') / 'bag'
    return write(folder, whole, Split(duration_ns=90_000_000))


@pytest.fixture
def copied(tmp_path, split_folder):
    return shutil.copytree(split_folder, tmp_path / 'bag')


def payloads(bag):
    return {name: r.payloads for name, r in bag.recordings.items()}


def test_files_are_numbered_and_cover_the_stretch_that_was_asked_for(split_folder):
    files = mcap_files(split_folder)
    assert [file.name for file in files] == [f'bag_{k}.mcap' for k in range(12)]
    for file in files:
        log_ns = [r.log_ns for r in read.load(file).recordings.values() if r.payloads]
        assert max(t.max() for t in log_ns) - min(t.min() for t in log_ns) < 90_000_000


def test_split_bag_reads_as_the_whole_one(split_folder, whole):
    bag = read.load(split_folder)
    assert payloads(bag) == payloads(whole)
    assert bag.run_info == whole.run_info
    assert bag.damage is None
    for name, table in read.columns(whole).items():
        assert read.columns(bag)[name].stamp_ns.tolist() == table.stamp_ns.tolist()


def test_size_splits_too_and_no_file_exceeds_it_by_more_than_a_chunk(tmp_path, whole):
    files = mcap_files(write(tmp_path / 'bag', whole, Split(bytes=100_000)))
    sizes = [file.stat().st_size for file in files]
    assert len(sizes) >= 2
    assert min(sizes[:-1]) >= 100_000
    assert max(sizes) < 200_000
    assert payloads(read.load(tmp_path / 'bag')) == payloads(whole)


def test_metadata_lists_the_files_as_rosbag2_does(split_folder, whole):
    text = (split_folder / 'metadata.yaml').read_text()
    result = yaml.safe_load(text)['rosbag2_bagfile_information']
    names = [file.name for file in mcap_files(split_folder)]
    assert result['relative_file_paths'] == names
    assert [file['path'] for file in result['files']] == names
    total = sum(map(len, payloads(whole).values()))
    assert result['message_count'] == total == sum(f['message_count'] for f in result['files'])
    counts = {
        entry['topic_metadata']['name']: entry['message_count']
        for entry in result['topics_with_message_count']
    }
    assert counts == {name: len(data) for name, data in payloads(whole).items()}


def heard(bag):
    """Return the payloads of the topics on which something came; some are for viewers only."""
    return {name: data for name, data in payloads(bag).items() if data}


def test_rosbags_reads_a_split_bag(split_folder, whole):
    result = {}
    with AnyReader([split_folder]) as reader:
        for connection, _, data in reader.messages():
            result.setdefault(connection.topic, []).append(bytes(data))
    assert result == heard(whole)
    with Reader(split_folder) as reader:
        assert reader.message_count == sum(map(len, result.values()))


def test_each_file_explains_itself_to_mcap_and_mcap_ros2(split_folder, whole):
    decoded = {}
    for file in mcap_files(split_folder):
        with file.open('rb') as stream:
            reader = make_reader(stream, validate_crcs=True, decoder_factories=[DecoderFactory()])
            summary_ = reader.get_summary()
            for schema in summary_.schemas.values():
                assert schema.data.decode() == schema_text(schema.name)
            names = {record.name for record in reader.iter_metadata()}
            assert names == {'run', 'losses', 'rosbag2'}
            count = 0
            for _, channel, _, _ in reader.iter_decoded_messages():
                decoded[channel.topic] = decoded.get(channel.topic, 0) + 1
                count += 1
            assert count == summary_.statistics.message_count
    assert decoded == {name: len(data) for name, data in heard(whole).items()}


def test_damage_in_a_file_ends_the_bag_there(copied, whole):
    third = copied / 'bag_2.mcap'
    third.write_bytes(third.read_bytes()[:-20])
    with pytest.warns(DamagedBagWarning, match=r'bag_2.mcap: damaged at byte'):
        bag = read.load(copied)
    state = payloads(bag)['/vehicle/odometry']
    assert state == payloads(whole)['/vehicle/odometry'][: len(state)]
    assert 180 <= len(state) <= 271


def test_missing_file_ends_the_bag_there(copied):
    (copied / 'bag_3.mcap').unlink()
    with pytest.warns(DamagedBagWarning, match=r'bag_3.mcap is missing; read up to there'):
        assert len(payloads(read.load(copied))['/vehicle/odometry']) == 270
    done = repair.repair_bag(copied)
    assert done.missing == ('bag_3.mcap',)
    assert not done.intact
    assert 'bag_3.mcap is missing' in repair.describe_repair(done)


def test_repair_mends_the_damaged_files_only(copied, whole):
    (copied / 'metadata.yaml').unlink()
    last = copied / 'bag_11.mcap'
    last.write_bytes(last.read_bytes()[:-20])
    done = repair.repair_bag(copied)
    assert [file.path.name for file in done.files if file.kept] == ['bag_11.mcap']
    assert done.wrote_metadata
    assert payloads(read.load(copied)) == payloads(whole)
    with Reader(copied) as reader:
        assert reader.message_count == sum(map(len, payloads(whole).values()))
    assert repair.repair_bag(copied).intact


@pytest.mark.parametrize('left', [0, 60])
def test_file_that_was_just_begun_when_the_recorder_was_killed_becomes_an_empty_one(copied, left):
    begun = copied / 'bag_12.mcap'
    begun.write_bytes((copied / 'bag_0.mcap').read_bytes()[:left])
    (copied / 'metadata.yaml').unlink()
    before = {file: file.read_bytes() for file in mcap_files(copied)[:-1]}
    done = repair.repair_bag(copied)
    assert [file.path.name for file in done.files if file.kept] == ['bag_12.mcap']
    assert {file: file.read_bytes() for file in before} == before
    assert read.load(copied).damage is None
    with Reader(copied) as reader:
        assert reader.message_count == sum(done.messages.values())


def test_files_of_two_bags_in_a_folder_are_refused(copied):
    (copied / 'bag_0.mcap').rename(copied / 'other_0.mcap')
    with pytest.raises(BagError, match=r'or the numbered ones of one bag; it holds bag_1\.mcap'):
        read.load(copied)


def test_info_counts_every_file(split_folder, whole, capsys):
    result = summarize_bag(read.load(split_folder))
    assert result['messages'] == sum(map(len, payloads(whole).values()))
    assert len(result['files']) == 12
    assert result['bytes'] == sum(result['files'].values())
    assert cli.main(['info', str(split_folder)]) == 0
    assert '12 files' in capsys.readouterr().out
