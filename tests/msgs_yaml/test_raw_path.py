"""A path read from its bytes is that of its message; one sent again is the one made anew."""

import random

import facts
import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from msgs_yaml import decode, encode, raw_path
from msgs_yaml.decode import DecodeError
from node_runtime import facts_node, ros

TOPIC = raw_path.TOPIC
MOST_NS = 2**32 - 1  # that a message can hold beside the seconds
SHORT = facts.path(poses=4)


def slowly(raw):
    """Return what the message of the bytes says."""
    return decode.reference(ros.message(TOPIC, raw))


def outcome(read, raw):
    """Return what is read, or the error for which it is not."""
    try:
        return read(raw)
    except DecodeError as error:
        return error


@pytest.mark.parametrize('poses', [2, 3, 51, 5000])
@pytest.mark.parametrize('stamp_ns', [1, facts.LATER_NS])
def test_bytes_and_message_say_the_same_to_the_last_bit(poses, stamp_ns):
    raw = facts.raw_path(poses=poses, stamp_ns=stamp_ns)
    found = raw_path.read(raw)
    assert facts.same(found, slowly(raw))
    assert type(found.stamp_ns) is int


@pytest.mark.parametrize('seed', range(300))
def test_harmed_bytes_are_read_or_refused_as_their_message_is(seed):
    chance = random.Random(seed)
    raw = bytearray(ros.serialized(encode.reference(SHORT)))
    for _ in range(chance.randint(1, 3)):
        raw[chance.randrange(len(raw))] ^= 1 << chance.randrange(8)
    if seed % 10 == 0:
        del raw[chance.randrange(len(raw)) :]
    raw = bytes(raw)
    expected, found = outcome(slowly, raw), outcome(facts_node.read_reference, raw)
    if isinstance(expected, DecodeError):
        assert raw_path.read(raw) is None
        assert type(found) is DecodeError
        assert str(found) == str(expected)
    else:
        assert facts.same(found, expected)


@settings(deadline=None, derandomize=True)
@given(
    sec=st.lists(st.integers(-6, 3), min_size=1, max_size=5),
    nanosec=st.integers(0, MOST_NS),
)
@example(sec=[-1], nanosec=1_500_000_000)
@example(sec=[1, -1, 3], nanosec=4_000_000_000)
def test_any_stamp_is_read_or_refused_as_that_of_the_message_is(sec, nanosec):
    message = encode.reference(SHORT)
    for k, header in enumerate((message.header, *(one.header for one in message.poses))):
        header.stamp.sec = sec[min(k, len(sec) - 1)]
        header.stamp.nanosec = min(nanosec + k, MOST_NS)
    raw = ros.serialized(message)
    expected, found = outcome(slowly, raw), raw_path.read(raw)
    if isinstance(expected, DecodeError):
        assert found is None
    else:
        assert facts.same(outcome(facts_node.read_reference, raw), expected)


@pytest.mark.parametrize(
    ('changed', 'says'),
    [
        ({'X': SHORT.X * np.nan}, r'poses\[\*\].pose.position.x \(X\) is nan'),
        ({'Y': SHORT.Y - 20_000.0}, r'poses\[\*\].pose.position.y'),
        ({'t': SHORT.t[::-1]}, r'poses\[1\].header.stamp'),
        ({'t': SHORT.t * 0.0}, r'poses\[1\].header.stamp'),
        ({'stamp_ns': 0}, r'header.stamp is 0.0* s'),
    ],
)
def test_a_path_that_breaks_the_contract_is_refused_with_its_reason(changed, says):
    raw = ros.serialized(encode.reference(SHORT._replace(**changed)))
    assert raw_path.read(raw) is None
    with pytest.raises(DecodeError, match=says):
        facts_node.read_reference(raw)


@pytest.mark.parametrize('frame', ['odom', 'mop'])
def test_another_frame_is_refused(frame):
    message = encode.reference(SHORT)
    message.poses[2].header.frame_id = frame
    with pytest.raises(DecodeError, match=f"frame_id is '{frame}'; allowed 'map'"):
        facts_node.read_reference(ros.serialized(message))


@pytest.mark.parametrize('poses', [2, 5000])
def test_another_stamp_gives_the_message_made_anew(poses):
    before = facts.raw_path(poses=poses)
    after = raw_path.restamped(before, facts.LATER_NS)
    anew = facts.raw_path(poses=poses, stamp_ns=facts.LATER_NS)
    assert ros.message(TOPIC, after) == ros.message(TOPIC, anew)


def test_what_is_no_path_gets_no_stamp():
    with pytest.raises(ValueError, match='no serialised /scenario/reference'):
        raw_path.restamped(facts.raw_path(poses=4)[:-1], facts.S)


def test_the_longest_path_takes_a_tenth_of_the_time_of_its_message():
    raw, path = facts.raw_path(), facts.path()
    read_s = facts.processor_s(lambda: facts_node.read_reference(raw))
    assert read_s < 0.1 * facts.processor_s(lambda: slowly(raw), 2)
    sent_s = facts.processor_s(lambda: raw_path.restamped(raw, facts.S))
    assert sent_s < 0.1 * facts.processor_s(lambda: ros.serialized(encode.reference(path)), 2)
