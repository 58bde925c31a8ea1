"""What is encoded, sent and decoded is what was meant, whichever library reads the message."""

import math
import struct

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.records import Schema
from mcap_ros2.decoder import DecoderFactory
from rclpy.serialization import deserialize_message, serialize_message
from rosbags.serde import SerdeError
from rosbags.typesys import Stores, get_typestore

from msgs_yaml import contract, conversions, decode, encode, types
from node_runtime import ros

PADDING = 8  # serialize_message may leave so many bytes of junk behind a message
STORE = get_typestore(Stores.ROS2_JAZZY)


def exact(message, kind):
    """Return a serialised message without the junk behind it, and what rosbags reads in it."""
    raw = serialize_message(message)
    for length in range(len(raw), len(raw) - PADDING - 1, -1):
        try:
            return raw[:length], STORE.deserialize_cdr(raw[:length], kind)
        except (SerdeError, struct.error, IndexError, ValueError):
            continue
    raise AssertionError(f'rosbags reads no {kind} in {raw!r}')


def by_object(message, kind):
    return message


def by_rclpy(message, kind):
    return deserialize_message(serialize_message(message), type(message))


def by_rosbags(message, kind):
    return exact(message, kind)[1]


def by_mcap(message, kind):
    text, _ = STORE.generate_msgdef(kind, ros_version=2)
    schema = Schema(id=1, name=kind, encoding='ros2msg', data=text.encode())
    return DecoderFactory().decoder_for('cdr', schema)(exact(message, kind)[0])


def number(low, high):
    return st.floats(low, high, allow_nan=False)


def four(low, high):
    return st.tuples(*[number(low, high)] * 4)


STAMP = st.integers(1, (2**31 - 200) * 10**9)
METRES = number(-1e4, 1e4)
ANGLE = number(-math.pi, math.pi).filter(lambda psi: psi > -math.pi)
STEER, FORCE, TORQUE = number(-1.2, 1.2), number(-6e4, 6e4), number(-2e4, 2e4)
KEYS = st.text('abcdefgh._', min_size=1, max_size=12)
TOLD = st.one_of(
    st.booleans(), st.integers(), st.floats(allow_nan=False), st.sampled_from(['', 'solved', 'a b'])
)
VALUES = st.dictionaries(KEYS, TOLD, max_size=12)


@st.composite
def paths(draw, cls, least):
    n = draw(st.integers(least, 12))
    steps = draw(st.lists(st.integers(1, 3 * 10**9), min_size=n - 1, max_size=n - 1))
    t = np.cumsum([0, *steps]) / 1e9
    X, Y = (draw(st.lists(METRES, min_size=n, max_size=n)) for _ in 'XY')
    turns = draw(st.lists(number(-3, 3), min_size=n, max_size=n))
    return cls(draw(STAMP), np.array(X), np.array(Y), np.cumsum(turns), t)


def lines():
    points = st.lists(st.tuples(METRES, METRES), min_size=2, max_size=9)
    return points.map(lambda pairs: np.array(pairs))


def obstacles():
    speed = number(-100, 100)
    one = st.builds(
        types.Obstacle, st.integers(0, 99), METRES, METRES, number(0.01, 50), speed, speed
    )
    return st.lists(one, max_size=6, unique_by=lambda obstacle: obstacle.id).map(tuple)


