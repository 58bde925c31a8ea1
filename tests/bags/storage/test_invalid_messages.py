"""A message that breaks the contract costs itself, not the comparison: left out and counted."""

import io
import json
import math
import re
import struct

import hostile_messages
import numpy as np
import pytest
from example_messages import load_example, put
from hypothesis import given, settings
from hypothesis import strategies as st
from nav_msgs.msg import Path as PathMessage
from one_second import TOPICS, in_memory, recording
from rich.console import Console
from straight_drive import drive_of

from bags.errors import BagError
from bags.evaluation.bag_summary import summarize_bag
from bags.report.comparison import compare_bags, show_comparison
from bags.run import load_quietly
from bags.storage import read
from bags.storage.columns import DECODE_ERRORS, decode_message
from bags.storage.invalid_messages import (
    count_invalid,
    describe_invalid,
    drop_invalid,
    find_foreign_stamps,
    obeys_contract,
)
from msgs_yaml import encode
from msgs_yaml.types import (
    Command,
    Health,
    Obstacle,
    Obstacles,
    VehicleState,
    Why,
)
from node_runtime import ros

S = 1_000_000_000
WALL_NS = 1_700_000_000 * S
LATER_NS = 9 * S
STATE, REFERENCE, WHY = '/vehicle/odometry', '/scenario/reference', '/controller/why'
ACTUATORS, IMU, OBSTACLES = '/vehicle/actuators', '/vehicle/imu', '/scenario/obstacles'
JOINTS = ('/vehicle/actuators', '/vehicle/wheels', '/controller/command')
EDITS = st.lists(st.tuples(st.integers(0, 9999), st.integers(0, 9999)), max_size=2)


def made_up(name, *messages):
    """Return a bag of one topic; what is no bytes is serialised."""
    return in_memory(recording(name, messages))


def obeys(name, payload):
    try:
        decode_message(TOPICS[name], payload)
    except DECODE_ERRORS:
        return False
    return True


@pytest.mark.parametrize('name', [STATE, IMU, *JOINTS])
def test_the_fast_look_decides_as_the_decoder_does(name):
    sound = load_example(name)

    @settings(max_examples=60)
    @given(st.lists(EDITS, min_size=4, max_size=4))
    def tried(several):
        payloads = [hostile_messages.changed(sound, edits) for edits in several]
        if name in JOINTS:
            payloads.append(ros.serialize(put(load_example(name), 'name', [*sound.name[::-1]])))
        expected = [obeys(name, payload) for payload in payloads]
        assert obeys_contract(TOPICS[name], payloads).tolist() == expected
        for payload, good in zip(payloads, expected):
            alone = drop_invalid(made_up(name, payload))
            assert bool(alone.recordings[name].payloads) == good

    tried()


def test_a_torn_message_among_whole_ones_is_left_out_with_its_times():
    whole = ros.serialize(load_example(IMU))
    result = drop_invalid(made_up(IMU, whole, whole[:30], whole, b'', whole))
    assert result.recordings[IMU].log_ns.tolist() == [0, 2, 4]
    assert result.invalid[IMU].count == 2
    assert result.invalid[IMU].first.startswith('message 1: ')


def test_time_counts_from_the_first_valid_state():
    early = put(put(load_example(STATE), 'header.stamp.sec', 0), 'header.stamp.nanosec', 5)
    result = drop_invalid(
        made_up(STATE, put(early, 'header.frame_id', 'odom'), load_example(STATE))
    )
    assert read.columns(result)[STATE].t_s.tolist() == [0.0]


def test_columns_check_no_range_and_sifting_does():
    bag = made_up(
        STATE, load_example(STATE), put(load_example(STATE), 'twist.twist.linear.x', math.nan)
    )
    assert np.isnan(read.columns(bag)[STATE].vx_mps).tolist() == [False, True]
    assert len(read.columns(drop_invalid(bag))[STATE].vx_mps) == 1
    with pytest.raises(BagError, match='message 1 of /vehicle/odometry'):
        read.values(bag, STATE)


def test_values_stay_those_of_their_messages_and_a_filtered_bag_is_not_filtered_again():
    sent = [ros.serialize(encode.obstacles(Obstacles(S + k, ()))) for k in range(3)]
    result = drop_invalid(made_up(OBSTACLES, sent[0], sent[0][:-40], *sent[1:]))
    assert [value.stamp_ns - S for value in read.values(result, OBSTACLES)] == [0, 1, 2]
    assert drop_invalid(result) is result


