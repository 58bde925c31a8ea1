"""Paths and edges read from their bytes are those of their message, and are restamped like it."""

import random
from collections.abc import Callable
from typing import NamedTuple

import long_paths
import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from std_msgs.msg import ColorRGBA

from msgs_yaml import decode, encode, raw_scenario
from msgs_yaml.decode import DecodeError
from msgs_yaml.types import Reference
from node_runtime import ros, subscriptions_node

S = 1_000_000_000
MAX_NANOSEC = 2**32 - 1  # that the field of a message can hold


class Kind(NamedTuple):
    """The functions of one topic: fast on bytes, and by way of the message."""

    topic: str
    make: Callable  # (number of poses or points, stamp_ns=...) -> value
    encode: Callable
    decode: Callable
    fast: Callable  # None for what it does not understand
    bounded: Callable  # as a node reads it
    restamp: Callable

    def raw(self, *given, **named):
        return ros.serialize(self.encode(self.make(*given, **named)))

    def slow(self, raw):
        """Return the value of the deserialised message."""
        return self.decode(ros.deserialize(self.topic, raw))


PATH = Kind(
    raw_scenario.REFERENCE,
    long_paths.path,
    encode.reference,
    decode.reference,
    raw_scenario.read_reference,
    subscriptions_node.read_reference,
    raw_scenario.restamp_reference,
)
EDGES = Kind(
    raw_scenario.ROAD_EDGES,
    long_paths.edges,
    encode.road_edges,
    decode.road_edges,
    raw_scenario.read_road_edges,
    subscriptions_node.read_road_edges,
    raw_scenario.restamp_road_edges,
)
SHORT = {PATH: long_paths.path(4), EDGES: long_paths.edges(3)}
both = pytest.mark.parametrize('kind', [PATH, EDGES], ids=['path', 'edges'])


def outcome(read, raw):
    """Return what is read, or the DecodeError."""
    try:
        return read(raw)
    except DecodeError as error:
        return error


@both
@pytest.mark.parametrize('number', [2, 3, 51, 5000])
@pytest.mark.parametrize('stamp_ns', [1, long_paths.LATER_NS])
def test_bytes_and_message_have_the_same_value_to_the_last_bit(kind, number, stamp_ns):
    raw = kind.raw(number, stamp_ns=stamp_ns)
    value = kind.fast(raw)
    assert long_paths.are_equal(value, kind.slow(raw))
    assert type(value.stamp_ns) is int


@both
@pytest.mark.parametrize('seed', range(300))
def test_damaged_bytes_are_read_or_rejected_as_their_message_is(kind, seed):
    chance = random.Random(seed)
    raw = bytearray(ros.serialize(kind.encode(SHORT[kind])))
    for _ in range(chance.randint(1, 3)):
        raw[chance.randrange(len(raw))] ^= 1 << chance.randrange(8)
    if seed % 10 == 0:
        del raw[chance.randrange(len(raw)) :]
    raw = bytes(raw)
    expected, result = outcome(kind.slow, raw), outcome(kind.bounded, raw)
    if isinstance(expected, DecodeError):
        assert kind.fast(raw) is None
        assert type(result) is DecodeError
        assert kind is EDGES or str(result) == str(expected)
    else:
        assert long_paths.are_equal(result, expected)


def check_stamps(kind, message, headers, sec, nanosec):
    """Check that a message with these stamps is read or rejected alike from bytes and object."""
    for k, header in enumerate(headers):
        header.stamp.sec = sec[min(k, len(sec) - 1)]
        header.stamp.nanosec = nanosec[k]
    raw = ros.serialize(message)
    expected = outcome(kind.slow, raw)
    if isinstance(expected, DecodeError):
        assert kind.fast(raw) is None
    else:
        assert long_paths.are_equal(outcome(kind.bounded, raw), expected)


@given(
    sec=st.lists(st.integers(-6, 3), min_size=1, max_size=5),
    nanosec=st.integers(0, MAX_NANOSEC),
)
@example(sec=[-1], nanosec=1_500_000_000)
@example(sec=[1, -1, 3], nanosec=4_000_000_000)
def test_any_stamp_of_a_path_is_read_or_rejected_as_that_of_the_message_is(sec, nanosec):
    message = encode.reference(SHORT[PATH])
    headers = (message.header, *(pose.header for pose in message.poses))
    increasing = [min(nanosec + k, MAX_NANOSEC) for k in range(len(headers))]
    check_stamps(PATH, message, headers, sec, increasing)