RATE = number(-10, 10)
SPEED = number(-20, 60)
FORMS = {
    '/vehicle/odometry': st.builds(
        types.VehicleState, STAMP, METRES, METRES, ANGLE, SPEED, SPEED, RATE
    ),
    '/vehicle/imu': st.builds(types.Imu, STAMP, number(-99, 99), number(-99, 99), RATE, RATE),
    '/vehicle/actuators': st.builds(
        types.Actuators, STAMP, STEER, RATE, FORCE, FORCE, four(-2e4, 2e4)
    ),
    '/vehicle/wheels': st.builds(
        types.Wheels,
        STAMP,
        four(-200, 600),
        four(-2e4, 2e4),
        four(0, 6e4),
        four(-100, 100),
        four(-6e4, 6e4),
        four(-3.2, 3.2),
        four(-6e4, 6e4),
    ),
    '/controller/command': st.builds(types.Command, STAMP, STEER, RATE, FORCE, FORCE),
    '/scenario/reference': paths(types.Reference, 2),
    '/controller/prediction': paths(types.Prediction, 1),
    '/scenario/road_edges': st.builds(types.RoadEdges, STAMP, lines(), lines()),
    '/scenario/obstacles': st.builds(types.Obstacles, STAMP, obstacles(), st.just(())),
    '/controller/why': st.builds(
        types.Why, STAMP, st.integers(0, 2), st.text('ab é', max_size=9), VALUES
    ),
    '/diagnostics': st.builds(
        types.Health, STAMP, KEYS, st.integers(0, 3), st.text('ab é', max_size=9), VALUES
    ),
    '/clock': STAMP,
    '/vehicle/run_start': st.one_of(st.just(0), STAMP),
}
NAMES = {topic: topic.rsplit('/', 1)[1] for topic in FORMS} | {'/diagnostics': 'health'}


def same(a, b):
    """Tell whether two values are equal to the last bit, types included."""
    if isinstance(a, np.ndarray):
        return isinstance(b, np.ndarray) and a.dtype == b.dtype and np.array_equal(a, b)
    if isinstance(a, dict):
        return list(a) == list(b) and all(same(a[key], b[key]) for key in a)
    if isinstance(a, tuple):
        return type(a) is type(b) and len(a) == len(b) and all(map(same, a, b))
    return type(a) is type(b) and a == b


@pytest.mark.parametrize('route', [by_object, by_rclpy, by_rosbags, by_mcap])
@pytest.mark.parametrize('topic', sorted(FORMS))
def test_decoding_undoes_encoding_to_the_last_bit(topic, route):
    name, kind = NAMES[topic], contract.load().topics[topic].type
    # a message of /diagnostics may have several statuses
    unchanged = (lambda value: (value,)) if topic == '/diagnostics' else lambda value: value
    received = getattr(conversions, f'{name}_as_received', unchanged)

    @settings(max_examples=25)
    @given(FORMS[topic])
    def check(value):
        message = getattr(encode, name)(value)
        assert isinstance(message, ros.message_type(topic))
        assert same(getattr(decode, name)(route(message, kind)), received(value))

    check()


def test_every_topic_is_tested():
    topics = contract.load().topics.values()
    assert set(FORMS) == {topic.name for topic in topics if not topic.on_request}


@given(FORMS['/vehicle/odometry'])
def test_the_round_trip_changes_a_heading_by_rounding_only(state):
    received = conversions.odometry_as_received(state)
    assert abs(conversions.wrap_angle(received.psi - state.psi)) <= 1e-15
    assert received._replace(psi=state.psi) == state


@given(FORMS['/scenario/reference'])
def test_the_round_trip_keeps_times_to_a_nanosecond_and_headings_up_to_full_turns(path):
    received = conversions.reference_as_received(path)
    assert np.max(np.abs(received.t - path.t)) <= 1e-9
    turns = (received.psi - path.psi) / math.tau
    assert np.allclose(turns, np.round(turns[0]), atol=1e-13)
    assert -math.pi < received.psi[0] <= math.pi


@pytest.mark.parametrize('topic', ['/vehicle/odometry', '/controller/command', '/vehicle/imu'])
def test_the_stamp_is_read_from_the_bytes_alone(topic):
    @settings(max_examples=25)
    @given(FORMS[topic])
    def check(value):
        raw = serialize_message(getattr(encode, NAMES[topic])(value))
        assert decode.stamp_ns_of(raw) == value.stamp_ns

    check()


def test_the_stamp_of_big_endian_bytes_is_read_too():
    raw = b'\x00\x00\x00\x00' + struct.pack('>iI', 7, 5) + bytes(8)
    assert decode.stamp_ns_of(raw) == 7_000_000_005


@pytest.mark.parametrize('raw', [b'', b'\x00\x01\x00\x00', b'\x00\x09\x00\x00' + bytes(20)])
def test_bytes_without_a_stamp_are_rejected(raw):
    with pytest.raises(decode.DecodeError, match='no CDR message'):
        decode.stamp_ns_of(raw)
