"""Columns taken from thousands of messages at once are those of message by message."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from rosbags.typesys import Stores, get_typestore

from bags.storage.decoding import column, group_by_layout
from bags.storage.message_definitions import schema_text

TYPE = 'sensor_msgs/msg/JointState'
STORE = get_typestore(Stores.ROS2_JAZZY)
JointState, Header, Time = (
    STORE.types[name] for name in (TYPE, 'std_msgs/msg/Header', 'builtin_interfaces/msg/Time')
)
frames = st.sampled_from(['base_link', 'map', 'mop', ''])
names = st.sampled_from([('a', 'b'), ('b', 'a'), ('steer',), ()])


@st.composite
def joint_states(draw):
    joints = draw(names)
    values = [
        np.array(draw(st.lists(st.floats(-9, 9), min_size=len(joints), max_size=len(joints))))
        for _ in range(3)
    ]
    header = Header(Time(draw(st.integers(0, 2**31 - 1)), 5), draw(frames))
    return JointState(header, list(joints), *values)


@settings(max_examples=100)
@given(sent=st.lists(joint_states(), min_size=1, max_size=12))
def test_messages_of_mixed_layout_keep_their_rows(sent):
    payloads = [bytes(STORE.serialize_cdr(message, TYPE)) for message in sent]
    rows_seen = []
    for rows, bytes_, where in group_by_layout(payloads, schema_text(TYPE), TYPE):
        sec = column(bytes_, where, 'header.stamp.sec')
        assert sec.tolist() == [sent[row].header.stamp.sec for row in rows]
        for row in rows:
            joints = [where.strings[f'name[{i}]'] for i in range(len(sent[row].name))]
            assert joints == sent[row].name
            assert where.strings['header.frame_id'] == sent[row].header.frame_id
        for i in range(len(sent[rows[0]].name)):
            effort = column(bytes_, where, f'effort[{i}]')
            assert effort.tolist() == [sent[row].effort[i] for row in rows]
        rows_seen += rows.tolist()
    assert sorted(rows_seen) == list(range(len(sent)))


def test_constant_names_make_one_group():
    message = JointState(Header(Time(1, 2), 'map'), ['a'], *[np.array([0.5])] * 3)
    payloads = [bytes(STORE.serialize_cdr(message, TYPE))] * 1000
    assert len(list(group_by_layout(payloads, schema_text(TYPE), TYPE))) == 1