@pytest.mark.parametrize('now_ns', [1, 1_795_000_000_987_654_321])
@pytest.mark.parametrize('sec', [0, 1, 1_795_000_000])
def test_poses_of_one_stamp_are_read_as_those_of_the_message_and_repeat(now_ns, sec):
    message = encode.reference(SHORT[PATH]._replace(stamp_ns=now_ns))
    for pose in message.poses:
        pose.header.stamp.sec, pose.header.stamp.nanosec = sec, 0
    raw = ros.serialize(message)
    assert long_paths.are_equal(PATH.fast(raw), PATH.slow(raw))
    assert not PATH.fast(raw).t.any()
    if not sec:  # as planners send them again
        message.header.stamp.sec += 1
        later = ros.serialize(message)
        assert raw_scenario.repeated_ns(raw_scenario.REFERENCE, later, raw) == now_ns + 10**9


@given(
    sec=st.lists(st.integers(-6, 3), min_size=2, max_size=2),
    nanosec=st.integers(0, MAX_NANOSEC),
)
@example(sec=[-1, -1], nanosec=1_500_000_000)
@example(sec=[1, -1], nanosec=4_000_000_000)
def test_any_stamp_of_edges_is_read_or_rejected_as_that_of_the_message_is(sec, nanosec):
    message = encode.road_edges(SHORT[EDGES])
    check_stamps(EDGES, message, [m.header for m in message.markers], sec, [nanosec] * 2)


@pytest.mark.parametrize(
    ('changed', 'error'),
    [
        ({'X': SHORT[PATH].X * np.nan}, r'poses\[\*\].pose.position.x \(X\) is nan'),
        ({'Y': SHORT[PATH].Y - 20_000.0}, r'poses\[\*\].pose.position.y'),
        ({'t': SHORT[PATH].t[::-1]}, r'poses\[1\].header.stamp'),
        ({'stamp_ns': 0}, r'header.stamp is 0.0* s'),
    ],
)
def test_a_path_that_violates_the_contract_is_rejected_with_its_reason(changed, error):
    raw = ros.serialize(encode.reference(SHORT[PATH]._replace(**changed)))
    assert raw_scenario.read_reference(raw) is None
    with pytest.raises(DecodeError, match=error):
        subscriptions_node.read_reference(raw)


@pytest.mark.parametrize(
    ('name', 'value', 'error'),
    [
        ('ns', 'right', 'markers are both'),
        ('ns', 'middle', "ns is 'middle'"),
        ('type', 5, 'type is 5'),
        ('action', 2, 'action is 2'),
        ('points', [], '0 long'),
    ],
)
def test_edges_that_violate_the_contract_are_rejected_with_their_reason(name, value, error):
    message = encode.road_edges(SHORT[EDGES])
    setattr(message.markers[0], name, value)
    raw = ros.serialize(message)
    assert raw_scenario.read_road_edges(raw) is None
    with pytest.raises(DecodeError, match=error):
        subscriptions_node.read_road_edges(raw)


@pytest.mark.parametrize('frame', ['odom', 'mop'])
def test_a_path_in_another_frame_is_rejected(frame):
    message = encode.reference(SHORT[PATH])
    message.poses[2].header.frame_id = frame
    with pytest.raises(DecodeError, match=f"frame_id is '{frame}'; allowed 'map'"):
        subscriptions_node.read_reference(ros.serialize(message))


@pytest.mark.parametrize('left', ['', 'a', 'text', 'longer text'])
def test_fields_of_a_marker_that_do_not_matter_may_hold_anything(left):
    message = encode.road_edges(SHORT[EDGES])
    for marker, text in zip(message.markers, (left, 'right')):
        marker.colors = [ColorRGBA(r=1.0)] * 3
        marker.text = marker.mesh_resource = marker.texture_resource = text
        marker.texture.format, marker.texture.data = text, text.encode()
        marker.mesh_file.filename, marker.mesh_file.data = text, text.encode()
        marker.frame_locked = marker.mesh_use_embedded_materials = True
    raw = ros.serialize(message)
    assert long_paths.are_equal(raw_scenario.read_road_edges(raw), EDGES.slow(raw))
    after = raw_scenario.restamp_road_edges(raw, long_paths.LATER_NS)
    assert EDGES.slow(after).stamp_ns == long_paths.LATER_NS


def test_the_order_of_the_sides_does_not_matter():
    message = encode.road_edges(SHORT[EDGES])
    message.markers.reverse()
    assert long_paths.are_equal(raw_scenario.read_road_edges(ros.serialize(message)), SHORT[EDGES])


@both
@pytest.mark.parametrize('number', [2, 5000])
def test_restamping_gives_the_message_built_anew(kind, number):
    after = kind.restamp(kind.raw(number), long_paths.LATER_NS)
    anew = kind.raw(number, stamp_ns=long_paths.LATER_NS)
    assert ros.deserialize(kind.topic, after) == ros.deserialize(kind.topic, anew)


@both
@pytest.mark.parametrize('cut', [1, 20])
def test_other_bytes_are_not_restamped(kind, cut):
    with pytest.raises(ValueError, match=f'no serialised {kind.topic}'):
        kind.restamp(kind.raw(4)[:-cut], long_paths.S)