def test_an_object_that_breaks_the_contract_costs_no_message():
    crowd = Obstacles(S, tuple(Obstacle(i, 10.0 * i, 0.0, 1.0, 0.0, 0.0) for i in (1, 2)))
    message = encode.obstacles(crowd)
    message.markers[1].scale.x = math.nan
    empty = struct.pack('<4sI', b'\x00\x01\x00\x00', 0)
    result = drop_invalid(made_up(OBSTACLES, message, empty))
    assert [value.items for value in read.values(result, OBSTACLES)] == [crowd.items[:1], ()]
    (line,) = describe_invalid(count_invalid(result))
    told, reason = line.split('; ', 1)
    assert told == '1 invalid objects of /scenario/obstacles were left out'
    assert reason.startswith('obstacle 2: markers[obstacle].scale.x')


def test_what_the_contract_does_not_define_stays_as_it_is():
    result = drop_invalid(made_up('/markers/vehicle', b'anything'))
    assert result.recordings['/markers/vehicle'].payloads == [b'anything']
    # health of other programs, whatever its number of statuses
    ours = Health(S, 'plant', 0, 'running', {'missed_steps': 3})
    others = [Health(2 * S, name, 1, 'warm', {'deg': 71.5}) for name in ('lidar: a', 'lidar: b')]
    none = put(encode.health(ours), 'status', [])
    bag = made_up('/diagnostics', encode.health(ours), encode.health(*others), none)
    filtered = drop_invalid(bag)
    assert not filtered.invalid
    assert read.values(filtered, '/diagnostics') == [ours, *others]
    assert read.columns(filtered)['/diagnostics'].stamp_ns.tolist() == [S, 2 * S, 2 * S]


# stamps of another time are found, wherever they stand, and cost no other sample
STAMPS = np.arange(WALL_NS, WALL_NS + 100_000_000, 1_000_000, dtype=np.int64)
LOG = STAMPS + 2_000_000  # 2 ms on its way


def changed(row, stamp_ns):
    stamps = STAMPS.copy()
    stamps[row] = stamp_ns
    return stamps


LATE = LOG + np.where(np.arange(100) < 60, 0, 300 * S)
FAR = 'header.stamp is 5.000 s, 1699999995 s from .*; allowed up to 600 s'
BACK = 'header.stamp is 1700000000.000 s; the stamps fall back'


STEPS_NS = (-30_000_000, 30_000_000, -S, S)
# stamps, log times, whether twins stay, and the reason by row
FOREIGN = {
    'of one time': (STAMPS, LOG, False, {}),
    'sent again': (STAMPS.repeat(2), LOG.repeat(2), False, {}),
    'none': (STAMPS[:0], LOG[:0], False, {}),
    'of a plant that was stopped for minutes': (STAMPS, LATE, False, {}),
    'of the clock of another machine': (STAMPS, LOG + 10_000 * S, False, {}),
    **{f'row {k} early': (changed(k, 5 * S), LOG, False, {k: FAR}) for k in (0, 40, 99)},
    **{f'row {k} late': (changed(k, 2 * WALL_NS), LOG, False, {k: '600 s'}) for k in (0, 40, 99)},
    **{f'{by}': (changed(40, STAMPS[40] + by), LOG, False, {40: 'fall back'}) for by in STEPS_NS},
    'the reason': (changed(7, WALL_NS), LOG, False, {7: BACK}),
    'a twin': (changed(40, STAMPS[30]), LOG, False, {40: ''}),
    'a twin that is wanted': (changed(40, STAMPS[30]), LOG, True, {}),
    'no twin': (changed(40, STAMPS[30] + 1), LOG, True, {40: ''}),
}


@pytest.mark.parametrize(
    ('stamps', 'log_ns', 'keep_twins', 'expected'), FOREIGN.values(), ids=FOREIGN
)
def test_a_stamp_of_another_time_is_found_and_costs_no_other_sample(
    stamps, log_ns, keep_twins, expected
):
    result = dict(find_foreign_stamps(stamps, log_ns, keep_twins))
    assert list(result) == list(expected)
    for row, why in expected.items():
        assert re.search(why, result[row])


# a recorded drive with such messages in it


