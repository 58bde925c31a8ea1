"""The own CDR reader agrees with rosbags, on the wire's messages and on arbitrary ones."""

import contextlib

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from bags.errors import BagError
from bags.storage import cdr, read
from msgs_yaml import contract

POINT = 'float64 x\nuint8 y\n'
POSE = 'Point at\nint16 turn\nPoint to\n'
INNER = 'uint8 level\nfloat64[] numbers\nstring name\n'
TEXT = (
    'int8 RED = 1\nbool flag\nint64 big\nchar letter\nfloat32 small\nfloat64[3] fixed\n'
    'string<=20 word "none"\nInner[] inners  # several\nuint16[<=4] few\nstring[2] two\n'
    'Pose pose\nuint8 flat\nPose[] poses\nInner one\n'
    f'{"=" * 80}\nMSG: test_msgs/Inner\n{INNER}'
    f'{"=" * 80}\nMSG: test_msgs/Point\n{POINT}'
    f'{"=" * 80}\nMSG: test_msgs/Pose\n{POSE}'
)
NAME = 'test_msgs/msg/Outer'
STORE = get_typestore(Stores.EMPTY)
STORE.register(get_types_from_msg(TEXT, NAME))
Outer, Inner, Point, Pose = (
    STORE.types[f'test_msgs/msg/{name}'] for name in ('Outer', 'Inner', 'Point', 'Pose')
)

text = st.text(max_size=6).filter(lambda s: '\0' not in s)
floats = st.floats(allow_nan=False)
inner = st.builds(
    Inner,
    level=st.integers(0, 255),
    numbers=st.lists(floats, max_size=3).map(np.array),
    name=text,
)
point = st.builds(Point, x=floats, y=st.integers(0, 255))
pose = st.builds(Pose, at=point, turn=st.integers(-(2**15), 2**15 - 1), to=point)
outer = st.builds(
    Outer,
    flag=st.booleans(),
    big=st.integers(-(2**63), 2**63 - 1),
    letter=st.integers(0, 255),
    small=st.floats(width=32, allow_nan=False),
    fixed=st.lists(floats, min_size=3, max_size=3).map(np.array),
    word=text,
    inners=st.lists(inner, max_size=3),
    few=st.lists(st.integers(0, 65535), max_size=4).map(lambda v: np.array(v, dtype=np.uint16)),
    two=st.lists(text, min_size=2, max_size=2),
    pose=pose,
    flat=st.integers(0, 255),
    poses=st.lists(pose, max_size=3),
    one=inner,
)


def assert_same(ours, theirs):
    """Every field of a message of rosbags is in the named tuple."""
    if isinstance(theirs, np.ndarray):
        assert list(ours) == theirs.tolist()
    elif isinstance(theirs, list):
        assert len(ours) == len(theirs)
        for item, other in zip(ours, theirs):
            assert_same(item, other)
    elif hasattr(theirs, '__dataclass_fields__'):
        for name in ours._fields:
            assert_same(getattr(ours, name), getattr(theirs, name))
    else:
        assert ours == theirs


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


def test_messages_of_the_wire_are_read_as_rosbags_reads_them(bag_folder):
    recordings = read.load(bag_folder).recordings
    observed = dict.fromkeys(recordings, 0)
    with AnyReader([bag_folder]) as reader:
        for connection, _, data in reader.messages():
            if observed[connection.topic] < 20:
                observed[connection.topic] += 1
                topic = recordings[connection.topic].topic
                ours = cdr.decode(bytes(data), topic.schema, topic.type)
                assert_same(ours, reader.deserialize(data, connection.msgtype))
    every = {name for name, topic in contract.load().topics.items() if not topic.on_request}
    assert all(observed[name] for name in every)


def test_definition_that_lacks_a_type_is_refused():
    with pytest.raises(BagError, match='test_msgs/Inner is not in it'):
        cdr.decode(b'\0\1\0\0', 'Inner one\n', NAME)


def test_definition_that_contains_itself_is_refused():
    text = f'Inner one\n{"=" * 80}\nMSG: test_msgs/Inner\nbool flag\nInner again\n'
    with pytest.raises(BagError, match='test_msgs/Inner contains itself'):
        cdr.decode(b'\0\1\0\0', text, NAME)


def test_other_encapsulations_than_plain_cdr_are_refused():
    with pytest.raises(BagError, match='not plain CDR'):
        cdr.decode(b'\0\7\0\0\1', TEXT, NAME)