@both
def test_the_longest_message_takes_a_tenth_of_the_time_of_its_object(kind):
    raw, value = kind.raw(), kind.make()
    read_s = long_paths.min_cpu_s(lambda: kind.bounded(raw))
    assert read_s < 0.1 * long_paths.min_cpu_s(lambda: kind.slow(raw), 2)
    sent_s = long_paths.min_cpu_s(lambda: kind.restamp(raw, long_paths.S))
    assert sent_s < 0.1 * long_paths.min_cpu_s(lambda: ros.serialize(kind.encode(value)), 2)


REPEATED = Reference(
    5 * S + 3,
    np.array([0.0, 1.0, 2.0, 4.0]),
    np.array([0.0, 0.0, 0.1, 0.2]),
    np.array([0.0, 0.1, 0.1, 0.0]),
    np.array([0.0, 0.05, 0.1, 0.9]),
)


def is_repeat(new, old):
    return raw_scenario.repeated_ns(raw_scenario.REFERENCE, new, old) > 0


def raw_path(**changed):
    return ros.serialize(encode.reference(REPEATED._replace(**changed)))


@pytest.mark.parametrize(
    'stamp_ns', [REPEATED.stamp_ns, REPEATED.stamp_ns - S, 1_795_000_000_987_654_321]
)
def test_the_same_poses_at_another_time_are_a_repeat(stamp_ns):
    later = raw_path(stamp_ns=stamp_ns)
    assert raw_scenario.repeated_ns(raw_scenario.REFERENCE, later, raw_path()) == stamp_ns


def test_the_padding_before_the_first_pose_does_not_count():
    raw = bytearray(raw_path(stamp_ns=9 * S))
    raw[raw_scenario.PADDING] = b'\x5a\x01\xff\x33'
    assert is_repeat(bytes(raw), raw_path())


def test_two_poses_are_enough():
    short = {name: getattr(REPEATED, name)[:2] for name in ('X', 'Y', 'psi', 't')}
    assert is_repeat(raw_path(**short, stamp_ns=9 * S), raw_path(**short))
    assert not is_repeat(raw_path(**short), raw_path())


@pytest.mark.parametrize('index', range(4))
@pytest.mark.parametrize('name', ['X', 'Y', 'psi'])
def test_a_pose_that_moved_by_the_least_bit_is_another_path(name, index):
    column = getattr(REPEATED, name).copy()
    column[index] = np.nextafter(column[index] + 0.1, 9.0)
    assert not is_repeat(raw_path(**{name: column}), raw_path())


@pytest.mark.parametrize('index', [1, 3])
def test_another_speed_is_another_path(index):
    t = REPEATED.t.copy()
    t[index] += 1e-9
    assert not is_repeat(raw_path(t=t), raw_path())


@pytest.mark.parametrize('byte', [0, 12, 16, 20, 32, 36, 112, 116])
def test_a_path_with_another_layout_count_or_frame_is_no_repeat(byte):
    broken = bytearray(raw_path())
    broken[byte] ^= 1
    assert not is_repeat(bytes(broken), raw_path())


@both
@pytest.mark.parametrize('cut', [0, 4, 50, -72, -1])
def test_a_cut_or_first_message_is_no_repeat(kind, cut):
    raw = kind.raw(4)
    assert not raw_scenario.repeated_ns(kind.topic, raw, None)
    assert not raw_scenario.repeated_ns(kind.topic, raw[:cut], raw[:cut])


def repeated_edges_ns(message):
    raw = ros.serialize(message)
    return raw_scenario.repeated_ns(raw_scenario.ROAD_EDGES, raw, EDGES.raw(3))


def test_the_same_edges_at_another_time_are_a_repeat():
    assert repeated_edges_ns(encode.road_edges(long_paths.edges(3, 9 * S))) == 9 * S


@pytest.mark.parametrize(
    'change',
    [
        lambda left: setattr(left.points[1], 'y', np.nextafter(left.points[1].y, 9.0)),
        lambda left: setattr(left.header.stamp, 'nanosec', 4),
        lambda left: setattr(left.header, 'frame_id', 'mop'),
        lambda left: setattr(left, 'ns', 'lefd'),
        lambda left: setattr(left, 'action', 2),
    ],
    ids=['point', 'stamp', 'frame', 'ns', 'action'],
)
def test_edges_of_which_one_differs_are_no_repeat(change):
    message = encode.road_edges(SHORT[EDGES])
    change(message.markers[1])
    assert not repeated_edges_ns(message)


@pytest.mark.parametrize('poses', [2, 51, 5000])
def test_the_size_of_a_serialised_path_is_computed_without_building_it(poses):
    X = np.arange(float(poses))
    message = encode.reference(Reference(1, X, 0 * X, 0 * X, X))
    assert len(ros.serialize(message)) == raw_scenario.reference_size(poses)
