"""Readers that know nothing of this project open a bag, in one file or several, and read it."""

from collections import Counter

import pytest
import yaml
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from one_second import expected, write_recordings
from rosbags.highlevel import AnyReader
from rosbags.rosbag2 import Reader

from bags.evaluation.bag_summary import summarize_bag
from bags.storage import read
from bags.storage.mcap_reader import mcap_files, read_mcap
from msgs_yaml import contract

SPLITS = {
    'whole': {},
    'by time': {'split_ns': 90_000_000},
    'by size': {'split_bytes': 100_000},
}


@pytest.fixture(scope='module')
def whole(bag_folder):
    return read.load(bag_folder)


@pytest.fixture(scope='module', params=SPLITS.values(), ids=SPLITS)
def split(request, tmp_path_factory, whole):
    """Return a folder of the same messages, and how they were split."""
    folder = tmp_path_factory.mktemp('written') / 'bag'
    write_recordings(folder, whole.recordings.values(), whole.run_info, **request.param)
    return folder, request.param


def payloads(bag):
    return {name: r.payloads for name, r in bag.recordings.items()}


def heard(bag):
    """Return the payloads of the topics on which something came; some are for viewers only."""
    return {name: data for name, data in payloads(bag).items() if data}


def test_it_reads_as_it_was_written(split, whole):
    bag = read.load(split[0])
    assert payloads(bag) == payloads(whole)
    assert (bag.run_info, bag.damage) == (whole.run_info, None)
    for name, recorded in whole.recordings.items():
        for column in ('log_ns', 'publish_ns', 'sequence'):
            written = getattr(bag.recordings[name], column)
            assert written.tolist() == getattr(recorded, column).tolist()
    summary = summarize_bag(bag)
    assert summary['messages'] == sum(map(len, payloads(whole).values()))
    sizes = {file.name: file.stat().st_size for file in mcap_files(split[0])}
    assert (summary['files'], summary['bytes']) == (sizes, sum(sizes.values()))


def test_files_are_numbered_and_as_long_as_was_asked_for(split):
    folder, wanted = split
    files = mcap_files(folder)
    assert [file.name for file in files] == [f'bag_{k}.mcap' for k in range(len(files))]
    if 'split_ns' in wanted:
        assert len(files) == 12
        for file in files:
            log_ns = [r.log_ns for r in read.load(file).recordings.values() if r.payloads]
            assert max(t.max() for t in log_ns) - min(t.min() for t in log_ns) < 90_000_000
    elif wanted:
        sizes = [file.stat().st_size for file in files]
        assert len(sizes) >= 2
        assert min(sizes[:-1]) >= 100_000
        assert max(sizes) < 200_000


def test_rosbags_finds_every_payload_counts_qos_and_hashes(split, whole):
    folder, _ = split
    result = {}
    with AnyReader([folder]) as reader:
        for connection, _, data in reader.messages():
            result.setdefault(connection.topic, []).append(bytes(data))
    assert result == heard(whole)
    with Reader(folder) as reader:
        assert reader.message_count == sum(map(len, result.values()))
        connections = {connection.topic: connection for connection in reader.connections}
        assert connections.keys() >= contract.load().topics.keys()
        reference = connections['/scenario/reference']
        assert reference.digest.startswith('RIHS01_')
        (profile,) = reference.ext.offered_qos_profiles
        assert profile.durability.name == 'TRANSIENT_LOCAL'
        assert profile.reliability.name == 'RELIABLE'


def test_each_file_explains_itself_to_mcap_and_mcap_ros2(split, whole, messages):
    decoded, last = Counter(), None
    for path in mcap_files(split[0]):
        with path.open('rb') as file:
            reader = make_reader(file, validate_crcs=True, decoder_factories=[DecoderFactory()])
            summary = reader.get_summary()
            assert {chunk.compression for chunk in summary.chunk_indexes} == {'zstd'}
            names = {record.name for record in reader.iter_metadata()}
            assert {'run', 'rosbag2'} <= names
            times, counts = [], Counter()
            for _, channel, record, message in reader.iter_decoded_messages(log_time_order=True):
                times.append(record.log_time)
                counts[channel.id] += 1
                decoded[channel.topic] += 1
                if channel.topic == '/vehicle/odometry':
                    last = message
            assert times == sorted(times)
            told = summary.statistics.channel_message_counts
            assert {key: n for key, n in told.items() if n} == counts
    assert {name: decoded[name] for name in messages} == expected(messages)
    assert last.pose.pose.position.x == messages['/vehicle/odometry'][-1].X


def test_metadata_lists_files_and_messages_as_rosbag2_does(split, whole):
    folder, _ = split
    beside = yaml.safe_load((folder / 'metadata.yaml').read_text())['rosbag2_bagfile_information']
    names = [file.name for file in mcap_files(folder)]
    assert beside['version'] == 9
    assert beside['relative_file_paths'] == [file['path'] for file in beside['files']] == names
    total = sum(map(len, payloads(whole).values()))
    assert beside['message_count'] == sum(f['message_count'] for f in beside['files']) == total
    counts = {
        entry['topic_metadata']['name']: entry['message_count']
        for entry in beside['topics_with_message_count']
    }
    assert counts == {name: len(data) for name, data in payloads(whole).items()}
    if len(names) == 1:
        inside = read_mcap(folder / names[0]).records['rosbag2']['serialized_metadata']
        assert yaml.safe_load(inside) == beside
