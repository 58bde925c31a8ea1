"""What was sent comes back, by every route; what no definition explains is refused by name."""

import contextlib
import struct
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from one_second import every_message
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from bags.errors import BagError
from bags.evaluation.bag_summary import summarize_bag
from bags.storage import cdr, columns, read, repair
from bags.storage.bag_writer import BagWriter
from bags.storage.cdr import SEPARATOR, schema_text, type_hash
from bags.storage.columns import column, group_by_layout, stamp_reader
from bags.storage.rosbag2_metadata import DEPTH, BagTopic, parse_qos, qos_text
from msgs_yaml import contract, conversions, types

JAZZY = get_typestore(Stores.ROS2_JAZZY)
STATE, COMMAND, WHY = '/vehicle/odometry', '/controller/command', '/controller/why'


def section(name, text):
    return f'\n{SEPARATOR}\nMSG: {name}\n{text}\n'


TEXT = (
    'int8 RED = 1\nbool flag\nint64 big\nchar letter\nfloat32 small\nfloat64[3] fixed\n'
    'string<=20 word "none"\nInner[] inners  # several\nuint16[<=4] few\nstring[2] two\n'
    'Pose pose\nuint8 flat\nPose[] poses\nInner one'
    + section('test_msgs/Inner', 'uint8 level\nfloat64[] numbers\nstring name')
    + section('test_msgs/Point', 'float64 x\nuint8 y')
    + section('test_msgs/Pose', 'Point at\nint16 turn\nPoint to')
)
NAME = 'test_msgs/msg/Outer'
STORE = get_typestore(Stores.EMPTY)
STORE.register(get_types_from_msg(TEXT, NAME))
Outer, Inner, Point, Pose = (
    STORE.types[f'test_msgs/msg/{name}'] for name in ('Outer', 'Inner', 'Point', 'Pose')
)
text, floats, byte = st.text(max_size=6).filter(lambda s: '\0' not in s), st.floats(), st.integers
inner = st.builds(
    Inner, level=byte(0, 255), numbers=st.lists(floats, max_size=3).map(np.array), name=text
)
point = st.builds(Point, x=floats, y=byte(0, 255))
pose = st.builds(Pose, at=point, turn=st.integers(-(2**15), 2**15 - 1), to=point)
outer = st.builds(
    Outer,
    flag=st.booleans(),
    big=st.integers(-(2**63), 2**63 - 1),
    letter=byte(0, 255),
    small=st.floats(width=32),
    fixed=st.lists(floats, min_size=3, max_size=3).map(np.array),
    word=text,
    inners=st.lists(inner, max_size=3),
    few=st.lists(st.integers(0, 65535), max_size=4).map(lambda v: np.array(v, dtype=np.uint16)),
    two=st.lists(text, min_size=2, max_size=2),
    pose=pose,
    flat=byte(0, 255),
    poses=st.lists(pose, max_size=3),
    one=inner,
)


def assert_same(ours, theirs):
    """Compare messages of rosbags, or values of msgs_yaml.types, with what was read."""
    if isinstance(theirs, dict):
        ours, theirs = [*ours.items()], [*theirs.items()]
    if isinstance(theirs, np.ndarray):
        np.testing.assert_allclose(ours, theirs, rtol=0.0, atol=1e-9)
    elif isinstance(theirs, (list, tuple)):
        assert len(ours) == len(theirs)
        for item, other in zip(ours, theirs):
            assert_same(item, other)
    elif hasattr(theirs, '__dataclass_fields__'):
        for name in ours._fields:
            assert_same(getattr(ours, name), getattr(theirs, name))
    else:
        assert ours == theirs or (ours != ours and theirs != theirs)


@settings(max_examples=150)
@given(message=outer, little=st.booleans())
def test_arbitrary_messages_are_read_as_rosbags_wrote_them(message, little):
    data = bytes(STORE.serialize_cdr(message, NAME, little_endian=little))
    assert_same(cdr.decode(data, TEXT, NAME), STORE.deserialize_cdr(data, NAME))


