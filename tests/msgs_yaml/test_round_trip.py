"""What is encoded, sent and decoded is what was meant, whichever library or shortcut reads it."""

import math
import struct

import numpy as np
import pytest
from example_messages import FAST, canonical, decoded, encoded, load_example, ros_types
from hypothesis import example, given, settings
from hypothesis import strategies as st
from mcap.records import Schema
from mcap_ros2.decoder import DecoderFactory
from rclpy.serialization import serialize_message

from msgs_yaml import contract, conversions, decode, flat_fields, types
from msgs_yaml.decode import DecodeError
from node_runtime import ros, subscriptions_node

MAX_NANOSEC = 2**32 - 1  # that the field of a message can hold


def routes(topic):
    """Return functions of a message and its bytes that return its value, by who reads it."""
    kind = contract.load().topics[topic].type
    text, _ = ros_types().generate_msgdef(kind, ros_version=2)
    schema = Schema(id=1, name=kind, encoding='ros2msg', data=text.encode())
    mcap = DecoderFactory().decoder_for('cdr', schema)
    ways = {
        'object': lambda message, raw: decoded(topic, message),
        'rclpy': lambda message, raw: decoded(topic, ros.deserialize(topic, raw)),
        'rosbags': lambda message, raw: decoded(topic, ros_types().deserialize_cdr(raw, kind)),
        'mcap': lambda message, raw: decoded(topic, mcap(raw)),
    }
    if topic in FAST:
        ways['bytes'] = lambda message, raw: FAST[topic](raw)
    return ways


def number(low, high):
    return st.floats(low, high, allow_nan=False)


def flat(topic, stamp, heading, any_number=None):
    """Return values of a topic of fixed size, of numbers within its ranges or of any."""
    fields, parts = contract.load().topics[topic].fields, []
    for paths in flat_fields.load(topic).columns.values():
        field = fields[paths[0]]
        one = number(field.low, field.high) if any_number is None else any_number
        if 'orientation' in paths[0]:
            one = heading
        parts.append(st.tuples(*[one] * 4) if len(paths) == 4 else one)
    return st.builds(flat_fields.TYPES[topic], stamp, *parts)


STAMP = st.integers(1, (2**31 - 200) * 10**9)
METRES, SPEED = number(-1e4, 1e4), number(-20, 60)
ANGLE = number(-math.pi, math.pi).filter(lambda psi: psi > -math.pi)
STEER, FORCE = number(-1.2, 1.2), number(-6e4, 6e4)
KEYS = st.text('abcdefgh._', min_size=1, max_size=12)
TOLD = st.one_of(
    st.booleans(), st.integers(), st.floats(allow_nan=False), st.sampled_from(['', 'solved', 'a b'])
)
VALUES = st.dictionaries(KEYS, TOLD, max_size=12)
TEXT = st.text('ab é', max_size=9)
LINE = st.lists(st.tuples(METRES, METRES), min_size=2, max_size=9).map(np.array)
PLACE = st.tuples(number(-100, 100), number(-100, 100))
OBSTACLE = st.builds(
    types.Obstacle,
    *(st.integers(0, 99), METRES, METRES, number(0.01, 50), SPEED, SPEED),
    st.lists(PLACE, max_size=15).map(tuple),
)


@st.composite
def paths(draw, cls, least):
    n = draw(st.integers(least, 12))
    steps = draw(st.lists(st.integers(1, 3 * 10**9), min_size=n - 1, max_size=n - 1))
    X, Y = (draw(st.lists(METRES, min_size=n, max_size=n)) for _ in 'XY')
    turns = draw(st.lists(number(-3, 3), min_size=n, max_size=n))
    t = np.cumsum([0, *steps]) / 1e9
    return cls(draw(STAMP), np.array(X), np.array(Y), np.cumsum(turns), t)


@st.composite
def branches(draw):
    n = draw(st.integers(1, 6))
    t = np.cumsum(draw(st.lists(number(0.01, 5.0), min_size=n, max_size=n)))
    X, Y = (np.array(draw(st.lists(METRES, min_size=n, max_size=n))) for _ in 'XY')
    roots = draw(st.lists(st.tuples(*[number(-30, 30)] * 3), min_size=n, max_size=n))
    L = np.array([[[a, 0.0], [b, c]] for a, b, c in roots])
    return types.Branch(0, draw(number(0.0, 0.2)), t, X, Y, L @ L.transpose(0, 2, 1))


