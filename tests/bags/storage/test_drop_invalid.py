"""Messages that break the contract are left out, and the fast look decides as the decoders do."""

import math
import struct

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bags.errors import BagError
from bags.storage import message_filing, read
from bags.storage.decoding import DECODE_ERRORS, decode_message
from bags.storage.invalid_messages import (
    count_invalid,
    describe_invalid,
    drop_invalid,
    obeys_contract,
)
from bags.storage.read import Bag, Recording
from msgs_yaml import contract, encode
from msgs_yaml.types import (
    Actuators,
    Command,
    Health,
    Imu,
    Obstacle,
    Obstacles,
    VehicleState,
    Wheels,
)
from node_runtime import ros

S = 1_000_000_000
FOUR = (0.1, 0.2, 0.3, 0.4)
TOPICS = {topic.name: topic for topic in message_filing.bag_topics(contract.load(), 'lockstep')}
MADE = {
    '/vehicle/odometry': lambda: encode.odometry(VehicleState(S, 1.0, 2.0, 0.3, 20.0, 0.1, 0.2)),
    '/vehicle/actuators': lambda: encode.actuators(Actuators(S, 0.1, 0.2, -3e3, -2e3, FOUR)),
    '/vehicle/imu': lambda: encode.imu(Imu(S, 1.0, 2.0, 0.1)),
    '/vehicle/wheels': lambda: encode.wheels(Wheels(S, *[FOUR] * 7)),
    '/controller/command': lambda: encode.command(Command(S, 0.1, 0.2, -3e3, -2e3)),
}
NUMBERS = st.one_of(
    st.floats(-1e9, 1e9), st.sampled_from([math.nan, math.inf, -math.inf, 0.0, -0.0, 1.0, 120.0])
)


def recording(name, payloads):
    times = np.arange(len(payloads), dtype=np.int64)
    return Recording(TOPICS[name], times, times, times + 1, list(payloads))


def bag(recordings):
    return Bag('made up', (), recordings, {}, None)


def obeys(name, payload):
    try:
        decode_message(TOPICS[name], payload)
    except DECODE_ERRORS:
        return False
    return True


def test_health_of_other_programs_is_no_error_whatever_its_number_of_statuses():
    ours = Health(S, 'plant', 0, 'running', {'missed_steps': 3})
    others = [Health(2 * S, name, 1, 'warm', {'deg': 71.5}) for name in ('lidar: a', 'lidar: b')]
    none = encode.health(ours)
    none.status = []
    sent = [ros.serialize(m) for m in (encode.health(ours), encode.health(*others), none)]
    filtered = drop_invalid(bag({'/diagnostics': recording('/diagnostics', sent)}))
    assert not filtered.invalid
    assert read.values(filtered, '/diagnostics') == [ours, *others]
    table = read.columns(filtered, ['/diagnostics'])['/diagnostics']
    assert table.stamp_ns.tolist() == [S, 2 * S, 2 * S]


def change(message, draw):
    """Change something of a message that a publisher may get wrong."""
    kind = draw(st.sampled_from(['number', 'frame', 'stamp', 'names', 'length', 'nothing']))
    if kind == 'frame':
        message.header.frame_id = draw(st.sampled_from(['', 'map', 'base_link']))
    elif kind == 'stamp':
        message.header.stamp.sec = draw(st.integers(-2, 1))
        message.header.stamp.nanosec = draw(st.integers(0, 1))
    elif hasattr(message, 'name'):
        array = getattr(message, draw(st.sampled_from(['position', 'velocity', 'effort'])))
        if kind == 'names':
            message.name = draw(st.permutations(list(message.name)))
        elif kind == 'length':
            array.append(0.0)
        elif kind == 'number':
            array[draw(st.integers(0, len(array) - 1))] = draw(NUMBERS)
    elif kind == 'number':
        paths = [
            'pose.pose.orientation.w', 'pose.pose.position.y', 'twist.twist.linear.x',
            'linear_acceleration.x', 'angular_velocity.z',
        ]  # fmt: skip
        paths = [path for path in paths if hasattr(message, path.split('.')[0])]
        *parents, last = draw(st.sampled_from(paths)).split('.')
        owner = message
        for name in parents:
            owner = getattr(owner, name)
        setattr(owner, last, draw(NUMBERS))
    return ros.serialize(message)