@settings(max_examples=150)
@given(message=outer, keep=st.floats(0.0, 1.0), flips=st.lists(st.integers(0, 10**6), max_size=3))
def test_broken_messages_are_refused_or_read_but_never_crash(message, keep, flips):
    data = bytearray(STORE.serialize_cdr(message, NAME))
    for bit in flips:
        data[bit // 8 % len(data)] ^= 1 << bit % 8
    data = bytes(data[: round(keep * len(data))])
    with contextlib.suppress(BagError):
        assert cdr.decode(data, TEXT, NAME)


def of_the_wire(value):
    """Return a value as a receiver has it: headings come as quaternions."""
    if isinstance(value, types.VehicleState | types.EstimatedState):
        return conversions.odometry_as_received(value)
    return value


@pytest.mark.parametrize('topic', every_message())
def test_every_route_gives_the_published_values(bag_folder, messages, topic):
    sent = [of_the_wire(value) for value in messages[topic]]
    bag = read.load(bag_folder)
    assert_same(read.values(bag, topic), sent)
    table = read.columns(bag, [topic])[topic]
    assert table.stamp_ns.tolist() == [getattr(value, 'stamp_ns', value) for value in sent]
    assert table.t_s[0] == 0.0
    assert np.diff(table.t_s) == pytest.approx(np.diff(table.stamp_ns) / 1e9)
    if topic in columns.TOPICS:
        for name, values in zip(columns.names(topic)[2:], list(zip(*sent))[1:], strict=True):
            np.testing.assert_array_equal(getattr(table, name), np.array(values), err_msg=name)
    stamp_ns = stamp_reader(bag.recordings[topic].topic.type)
    assert [*map(stamp_ns, bag.recordings[topic].payloads)] == table.stamp_ns.tolist()


@pytest.mark.parametrize('type_name', sorted({t.type for t in contract.load().topics.values()}))
def test_definition_and_hash_of_a_type_are_those_of_jazzy(type_name):
    definition = schema_text(type_name)
    store = get_typestore(Stores.EMPTY)
    store.register(get_types_from_msg(definition, type_name))
    hashes = {store.hash_rihs01(type_name), type_hash(type_name), JAZZY.hash_rihs01(type_name)}
    assert len(hashes) == 1
    named = [line for line in definition.splitlines() if line.startswith('MSG: ')]
    assert len(set(named)) == len(named)


def test_unknown_package_is_named_with_the_places_searched():
    with pytest.raises(FileNotFoundError, match=r'Nothing\.msg of package no_msgs is in none of'):
        schema_text('no_msgs/msg/Nothing')


# definitions that no recorder wrote: sound to every checksum, and told to mislead
TYPES = {name: contract.load().topics[name].type for name in (STATE, COMMAND, WHY)}
QOS = qos_text(contract.Qos('reliable', 'volatile', 'keep_last', 1))
LITTLE = b'\x00\x01\x00\x00'
NO_NUMBERS = LITTLE + bytes(2000)
CIRCLE = 'a/B b' + section('a/B', 'a/C c') + section('a/C', 'a/B b')
DEEP = 'a/T0 t' + ''.join(section(f'a/T{i}', f'a/T{i + 1} t') for i in range(2000))
MANY = 'a/T0[999] t' + ''.join(section(f'a/T{i}', f'a/T{i + 1}[999] t') for i in range(5))


def without(topic, line):
    assert line in schema_text(TYPES[topic])
    return schema_text(TYPES[topic]).replace(line, '')


@pytest.fixture
def write(tmp_path):
    """Return write(topic, type, definition, payloads, qos) -> folder of a bag with them."""

    def write(topic, type_name, text, payloads=(NO_NUMBERS,), qos=QOS):
        writer = BagWriter(tmp_path / 'bag', [BagTopic(topic, type_name, text, '', qos)], {})
        for payload in payloads:
            writer.write(0, 1, 1, payload)
        writer.close()
        return tmp_path / 'bag'

    return write


# topic, type, definition, and what is said of it
UNFIT = {
    'no package': (COMMAND, 'JointState', 'int32 x', 'is no message type'),
    'slash': (COMMAND, 'sensor_msgs/', 'int32 x', 'is no message type'),
    'section': ('/clock', 'a/A', 'a/B b' + section('B', 'int32 x'), ''),
    'missing type': ('/clock', 'a/A', 'Inner one', 'a/Inner is not in it'),
    'no array': (COMMAND, TYPES[COMMAND], without(COMMAND, 'float64[] position'), ''),
    'no seconds': (STATE, TYPES[STATE], without(STATE, 'int32 sec\n'), ''),
    'no twist': (STATE, TYPES[STATE], without(STATE, 'Vector3  angular'), ''),
    'no status': (WHY, TYPES[WHY], 'int32 x', ''),
    'count of 5000 digits': ('/clock', 'a/A', f'int8[{"9" * 5000}] x', ''),
    'wide characters': ('/clock', 'a/A', 'wstring x', 'wide characters'),
    'a type in itself': ('/clock', 'a/A', CIRCLE, 'contains itself'),
    'deep': ('/clock', 'a/A', DEEP + section('a/T2000', 'int32 x'), 'too deeply'),
    'arrays of arrays': ('/clock', 'a/A', MANY + section('a/T5', ''), ''),
}


@pytest.mark.timeout(20)
@pytest.mark.parametrize(('topic', 'type_name', 'definition', 'why'), UNFIT.values(), ids=UNFIT)
def test_definition_that_does_not_fit_is_refused(
    write, bag_folder, topic, type_name, definition, why
):
    recordings = read.load(bag_folder).recordings
    payloads = recordings[topic].payloads[:1] if topic in TYPES else [NO_NUMBERS]
    folder = write(topic, type_name, definition, payloads)
    with pytest.raises(BagError, match=f'{topic}.*{why}'):
        read.columns(folder)
    with pytest.raises(BagError, match=topic):
        read.values(folder, topic)
    assert repair.repair_bag(folder).intact


@pytest.mark.parametrize('part', ['int32 sec', 'uint32 nanosec'])
@pytest.mark.filterwarnings('error')
def test_stamp_that_is_no_whole_number_is_refused(write, part):
    changed = schema_text(TYPES[STATE]).replace(f'\n{part}', f'\nfloat64 {part.split()[1]}')
    with pytest.raises(BagError, match=r'header.stamp is of .*float64.*; allowed int32 and uint32'):
        read.columns(write(STATE, TYPES[STATE], changed))


def test_message_that_does_not_fit_its_definition_is_named(write, bag_folder):
    torn = read.load(bag_folder).recordings[WHY].payloads[0][:40]
    folder = write(WHY, TYPES[WHY], schema_text(TYPES[WHY]), [torn])
    with pytest.raises(BagError, match=r'message 0 of /controller/why: .* do not fit'):
        read.columns(folder)


def test_state_without_a_stamp_is_refused_and_counted_in_a_summary(write):
    folder = write(STATE, TYPES[STATE], schema_text(TYPES[STATE]), [b'\x00\x07no CDR'])
    with pytest.raises(BagError, match=f'message 0 of {STATE}: no CDR message'):
        read.columns(folder)
    result = summarize_bag(read.load(folder))
    assert result['invalid_messages'][STATE]['count'] == 1
    assert result['invalid_messages'][STATE]['first'].startswith('message 0: not plain CDR')
    assert (result['latency_ms'], result['ticks']) == (None, None)


def test_reserved_names_and_empty_messages_are_read():
    data = LITTLE + struct.pack('<iii', 1, 2, 3)
    assert tuple(cdr.decode(data, 'int32 from\nint32 x\nint32 x', 'a/A')) == (1, 2, 3)
    # ROS gives a message without fields one byte
    empty = 'a/B b\nuint8 x' + section('a/B', '')
    assert cdr.decode(LITTLE + b'\x00\x07', empty, 'a/A').x == 7


@pytest.mark.parametrize(
    'text',
    [
        '&a [*a]',
        '- &a {depth: &b [1]}\n- *b',
        pytest.param('[' * 400, id='brackets'),
        '!!timestamp x',
        '!!float ""',
        '9999-99-99',
    ],
)
def test_qos_that_is_none_says_nothing_and_is_no_obstacle(write, text):
    assert parse_qos(text) == []
    folder = write('/clock', 'a/A', 'int32 x', qos=text)
    (folder / 'metadata.yaml').write_text(text)
    assert repair.repair_bag(folder).wrote_metadata


ODD = {
    '{history: [1], reliability: {}, durability: 2, depth: 3}': (
        'reliable',
        'volatile',
        'keep_last',
        3,
    ),
    # of older bags
    '{history: 2, reliability: 2, durability: 1, depth: 0}': (
        'best_effort',
        'transient_local',
        'keep_all',
        DEPTH,
    ),
    '{}, x': ('reliable', 'volatile', 'keep_last', DEPTH),
}


@pytest.mark.parametrize(('profile', 'qos'), ODD.items())
def test_qos_of_odd_values_says_nothing_of_them(profile, qos):
    assert parse_qos(f'[{profile}]') == [contract.Qos(*qos)]


def test_qos_of_the_contract_is_kept():
    for topic in contract.load().topics.values():
        for qos in topic.qos.values():
            depth = qos.depth if qos.history == 'keep_last' else DEPTH
            assert parse_qos(qos_text(qos)) == [replace(qos, depth=depth)], topic.name


JOINTS = 'sensor_msgs/msg/JointState'
JointState, Header, Time = (
    JAZZY.types[name] for name in (JOINTS, 'std_msgs/msg/Header', 'builtin_interfaces/msg/Time')
)


@st.composite
def joint_states(draw):
    joints = draw(st.sampled_from([('a', 'b'), ('b', 'a'), ('steer',), ()]))
    numbers = st.lists(st.floats(-9, 9), min_size=len(joints), max_size=len(joints))
    values = [np.array(draw(numbers)) for _ in range(3)]
    frame = draw(st.sampled_from(['base_link', 'map', 'mop', '']))
    return JointState(Header(Time(draw(st.integers(0, 2**31 - 1)), 5), frame), [*joints], *values)


@settings(max_examples=100)
@given(sent=st.lists(joint_states(), min_size=1, max_size=12))
def test_messages_of_mixed_layout_keep_their_rows(sent):
    payloads = [bytes(JAZZY.serialize_cdr(message, JOINTS)) for message in sent]
    seen, layouts = [], set()
    for rows, bytes_, where in group_by_layout(payloads, schema_text(JOINTS), JOINTS):
        sec = column(bytes_, where, 'header.stamp.sec')
        assert sec.tolist() == [sent[row].header.stamp.sec for row in rows]
        first = sent[rows[0]]
        for i, joint in enumerate(first.name):
            for path in (f'effort[{i}]', f'effort[{joint}]'):
                effort = column(bytes_, where, path)
                assert effort.tolist() == [sent[row].effort[i] for row in rows]
        layouts.add((*first.name, first.header.frame_id))
        assert {(*sent[row].name, sent[row].header.frame_id) for row in rows} <= layouts
        seen += rows.tolist()
    assert sorted(seen) == list(range(len(sent)))
    # one group for each, however many messages
    assert len(layouts) == len({(*item.name, item.header.frame_id) for item in sent})


def test_a_joint_that_is_not_there_is_named_with_those_that_are():
    message = JointState(Header(Time(1, 2), 'map'), ['a'], *[np.array([0.5])] * 3)
    payloads = [bytes(JAZZY.serialize_cdr(message, JOINTS))] * 1000
    ((rows, bytes_, where),) = group_by_layout(payloads, schema_text(JOINTS), JOINTS)
    assert len(rows) == 1000
    with pytest.raises(BagError, match="no joint 'steer'; it has a"):
        column(bytes_, where, 'effort[steer]')
    with pytest.raises(BagError, match='no mass in the message'):
        column(bytes_, where, 'mass')


def test_state_sent_again_while_it_waits_for_an_answer_is_one_row(write, bag_folder):
    first, second = read.load(bag_folder).recordings[STATE].payloads[:2]
    folder = write(STATE, TYPES[STATE], schema_text(TYPES[STATE]), [first, first, first, second])
    assert read.columns(folder)[STATE].stamp_ns.tolist() == [1_000_000_000, 1_001_000_000]
    assert len(read.values(folder, STATE)) == 4


@pytest.mark.parametrize(
    ('take', 'topic', 'why'),
    [
        (read.recording, '/vehicle/odometri', "did you mean '/vehicle/odometry'"),
        (read.values, '/tf', r'no message of /tf; it has /scenario/reference, .*/clock'),
        # a known topic without messages is no misspelling
        (read.recording, '/markers/vehicle', 'no message of /markers/vehicle; it has [^?]*$'),
    ],
)
def test_missing_topic_is_refused_with_the_names_that_are_there(bag_folder, take, topic, why):
    bag = read.load(bag_folder)
    assert list(read.columns(bag, ['/clock'])) == ['/clock']
    with pytest.raises(BagError, match=why):
        take(bag, topic)
    with pytest.raises(BagError, match=f'no message of {topic}'):
        read.columns(bag, [topic])