@st.composite
def stop_plans(draw):
    point = st.tuples(st.integers(1, 10**9), STEER, FORCE, FORCE)
    steps, *joints = np.array(draw(st.lists(point, min_size=1, max_size=9))).T.copy()
    return types.StopPlan(draw(STAMP), np.cumsum(steps) / 1e9, *joints)


PREDICTIONS = '/scenario/predictions'
BRANCHES = st.lists(branches(), min_size=1, max_size=4).map(tuple)
FORMS = {
    PREDICTIONS: st.builds(
        types.Predictions,
        STAMP,
        st.dictionaries(st.integers(0, 2**31 - 1), BRANCHES, max_size=3),
        st.just(()),
    ),
    **{topic: flat(topic, STAMP, ANGLE) for topic in flat_fields.TYPES},
    '/scenario/reference': paths(types.Reference, 2),
    '/controller/prediction': paths(types.Prediction, 1),
    '/controller/stop_plan': stop_plans(),
    '/scenario/road_edges': st.builds(types.RoadEdges, STAMP, LINE, LINE),
    '/scenario/obstacles': st.builds(
        types.Obstacles,
        STAMP,
        st.lists(OBSTACLE, max_size=6, unique_by=lambda obstacle: obstacle.id).map(tuple),
        st.just(()),
    ),
    '/controller/why': st.builds(types.Why, STAMP, st.integers(0, 2), TEXT, VALUES),
    '/diagnostics': st.builds(types.Health, STAMP, KEYS, st.integers(0, 3), TEXT, VALUES),
    '/clock': STAMP,
    '/vehicle/run_start': st.one_of(st.just(0), STAMP),
}


def same(a, b):
    """Tell whether two values are equal to the last bit, types included."""
    if isinstance(a, np.ndarray):
        return isinstance(b, np.ndarray) and a.dtype == b.dtype and np.array_equal(a, b)
    if isinstance(a, dict):
        return list(a) == list(b) and all(same(a[key], b[key]) for key in a)
    if isinstance(a, tuple):
        return type(a) is type(b) and len(a) == len(b) and all(map(same, a, b))
    return type(a) is type(b) and a == b


@pytest.mark.parametrize('topic', sorted(FORMS))
def test_decoding_undoes_encoding_to_the_last_bit_by_every_route(topic):
    # a message of /diagnostics may have several statuses
    unchanged = (lambda value: (value,)) if topic == '/diagnostics' else lambda value: value
    received = getattr(conversions, f'{topic.rpartition("/")[2]}_as_received', unchanged)

    ways = routes(topic)

    @settings(max_examples=30)
    @given(FORMS[topic])
    def check(value):
        message = encoded(topic, value)
        assert isinstance(message, ros.message_type(topic))
        raw = canonical(topic, message)
        for name, read in ways.items():
            assert same(read(message, raw), received(value)), name

    check()


def test_every_topic_is_tested():
    topics = contract.load().topics.values()
    expected = {topic.name for topic in topics if not topic.on_request}
    assert set(FORMS) == {*expected, PREDICTIONS, *flat_fields.TYPES}
    assert {*flat_fields.TYPES, '/scenario/reference', '/scenario/road_edges'} == set(FAST)


@given(FORMS['/scenario/reference'], FORMS['/vehicle/odometry'])
def test_the_round_trip_changes_times_and_headings_by_rounding_and_full_turns_only(path, state):
    received = conversions.odometry_as_received(state)
    assert abs(conversions.wrap_angle(received.psi - state.psi)) <= 1e-15
    assert received._replace(psi=state.psi) == state
    received = conversions.reference_as_received(path)
    assert np.max(np.abs(received.t - path.t)) <= 1e-9
    turns = (received.psi - path.psi) / math.tau
    assert np.allclose(turns, np.round(turns[0]), atol=1e-13)
    assert -math.pi < received.psi[0] <= math.pi


# a number of any bits that is no NaN
ANY = st.floats(allow_nan=False)
ANY_STAMP = st.integers(0, 2**31 * 10**9 - 1)


