"""The right time, the right count, and no way back."""

from collections import deque

import numpy as np
import pytest
from rclpy.serialization import serialize_message

from bags.storage.message_definitions import schema_text
from bags.storage.message_filing import (
    AHEAD_NS,
    LARGEST_AHEAD,
    LARGEST_WAIT,
    ClockError,
    Filing,
    SimulatedTime,
)
from bags.storage.message_loss import LossCounter, Losses
from bags.storage.rosbag2_metadata import BagTopic
from msgs_yaml import encode, raw_scenario
from msgs_yaml.types import Reference

KIND = 'nav_msgs/msg/Odometry'
TOPIC = BagTopic('/t', KIND, schema_text(KIND), '', '')
CLOCK = BagTopic('/clock', 'rosgraph_msgs/msg/Clock', '', '', '')
LOG = BagTopic('/rosout', 'rcl_interfaces/msg/Log', '', '', '')
S = 10**9
WALL_NS = 1_700_000_000 * S  # what a program stamps with that does not follow /clock


def message(stamp_ns):
    sec, nanosec = divmod(stamp_ns, 10**9)
    return b'\0\1\0\0' + sec.to_bytes(4, 'little', signed=True) + nanosec.to_bytes(4, 'little')


@pytest.fixture
def filed():
    """Return the rows filed of the topic /t."""
    return []


@pytest.fixture
def time():
    return SimulatedTime()


@pytest.fixture
def filing(filed, time):
    def make(mode, **options):
        return Filing(TOPIC, mode, lambda *row: filed.append(row), time=time, **options)

    return make


@pytest.fixture
def tick(time):
    """Return tick(stamp_ns), which files a message of /clock."""
    clock = Filing(CLOCK, 'lockstep', lambda *row: None, time=time, publishes_clock=True)
    return lambda stamp_ns: clock.file(message(stamp_ns), 0, 0, None)


def put(topic, *stamps_ns):
    for stamp_ns in stamps_ns:
        topic.file(message(stamp_ns), 0, 0, None)


def times(filed):
    return [log_ns for log_ns, *_ in filed]


def test_lockstep_files_under_the_stamp_and_realtime_under_the_arrival(filing, filed, tick):
    tick(7)
    filing('lockstep').file(message(7), 20, 30, 1)
    filing('realtime').file(message(7), 20, 30, 1)
    assert [(log_ns, publish_ns) for log_ns, publish_ns, *_ in filed] == [(7, 20), (30, 20)]


def test_clock_that_falls_back_is_refused_and_not_filed(filed):
    clock = Filing(CLOCK, 'lockstep', lambda *row: filed.append(row))
    put(clock, 5 * S, 5 * S, 6 * S)  # sent again while it waits: no fault
    with pytest.raises(ClockError, match=r'/clock: .* backwards from 6\.0+ s to 5\.9+ s: .*two\?'):
        put(clock, 6 * S - 1)
    assert times(filed) == [5 * S, 6 * S]


def test_what_is_sent_again_while_time_waits_is_filed_and_numbered_once(filing, filed, tick):
    topic = filing('lockstep')
    for number, stamp_ns in enumerate((S, S, S, S + 1, S + 2, S + 2), start=5):
        topic.file(message(stamp_ns), 0, 0, number)
    tick(S + 2)
    assert [(log_ns, number) for log_ns, *_, number in filed] == [(S, 5), (S + 1, 6), (S + 2, 7)]
    assert topic.counter.losses == Losses(received=3, lost=0, gaps=0, longest=0, before=4)


@pytest.mark.parametrize(('place', 'count'), [(raw_scenario.PADDING.start, 1), (-1, 2)])
def test_padding_tells_no_two_messages_apart_but_a_value_does(place, count, filed, time, tick):
    kind, ends = 'nav_msgs/msg/Path', np.arange(2.0)
    schema = schema_text(kind)
    topic = Filing(
        BagTopic('/t', kind, schema, '', ''), 'lockstep', lambda *row: filed.append(row), time=time
    )
    path = bytearray(serialize_message(encode.reference(Reference(S, ends, ends, ends, ends))))
    tick(S)
    topic.file(bytes(path), 0, 0, 1)
    path[place] ^= 1
    topic.file(bytes(path), 0, 0, 2)
    assert len(filed) == count


def test_on_the_wall_clock_every_message_is_filed(filing, filed):
    topic = filing('realtime')
    put(topic, S, S)
    assert len(filed) == 2


def test_what_has_no_stamp_is_filed_under_the_last_one(filing, filed, tick):
    topic = filing('lockstep')
    tick(10)
    for data in (b'', message(7), b'', message(8)):
        topic.file(data, 0, 0, None)
    assert times(filed) == [0, 7, 7, 8]
    assert topic.misdated == 0