@pytest.mark.parametrize('name', MADE)
def test_the_fast_look_decides_as_the_decoder_does(name):
    @settings(max_examples=40)
    @given(st.data())
    def tried(data):
        payloads = [change(MADE[name](), data.draw) for _ in range(4)]
        expected = [obeys(name, payload) for payload in payloads]
        assert obeys_contract(TOPICS[name], payloads).tolist() == expected
        for payload, good in zip(payloads, expected):
            alone = drop_invalid(bag({name: recording(name, [payload])}))
            assert bool(alone.recordings[name].payloads) == good

    tried()


def test_a_torn_message_among_whole_ones_is_left_out_with_its_times():
    whole = ros.serialize(MADE['/vehicle/imu']())
    payloads = [whole, whole[:30], whole, b'', whole]
    result = drop_invalid(bag({'/vehicle/imu': recording('/vehicle/imu', payloads)}))
    assert result.recordings['/vehicle/imu'].log_ns.tolist() == [0, 2, 4]
    assert result.invalid['/vehicle/imu'].count == 2
    assert result.invalid['/vehicle/imu'].first.startswith('message 1: ')


def test_time_counts_from_the_first_valid_state():
    good, bad = MADE['/vehicle/odometry'](), MADE['/vehicle/odometry']()
    bad.header.stamp.sec = 0
    bad.header.stamp.nanosec = 5
    bad.header.frame_id = 'odom'
    payloads = [ros.serialize(bad), ros.serialize(good)]
    result = drop_invalid(bag({'/vehicle/odometry': recording('/vehicle/odometry', payloads)}))
    assert read.columns(result)['/vehicle/odometry'].t_s.tolist() == [0.0]


def test_columns_check_no_range_and_sifting_does():
    good, bad = MADE['/vehicle/odometry'](), MADE['/vehicle/odometry']()
    bad.twist.twist.linear.x = math.nan
    payloads = [ros.serialize(good), ros.serialize(bad)]
    recorded = bag({'/vehicle/odometry': recording('/vehicle/odometry', payloads)})
    assert np.isnan(read.columns(recorded)['/vehicle/odometry'].vx_mps).tolist() == [False, True]
    assert len(read.columns(drop_invalid(recorded))['/vehicle/odometry'].vx_mps) == 1
    with pytest.raises(BagError, match='message 1 of /vehicle/odometry'):
        read.values(recorded, '/vehicle/odometry')


def test_values_are_decoded_once_and_stay_those_of_their_messages():
    name = '/scenario/obstacles'
    messages = [ros.serialize(encode.obstacles(Obstacles(S + k, ()))) for k in range(3)]
    broken = messages[0][:-40]
    result = drop_invalid(bag({name: recording(name, [messages[0], broken, *messages[1:]])}))
    assert [value.stamp_ns - S for value in read.values(result, name)] == [0, 1, 2]
    assert drop_invalid(result) is result


def test_an_object_that_breaks_the_contract_costs_no_message():
    name = '/scenario/obstacles'
    crowd = Obstacles(S, tuple(Obstacle(i, 10.0 * i, 0.0, 1.0, 0.0, 0.0) for i in (1, 2)))
    message = encode.obstacles(crowd)
    message.markers[1].scale.x = math.nan
    empty = struct.pack('<4sI', b'\x00\x01\x00\x00', 0)
    recorded = bag({name: recording(name, [ros.serialize(message), empty])})
    result = drop_invalid(recorded)
    assert [value.items for value in read.values(result, name)] == [crowd.items[:1], ()]
    (line,) = describe_invalid(count_invalid(result))
    told, reason = line.split('; ', 1)
    assert told == '1 invalid objects of /scenario/obstacles were left out'
    assert reason.startswith('obstacle 2: markers[obstacle].scale.x')


def test_a_topic_that_the_contract_does_not_know_stays_as_it_is():
    name = '/markers/vehicle'
    result = drop_invalid(bag({name: recording(name, [b'anything'])}))
    assert result.recordings[name].payloads == [b'anything']
    assert not result.invalid