def outcome(read, raw):
    """Return the bits of what is read, None where it is refused."""
    try:
        value = read(raw)
    except DecodeError:
        return None
    return value and [(np.shape(field), np.asarray(field).tobytes()) for field in value]


@pytest.mark.parametrize('topic', sorted(flat_fields.TYPES))
def test_a_template_writes_the_bytes_of_the_message_and_reads_or_refuses_them_alike(topic):
    template = flat_fields.load(topic)

    @settings(max_examples=50)
    @given(flat(topic, ANY_STAMP, st.floats(-10, 10), ANY))
    def check(value):
        message, raw = encoded(topic, value), template.fill(value)
        kept = bytes(raw)
        assert raw == canonical(topic, message)
        assert len(raw) == len(serialize_message(message))
        assert outcome(template.read, raw) == outcome(lambda _: decoded(topic, message), raw)
        template.fill(value._replace(stamp_ns=1))
        assert raw == kept  # the next message does not change it

    check()


READERS = {
    '/scenario/reference': subscriptions_node.read_reference,
    '/scenario/road_edges': subscriptions_node.read_road_edges,
    '/vehicle/odometry': subscriptions_node.read_odometry,
    '/vehicle/actuators': subscriptions_node.read_actuators,
}
HEADERS = {
    '/scenario/reference': lambda m: [m.header, *(pose.header for pose in m.poses)],
    '/scenario/road_edges': lambda m: [marker.header for marker in m.markers],
    '/vehicle/odometry': lambda m: [m.header],
    '/vehicle/actuators': lambda m: [m.header],
}


def check_reading(topic, raw):
    """Check that the shortcut and the node read or refuse bytes as their message is."""
    slow = outcome(lambda raw: decoded(topic, ros.deserialize(topic, raw)), raw)
    fast = outcome(FAST[topic], raw)
    assert fast is None or fast == slow
    assert outcome(READERS[topic], raw) == slow


@pytest.mark.parametrize('topic', READERS)
def test_damaged_bytes_are_read_or_refused_as_their_message_is(topic):
    good = canonical(topic, load_example(topic))
    places = st.integers(0, len(good) - 1)

    @settings(max_examples=200)
    @given(
        flips=st.dictionaries(places, st.integers(1, 255), min_size=1, max_size=3),
        size=st.one_of(st.just(len(good)), st.integers(0, len(good) + 4)),
    )
    def check(flips, size):
        raw = bytearray(good)
        for place, bits in flips.items():
            raw[place] ^= bits
        check_reading(topic, (bytes(raw) + bytes(4))[:size])

    check()


@pytest.mark.parametrize('topic', READERS)
def test_any_stamp_is_read_or_refused_as_that_of_the_message_is(topic):
    @settings(max_examples=50)
    @given(
        sec=st.lists(st.integers(-6, 3), min_size=1, max_size=5),
        nanosec=st.integers(0, MAX_NANOSEC),
        step=st.integers(0, 1),
    )
    @example(sec=[-1], nanosec=1_500_000_000, step=1)
    @example(sec=[1, -1, 3], nanosec=4_000_000_000, step=1)
    @example(sec=[0, 5], nanosec=1, step=0)
    @example(sec=[9, 0], nanosec=0, step=0)
    @example(sec=[0], nanosec=0, step=0)
    def check(sec, nanosec, step):
        message = load_example(topic)
        for k, header in enumerate(HEADERS[topic](message)):
            header.stamp.sec = sec[min(k, len(sec) - 1)]
            header.stamp.nanosec = min(nanosec + step * k, MAX_NANOSEC)
        check_reading(topic, canonical(topic, message))

    check()


def test_the_stamp_of_big_endian_bytes_is_read_too_and_bytes_without_a_stamp_are_rejected():
    assert decode.stamp_ns_of(b'\x00\x00\x00\x00' + struct.pack('>iI', 7, 5)) == 7_000_000_005
    for raw in (b'', b'\x00\x01\x00\x00' + bytes(7), b'\x00\x09\x00\x00' + bytes(20)):
        with pytest.raises(DecodeError, match='no CDR message'):
            decode.stamp_ns_of(raw)
