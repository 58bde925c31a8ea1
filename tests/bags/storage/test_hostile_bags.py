"""Bags that nobody recorded: sound to every checksum, and told to mislead. Found by fuzzing."""

import struct
import tracemalloc
from pathlib import Path

import lz4.frame
import pytest
import zstandard
from mcap.opcode import Opcode

from bags.errors import BagError
from bags.evaluation.bag_summary import summarize_bag
from bags.storage import cdr, mcap_scan, read, repair
from bags.storage.bag_writer import BagWriter
from bags.storage.message_definitions import SEPARATOR, schema_text
from bags.storage.rosbag2_metadata import BagTopic, parse_qos, qos_text

STATE, COMMAND = '/vehicle/odometry', '/controller/command'
TYPES = {
    STATE: 'nav_msgs/msg/Odometry',
    COMMAND: 'sensor_msgs/msg/JointState',
    '/controller/why': 'diagnostic_msgs/msg/DiagnosticArray',
}
QOS = qos_text('keep_last', 1, 'reliable', 'volatile')
REFERENCE = Path(__file__).parents[3] / 'bags' / 'reference' / 'double_lane_change' / 'mpcc'
LITTLE = b'\x00\x01\x00\x00'
NO_NUMBERS = LITTLE + bytes(2000)


def section(name, text):
    return f'\n{SEPARATOR}\nMSG: {name}\n{text}\n'


def without(topic, line):
    text = schema_text(TYPES[topic])
    assert line in text
    return text.replace(line, '')


@pytest.fixture
def bag(tmp_path):
    """bag(topic, type, definition, payload) -> folder of a bag with that message."""

    def make(topic, type_name, text, payload=NO_NUMBERS, qos=QOS):
        writer = BagWriter(tmp_path / 'bag', [BagTopic(topic, type_name, text, '', qos)], {})
        writer.write(0, 1, 1, payload)
        writer.close()
        return tmp_path / 'bag'

    return make


@pytest.fixture(scope='module')
def recorded():
    """A sound message of each type that is made up below."""
    bag = read.load(REFERENCE)
    return {topic: bag.recordings[topic].payloads[0] for topic in TYPES}


CIRCLE = 'a/B b' + section('a/B', 'a/C c') + section('a/C', 'a/B b')
DEEP = 'a/T0 t' + ''.join(section(f'a/T{i}', f'a/T{i + 1} t') for i in range(2000))
DEEP += section('a/T2000', 'int32 x')
MANY = 'a/T0[999] t' + ''.join(section(f'a/T{i}', f'a/T{i + 1}[999] t') for i in range(5))
MANY += section('a/T5', '')
MADE_UP = {
    'type without a package': (COMMAND, 'JointState', 'int32 x'),
    'type that ends in a slash': (COMMAND, 'sensor_msgs/', 'int32 x'),
    'section without a package': ('/clock', 'a/A', 'a/B b' + section('B', 'int32 x')),
    'name in no array': (COMMAND, TYPES[COMMAND], without(COMMAND, 'float64[] position')),
    'stamp without seconds': (STATE, TYPES[STATE], without(STATE, 'int32 sec\n')),
    'message without a twist': (STATE, TYPES[STATE], without(STATE, 'Vector3  angular')),
    'status without values': ('/controller/why', TYPES['/controller/why'], 'int32 x'),
    'array of as many as nobody can count': ('/clock', 'a/A', f'int8[{"9" * 5000}] x'),
    'text of wide characters': ('/clock', 'a/A', 'wstring x'),
    'type in itself': ('/clock', 'a/A', CIRCLE),
    'types in types': ('/clock', 'a/A', DEEP),
    'arrays of arrays of nothing': ('/clock', 'a/A', MANY),
}


@pytest.mark.timeout(20)
@pytest.mark.parametrize('name', MADE_UP)
def test_definition_that_does_not_fit_is_refused(bag, recorded, name):
    topic, *made_up = MADE_UP[name]
    folder = bag(topic, *made_up, payload=recorded.get(topic, NO_NUMBERS))
    for use in (read.columns, lambda given: read.values(given, topic)):
        with pytest.raises(BagError, match=topic):
            use(folder)
    assert repair.repair_bag(folder).intact