def foreign_messages():
    """Return what other publishers may send on our topics: (topic, ns, CDR)."""
    origin = VehicleState(LATER_NS, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    lost = put(encode.odometry(origin), 'twist.twist.linear.x', math.nan)
    far = encode.odometry(origin._replace(stamp_ns=LATER_NS + 1))
    words = {'rung': 'solved', 'reason': 'converged', 'time.solve_ms': 'long'}
    report = ros.serialize(encode.why(Why(S, 0, '', words)))
    return [
        (REFERENCE, LATER_NS, ros.serialize(PathMessage())),
        (STATE, LATER_NS, ros.serialize(lost)),
        (STATE, LATER_NS, ros.serialize(put(far, 'pose.pose.position.x', 1e9))),
        (WHY, LATER_NS, report[:60]),
        (WHY, LATER_NS, report),
    ]


DRIVE = drive_of(metres=40.0)


@pytest.fixture(scope='module')
def clean(write_bag_into, tmp_path_factory):
    """Return metrics and ticks of the drive, from a bag of nothing else."""
    folder = write_bag_into(tmp_path_factory.mktemp('clean'), DRIVE)
    summary = summarize_bag(read.load(folder))
    assert 'invalid_messages' not in summary
    return dict(load_quietly(folder).metrics), summary['ticks']


@pytest.fixture
def bag(write_bag):
    return write_bag(DRIVE, extra=foreign_messages())


def test_the_verdict_is_that_of_the_valid_messages(clean, bag):
    result = dict(load_quietly(bag).metrics)
    assert result == clean[0]
    assert result['min_v2e_m'] == pytest.approx(1.9)


def test_what_was_left_out_is_counted_by_topic_with_the_first_reason(undrawn, bag, tmp_path):
    compared = compare_bags([bag], tmp_path / 'out')
    result = json.loads(compared.file.read_text())['invalid_messages']['mpcc']
    counts = {topic: item['count'] for topic, item in result.items()}
    assert counts == {REFERENCE: 1, STATE: 2, WHY: 1}
    assert result[REFERENCE]['first'] == 'message 1: poses is 0 long; allowed 2 to 40000 elements'
    assert 'twist.twist.linear.x (vx) is nan' in result[STATE]['first']
    assert 'do not fit its definition' in result[WHY]['first']
    console = Console(file=io.StringIO(), width=200)
    show_comparison(compared, console)
    assert f'mpcc: 2 invalid messages of {STATE} were left out; message ' in console.file.getvalue()
    assert f'2 invalid messages of {STATE} were' in ' '.join(compared.report.read_text().split())


@pytest.mark.parametrize('command', ['info', 'timing'])
def test_the_other_readers_go_on_and_count_too(bag, command, bags_prints):
    result = json.loads(bags_prints(command, bag, '--json'))
    assert result['invalid_messages'][STATE]['count'] == 2
    output = ' '.join(bags_prints(command, bag).split())
    assert f'1 invalid messages of {REFERENCE} were left out; message 1: poses is 0 long' in output


def test_samples_with_a_stamp_of_another_time_are_left_out_and_counted(clean, write_bag):
    extra = []
    for topic, stamp_ns in ((STATE, 1), (STATE, WALL_NS), (ACTUATORS, WALL_NS), (IMU, 1)):
        stray = put(load_example(topic), 'header.stamp.sec', stamp_ns // S)
        stray = put(stray, 'header.stamp.nanosec', stamp_ns % S)
        extra.append((topic, LATER_NS, ros.serialize(stray)))
    folder = write_bag(DRIVE, extra=extra)
    left_out = count_invalid(drop_invalid(read.load(folder)))['invalid_messages']
    assert {topic: told['count'] for topic, told in left_out.items()} == {
        STATE: 2,
        ACTUATORS: 1,
        IMU: 1,
    }
    assert all('header.stamp is ' in told['first'] for told in left_out.values())
    assert (dict(load_quietly(folder).metrics), summarize_bag(read.load(folder))['ticks']) == clean


TWIN_NS = int(DRIVE.motion.stamp_ns[50])
TWINS = {
    STATE: encode.odometry(VehicleState(TWIN_NS, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)),
    '/controller/command': encode.command(Command(TWIN_NS, 0.1, 0.0, 0.0, 0.0)),
}


@pytest.mark.parametrize('topic', TWINS)
def test_a_second_message_of_a_stamp_is_that_of_a_second_ring(write_bag, topic):
    extra = [(topic, LATER_NS, ros.serialize(TWINS[topic]))]
    why = f'{topic} has two different messages of one stamp.*shared a ROS domain'
    with pytest.raises(BagError, match=why):
        load_quietly(write_bag(DRIVE, extra=extra)).metrics['verdict']


def test_a_bag_with_nothing_valid_of_a_topic_cannot_be_judged_and_says_why():
    bag = made_up(REFERENCE, PathMessage())
    other = made_up(STATE, load_example(STATE)).recordings
    only = drop_invalid(bag._replace(recordings=bag.recordings | other))
    with pytest.raises(BagError, match=r'no valid message of /scenario/reference .* poses is 0'):
        read.columns(only, [REFERENCE])
