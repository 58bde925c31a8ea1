"""Readers that know nothing of this project open the bag and find every message unchanged."""

import resource
from collections import Counter

import pytest
import yaml
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from one_second import expected
from rosbags.highlevel import AnyReader
from rosbags.rosbag2 import Reader

from bags.errors import BagError
from bags.storage import read, repair
from bags.storage.bag_writer import BagWriter
from bags.storage.mcap_reader import read_mcap
from msgs_yaml import contract, share


def recorded_payloads(bag_folder):
    return {n: r.payloads for n, r in read.load(bag_folder).recordings.items() if r.payloads}


def test_rosbags_finds_every_payload_unchanged_and_decodes_it(bag_folder):
    result = {}
    with AnyReader([bag_folder]) as reader:
        for connection, _, data in reader.messages():
            result.setdefault(connection.topic, []).append(bytes(data))
            assert reader.deserialize(data, connection.msgtype).__msgtype__ == connection.msgtype
    assert result == recorded_payloads(bag_folder)


def test_rosbags_finds_counts_qos_and_hashes_in_the_metadata(bag_folder):
    with Reader(bag_folder) as reader:
        assert reader.message_count == sum(map(len, recorded_payloads(bag_folder).values()))
        connections = {connection.topic: connection for connection in reader.connections}
        assert connections.keys() >= contract.load().topics.keys()
        reference = connections['/scenario/reference']
        assert reference.digest.startswith('RIHS01_')
        (profile,) = reference.ext.offered_qos_profiles
        assert profile.durability.name == 'TRANSIENT_LOCAL'
        assert profile.reliability.name == 'RELIABLE'


def test_mcap_summary_counts_and_indexes_every_message(bag_folder):
    payloads = recorded_payloads(bag_folder)
    with open(bag_folder / 'mpcc_0.mcap', 'rb') as file:
        reader = make_reader(file, validate_crcs=True)
        summary = reader.get_summary()
        counts = {
            summary.channels[channel].topic: n
            for channel, n in summary.statistics.channel_message_counts.items()
        }
        assert counts == {topic: len(data) for topic, data in payloads.items()}
        assert {chunk.compression for chunk in summary.chunk_indexes} == {'zstd'}
        times = [message.log_time for _, _, message in reader.iter_messages(log_time_order=True)]
        assert times == sorted(times)
        assert len(times) == sum(counts.values())


def test_mcap_ros2_decodes_every_message_by_the_schema_in_the_file(bag_folder, messages):
    decoded = Counter()
    with open(bag_folder / 'mpcc_0.mcap', 'rb') as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        for _, channel, _, message in reader.iter_decoded_messages():
            decoded[channel.topic] += 1
            if channel.topic == '/vehicle/odometry':
                last = message
    assert {name: decoded[name] for name in messages} == expected(messages)
    assert last.pose.pose.position.x == messages['/vehicle/odometry'][-1].X


def test_schema_text_is_the_message_definitions_byte_for_byte(bag_folder):
    with open(bag_folder / 'mpcc_0.mcap', 'rb') as file:
        schemas = make_reader(file).get_summary().schemas.values()
    assert {schema.name for schema in schemas} >= {t.type for t in contract.load().topics.values()}
    for schema in schemas:
        assert schema.encoding == 'ros2msg'
        first, *others = schema.data.split(b'\n' + b'=' * 80 + b'\nMSG: ')
        package, _, name = schema.name.split('/')
        assert first == definition(package, name)
        named = [section.partition(b'\n') for section in others]
        assert len({title for title, _, _ in named}) == len(named)
        for title, _, text in named:
            assert text == definition(*title.decode().split('/'))


def definition(package, name):
    return share.path(package, 'msg', f'{name}.msg').read_bytes()


def test_metadata_inside_the_file_is_the_metadata_beside_it(bag_folder):
    beside = yaml.safe_load((bag_folder / 'metadata.yaml').read_text())
    inside = read_mcap(bag_folder / 'mpcc_0.mcap').records['rosbag2']['serialized_metadata']
    assert yaml.safe_load(inside) == beside['rosbag2_bagfile_information']
    assert beside['rosbag2_bagfile_information']['relative_file_paths'] == ['mpcc_0.mcap']
    assert beside['rosbag2_bagfile_information']['version'] == 9


def test_existing_folder_is_refused_and_left_alone(bag_folder):
    before = (bag_folder / 'mpcc_0.mcap').read_bytes()
    with pytest.raises(BagError, match='exists already'):
        BagWriter(bag_folder, [], {})
    assert (bag_folder / 'mpcc_0.mcap').read_bytes() == before


def test_folder_that_cannot_be_made_is_refused_by_name(tmp_path):
    (tmp_path / 'file').write_text('')
    with pytest.raises(BagError, match=r'file/bag: cannot be created: Not a directory'):
        BagWriter(tmp_path / 'file' / 'bag', [], {})


def test_full_disk_is_a_clear_error_and_what_was_flushed_stays_complete(tmp_path, bag_folder):
    recorded = read.load(bag_folder).recordings['/vehicle/odometry']
    writer = BagWriter(tmp_path / 'bag', [recorded.topic], {})
    times = recorded.log_ns.tolist()
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    flushed = []

    def record_until_the_disk_is_full():
        while True:
            for log_ns, data in zip(times, recorded.payloads):
                writer.write(0, log_ns, log_ns, data)
            writer.flush()
            flushed.extend(recorded.payloads)

    resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, hard))
    try:
        with pytest.raises(BagError, match=r'File too large; the first \d+ bytes are kept'):
            record_until_the_disk_is_full()
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert not repair.repair_bag(tmp_path / 'bag').intact
    result = read.load(tmp_path / 'bag').recordings['/vehicle/odometry'].payloads
    assert len(flushed) <= len(result) <= len(flushed) + len(recorded.payloads)
    assert result == (flushed + recorded.payloads)[: len(result)]