@pytest.mark.parametrize('part', ['sec', 'nanosec'])
@pytest.mark.filterwarnings('error')
def test_stamp_that_is_no_whole_number_is_refused(bag, part):
    text = schema_text(TYPES[STATE])
    (line,) = (item for item in text.splitlines() if item.endswith(f'int32 {part}'))
    folder = bag(STATE, TYPES[STATE], text.replace(line, f'float64 {part}'))
    with pytest.raises(BagError, match=r'header.stamp is of .*float64.*; allowed int32 and uint32'):
        read.columns(folder)


def test_first_state_without_a_stamp_is_refused_by_every_reader(bag):
    folder = bag(STATE, TYPES[STATE], schema_text(TYPES[STATE]), b'\x00\x07no CDR')
    with pytest.raises(BagError, match=f'message 0 of {STATE}'):
        read.columns(folder)


def test_states_without_stamps_are_counted_as_invalid_in_a_summary(tmp_path):
    topics = [BagTopic(n, TYPES[n], schema_text(TYPES[n]), '', QOS) for n in (STATE, COMMAND)]
    writer = BagWriter(tmp_path / 'bag', topics, {})
    for index in (0, 1):
        writer.write(index, 1, 1, b'')
    writer.close()
    result = summarize_bag(read.load(tmp_path / 'bag'))
    counts = {topic: item['count'] for topic, item in result['invalid_messages'].items()}
    assert counts == {STATE: 1, COMMAND: 1}
    assert result['invalid_messages'][STATE]['first'].startswith('message 0: not plain CDR')
    assert (result['latency_ms'], result['ticks']) == (None, None)


def test_field_with_a_name_that_python_keeps_for_itself_is_read():
    text = 'int32 from\nint32 x\nint32 x'
    assert tuple(cdr.decode(LITTLE + struct.pack('<iii', 1, 2, 3), text, 'a/A')) == (1, 2, 3)


def test_message_without_fields_takes_the_byte_that_ros_gives_it():
    text = 'a/B b\nuint8 x' + section('a/B', '')
    assert cdr.decode(LITTLE + b'\x00\x07', text, 'a/A').x == 7


@pytest.mark.parametrize(
    'text',
    [
        '&a [*a]',
        '- &a {depth: &b [1]}\n- *b',
        pytest.param('[' * 5000, id='brackets'),
        '!!timestamp x',
        '!!float ""',
        '9999-99-99',
    ],
)
def test_qos_that_is_none_says_nothing_and_is_no_obstacle(bag, text):
    assert parse_qos(text) == []
    folder = bag('/clock', 'a/A', 'int32 x', qos=text)
    (folder / 'metadata.yaml').write_text(text)
    assert repair.repair_bag(folder).wrote_metadata


def test_qos_of_odd_values_says_nothing_of_them():
    (result,) = parse_qos('- {history: [1], reliability: {}, durability: 2, depth: 3}')
    assert result['history'] is None
    assert result['reliability'] is None
    assert result['durability'] == 'volatile'


def chunk(codec, data, size):
    """The record of a chunk without a checksum."""
    body = (
        mcap_scan.CHUNK_HEADER.pack(0, 0, size, 0, len(codec))
        + codec
        + mcap_scan.SIZE.pack(len(data))
        + data
    )
    return mcap_scan.RECORD_PREFIX.pack(Opcode.CHUNK, len(body)) + body


def first_of(codec, data, size):
    return next(mcap_scan.scan_records(mcap_scan.MCAP0_MAGIC + chunk(codec, data, size)))


UNSAID = zstandard.ZstdCompressor(write_content_size=False)
PACKED = {b'zstd': UNSAID.compress, b'lz4': lz4.frame.compress}


@pytest.mark.parametrize('codec', PACKED)
def test_chunk_that_does_not_say_its_size_is_read(codec):
    contents = bytes(range(256)) * 40
    result = first_of(codec, PACKED[codec](contents), len(contents))
    assert result.body == contents


@pytest.mark.parametrize('codec', PACKED)
def test_chunk_gets_no_more_memory_than_its_head_claims(codec):
    packed = PACKED[codec](bytes(100_000_000))
    tracemalloc.start()
    result = first_of(codec, packed, 1000)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert isinstance(result, mcap_scan.Damage)
    assert peak < 10_000_000