def test_log_lines_wait_for_the_clock_however_much_arrives_before(filing, filed, tick, time):
    """Their stamps are of the wall clock, and the bag begins with the run."""
    lines = []
    log = Filing(LOG, 'lockstep', lambda *row: lines.append(row), time=time)
    put(log, WALL_NS)
    put(filing('lockstep'), *range(S, S + LARGEST_WAIT + 2))
    assert len(filed) > LARGEST_WAIT
    assert not lines
    tick(2 * S)
    tick(3 * S)
    put(log, WALL_NS)
    assert times(lines) == [2 * S, 3 * S]
    assert log.misdated == 0


def test_without_a_clock_log_lines_are_filed_at_the_end_of_the_rest(filing, filed, time):
    lines = []
    put(Filing(LOG, 'lockstep', lambda *row: lines.append(row), time=time), WALL_NS)
    put(filing('lockstep'), S, 2 * S)
    time.end()
    assert times(filed) == [S, 2 * S]
    assert times(lines) == [2 * S]


def test_a_stamp_before_1970_is_filed_under_0_and_is_no_way_back(filing, filed, tick):
    topic = filing('lockstep')
    tick(-5)
    put(topic, -5, -S, 7)
    assert times(filed) == [0, 0, 7]


@pytest.mark.parametrize('publishes_clock', [False, True])
def test_a_stamp_in_the_future_moves_no_time_but_its_own(
    filing, filed, tick, time, publishes_clock
):
    topic = filing('lockstep', publishes_clock=publishes_clock)
    tick(2 * S)
    put(topic, 2 * S, WALL_NS)
    tick(3 * S)
    put(topic, 2 * S + 1, 3 * S)
    assert times(filed) == [2 * S, 2 * S + 1, 3 * S]
    time.end()
    assert times(filed) == [2 * S, 2 * S + 1, 3 * S, 3 * S]
    assert (topic.misdated, topic.first_misdated) == (1, (WALL_NS, 3 * S))


def test_a_clock_that_arrives_late_misdates_nothing(filing, filed, tick):
    """What is lost on its way is sent again after seconds, in which a lockstep drive goes on."""
    topic = filing('lockstep', publishes_clock=True)
    tick(2 * S)
    stamps_ns = [2 * S + k * S // 10 for k in range(40)]
    put(topic, *stamps_ns)
    for k in range(4):
        tick(3 * S + k * S)
    assert times(filed) == stamps_ns
    assert topic.misdated == 0


def test_few_messages_wait_for_a_time_that_never_comes(filing, filed, tick):
    topic = filing('lockstep')
    tick(2 * S)
    put(topic, *range(WALL_NS, WALL_NS + LARGEST_AHEAD + 3))
    assert times(filed) == [2 * S] * 3


def test_a_stamp_a_little_ahead_of_the_clock_is_kept_and_holds_nothing_back(filing, filed, tick):
    topic = filing('lockstep')
    tick(2 * S)
    put(topic, 2 * S + AHEAD_NS, 2 * S + 1)
    assert times(filed) == [2 * S + AHEAD_NS, 2 * S + 1]
    assert topic.misdated == 0


def test_the_clock_is_heard_anew_before_a_stamp_is_called_one_of_the_future(filed):
    time = SimulatedTime(lambda: [(message(9 * S),)])
    time.advance(2 * S)
    topic = Filing(TOPIC, 'lockstep', lambda *row: filed.append(row), time=time)
    put(topic, 9 * S, WALL_NS)
    assert times(filed) == [9 * S]
    time.end()
    assert times(filed) == [9 * S, 9 * S]


@pytest.mark.parametrize('stamp_ns', [0, S])
def test_an_old_stamp_on_a_topic_of_the_plant_ends_nothing(filing, filed, tick, stamp_ns):
    topic = filing('lockstep', publishes_clock=True)
    tick(5 * S)
    put(topic, 5 * S, stamp_ns)
    assert times(filed) == [5 * S]  # it may be a plant that was started again
    tick(6 * S)
    put(topic, 6 * S)
    assert times(filed) == [5 * S, 5 * S, 6 * S]
    assert topic.first_misdated == (stamp_ns, 5 * S)


def test_states_of_a_plant_that_was_started_again_are_not_filed(filing, filed, tick):
    topic = filing('lockstep', publishes_clock=True)
    tick(5 * S)
    put(topic, 5 * S, S, 2 * S)
    with pytest.raises(ClockError, match='was the plant started again'):
        tick(2 * S)
    assert times(filed) == [5 * S]


def test_a_clock_that_falls_back_leaves_out_what_fell_back_before_it_and_nothing_else(
    filing, filed, tick, time
):
    plant, other = filing('lockstep', publishes_clock=True), filing('lockstep')
    tick(5 * S)
    put(plant, 5 * S, S)
    put(other, WALL_NS, WALL_NS + 1)
    with pytest.raises(ClockError):
        tick(S)
    assert time.end(fell_back=True) == 1
    assert times(filed) == [5 * S] * 3


def test_a_clock_that_is_heard_while_one_is_filed_is_filed_behind_it(filed):
    wire, late = deque(message(k * S) for k in (2, 3)), deque([message(4 * S)])

    def arrived():
        while wire:
            yield wire.popleft(), 0, 0, None
        wire.extend(late)  # until somebody looks again
        late.clear()

    time = SimulatedTime(arrived)
    filings = [
        Filing(topic, 'lockstep', lambda *row: filed.append(row), time=time)
        for topic in (TOPIC, CLOCK)
    ]
    put(filings[0], WALL_NS)  # waits for the first /clock, and makes it listen for a later one
    for _ in range(2):
        for item in time.take():
            filings[1].file(*item)
    assert times(filed)[1:] == [2 * S, 3 * S, 4 * S]


def test_messages_of_a_topic_stay_in_order_where_the_clock_is_heard_between_them(filed):
    heard = deque([[], [(message(2 * S + 700_000_000),)]])
    time = SimulatedTime(heard.popleft)
    topic, clock = (
        Filing(topic, 'lockstep', write, time=time, publishes_clock=True)
        for topic, write in ((TOPIC, lambda *row: filed.append(row)), (CLOCK, lambda *row: None))
    )
    put(clock, S)
    put(topic, 3 * S, 3 * S + 600_000_000)  # the second one is no longer ahead
    assert filed == []
    put(clock, 3 * S)
    assert times(filed) == [3 * S, 3 * S + 600_000_000]


def test_a_message_of_another_clock_keeps_no_later_one_waiting(filing, filed, tick):
    topic = filing('lockstep', publishes_clock=True)
    tick(S)
    put(topic, WALL_NS, S, S + 1)
    assert times(filed) == [S, S + 1]


def test_what_comes_before_the_clock_is_dated_by_the_clock(filing, filed, tick):
    topic, other = filing('lockstep'), filing('lockstep', single_publisher=False)
    put(topic, WALL_NS, S)
    put(other, WALL_NS)
    assert filed == []
    tick(2 * S)
    assert times(filed) == [2 * S, S, 2 * S]


def test_a_recording_without_a_clock_keeps_few_messages_waiting(filing, filed):
    topic = filing('lockstep')
    put(topic, *range(LARGEST_WAIT))
    assert filed == []
    put(topic, LARGEST_WAIT, LARGEST_WAIT + 1)
    assert times(filed) == list(range(LARGEST_WAIT + 2))


def test_wall_clock_that_is_set_back_is_refused_but_a_message_sent_again_is_not(filing, filed):
    topic = filing('realtime')
    for received_ns in (10**12, 10**12 - 99_000_000):
        topic.file(message(0), 0, received_ns, None)
    with pytest.raises(ClockError, match='the clock of the machine was set back'):
        topic.file(message(0), 0, 10**12 - 300_000_000, None)
    assert len(filed) == 2


def test_a_node_started_again_that_does_not_own_time_is_filed_under_the_last_stamp(
    filing, filed, tick
):
    topic = filing('lockstep')
    tick(6 * S)
    put(topic, 5 * S, S, 6 * S)
    assert times(filed) == [5 * S, 5 * S, 6 * S]
    assert topic.first_misdated == (S, 5 * S)


@pytest.mark.parametrize('publishes_clock', [False, True])
def test_a_machine_whose_clock_is_set_back_is_refused_whoever_publishes(filing, publishes_clock):
    topic = filing('realtime', publishes_clock=publishes_clock)
    topic.file(message(0), 0, 10**12, None)
    with pytest.raises(ClockError, match='the clock of the machine was set back'):
        topic.file(message(0), 0, 10**12 - 300_000_000, None)


def test_several_publishers_have_several_times(filing, filed, tick):
    topic = filing('lockstep', single_publisher=False)
    tick(6 * S)
    put(topic, 5 * S, S, 6 * S)
    assert times(filed) == [5 * S, S, 6 * S]


def counted(*sequence):
    return LossCounter().add_all(sequence).losses


def test_gaps_are_counted_with_their_places_and_the_longest():
    assert counted(1, 2, 4, 5, 9) == Losses(received=5, lost=4, gaps=2, longest=3, before=0)


def test_what_was_sent_before_anybody_listened_is_no_loss():
    assert counted(11, 12) == Losses(2, 0, 0, 0, before=10)


@pytest.mark.parametrize('sequence', [(), (0, 0), (None,), (1, 1), (5, 1), (1, 0)])
def test_numbers_that_tell_nothing_are_not_read_as_no_loss(sequence):
    assert counted(*sequence) == Losses(len(sequence), None, None, None, None)
