"""The right time, the right count, and no way back: what a recorder does with each message."""

from collections import deque
from typing import NamedTuple

import numpy as np
import pytest
from example_messages import load_example
from rclpy.serialization import serialize_message

from bags.recorder_node import RecordingHealth
from bags.storage import message_filing
from bags.storage.cdr import schema_text
from bags.storage.message_filing import (
    AHEAD_NS,
    LARGEST_WAIT,
    ClockError,
    Filing,
    LossCounter,
    Losses,
    SimulatedTime,
    bag_topic,
)
from bags.storage.rosbag2_metadata import BagTopic
from msgs_yaml import contract, encode, raw_scenario
from msgs_yaml.types import Reference
from node_runtime.input_monitor import HOLD_NS, OK, STALE, WARN

KIND = 'nav_msgs/msg/Odometry'
TOPIC = BagTopic('/t', KIND, schema_text(KIND), '', '')
CLOCK = BagTopic('/clock', 'rosgraph_msgs/msg/Clock', '', '', '')
LOG = BagTopic('/rosout', 'rcl_interfaces/msg/Log', '', '', '')
S = 10**9
WALL_NS = 1_700_000_000 * S  # what a program stamps with that does not follow /clock
PLANT, ANY = {'publishes_clock': True}, {'single_publisher': False}


class Tick(NamedTuple):
    """A message of /clock."""

    ns: int


def message(stamp_ns):
    if isinstance(stamp_ns, bytes):
        return stamp_ns
    sec, nanosec = divmod(stamp_ns, 10**9)
    return b'\0\1\0\0' + sec.to_bytes(4, 'little', signed=True) + nanosec.to_bytes(4, 'little')


class Bench:
    """A recording of /t and others; `times` has the log times in the order of filing."""

    def __init__(self, arrived=tuple):
        self.time, self.times = SimulatedTime(arrived), []
        self.clock = self.filing(CLOCK, write=lambda *row: None, **PLANT)

    def filing(self, topic=TOPIC, mode='lockstep', write=None, **options):
        write = write or (lambda log_ns, *row: self.times.append(log_ns))
        return Filing(topic, mode, write, time=self.time, **options)

    def put(self, filing, *events):
        for event in events:
            topic, stamp = (self.clock, event.ns) if isinstance(event, Tick) else (filing, event)
            topic.file(message(stamp), 0, 0, None)


@pytest.fixture
def bench(monkeypatch):
    monkeypatch.setattr(message_filing, 'LARGEST_AHEAD', MOST)
    return Bench()


LATE = [2 * S + k * S // 10 for k in range(40)]
MOST = 600  # that wait for a time that never comes, in these tests
MANY = range(WALL_NS, WALL_NS + MOST + 3)
AHEAD = 2 * S + AHEAD_NS


FUTURE = [Tick(2 * S), 2 * S, WALL_NS, Tick(3 * S), 2 * S + 1, 3 * S]
IN_TIME = [2 * S, 2 * S + 1, 3 * S]
AGAIN = [Tick(6 * S), 5 * S, S, 6 * S]
# events; options of the topic; log times, and those at the end; the first stamp that was replaced
FILED = {
    'no stamp': ([Tick(10), b'', 7, b'', 8], {}, [0, 7, 7, 8], [], None),
    'before 1970': ([Tick(-5), -5, -S, 7], {}, [0, 0, 7], [], None),
    'of the future': (FUTURE, {}, IN_TIME, [3 * S], (WALL_NS, 3 * S)),
    'of the future, of the plant': (FUTURE, PLANT, IN_TIME, [3 * S], (WALL_NS, 3 * S)),
    'late clock': (
        *([Tick(2 * S), *LATE, *(Tick(k * S) for k in (3, 4, 5, 6))], PLANT),
        *(LATE, [], None),
    ),
    'few wait for a time that never comes': (
        *([Tick(2 * S), *MANY], {}),
        *([2 * S] * 3, [2 * S] * MOST, (WALL_NS, 2 * S)),
    ),
    'a little ahead': ([Tick(2 * S), AHEAD, 2 * S + 1], {}, [AHEAD, 2 * S + 1], [], None),
    'old stamp of the plant': (
        *([Tick(5 * S), 5 * S, S, Tick(6 * S), 6 * S], PLANT),
        *([5 * S, 5 * S, 6 * S], [], (S, 5 * S)),
    ),
    'no time at all of the plant': (
        *([Tick(5 * S), 5 * S, 0, Tick(6 * S), 6 * S], PLANT),
        *([5 * S, 5 * S, 6 * S], [], (0, 5 * S)),
    ),
    'started again with the plant': (
        *([Tick(5 * S), 5 * S, S, 2 * S], PLANT),
        *([5 * S], [5 * S] * 2, (S, 5 * S)),
    ),
    'another clock before': ([Tick(S), WALL_NS, S, S + 1], PLANT, [S, S + 1], [S], (WALL_NS, S)),
    'no clock yet': ([WALL_NS, S], {}, [], [WALL_NS, WALL_NS], (S, WALL_NS)),
    'first clock': ([WALL_NS, S, Tick(2 * S)], {}, [2 * S, S], [], (WALL_NS, 2 * S)),
    'no clock ever': (range(LARGEST_WAIT + 2), {}, [*range(LARGEST_WAIT + 2)], [], None),
    'node started again': (AGAIN, {}, [5 * S, 5 * S, 6 * S], [], (S, 5 * S)),
    'several publishers': (AGAIN, ANY, [5 * S, S, 6 * S], [], None),
}


@pytest.mark.parametrize(
    ('events', 'options', 'filed', 'at_the_end', 'misdated'), FILED.values(), ids=FILED
)
def test_a_message_is_filed_under_its_stamp_or_the_present(
    bench, events, options, filed, at_the_end, misdated
):
    topic = bench.filing(**options)
    bench.put(topic, *events)
    assert bench.times == filed
    assert bench.time.end() == 0
    assert bench.times == filed + at_the_end
    assert topic.first_misdated == misdated
    assert bool(topic.misdated) == (misdated is not None)


def test_lockstep_files_under_the_stamp_and_realtime_under_the_arrival(bench):
    rows = []
    bench.put(None, Tick(7))
    for mode in ('lockstep', 'realtime'):
        topic = bench.filing(mode=mode, write=lambda *row: rows.append(row))
        for data in (message(7), message(7)):  # sent again while time waits
            topic.file(data, 20, 30, 1)
    assert [row[:2] for row in rows] == [(7, 20), (30, 20), (30, 20)]


def test_what_is_sent_again_while_time_waits_is_filed_and_numbered_once(bench):
    rows = []
    topic = bench.filing(write=lambda *row: rows.append(row))
    for number, stamp_ns in enumerate((S, S, S, S + 1, S + 2, S + 2), start=5):
        topic.file(message(stamp_ns), 0, 0, number)
    bench.put(topic, Tick(S + 2))
    assert [(log_ns, number) for log_ns, *_, number in rows] == [(S, 5), (S + 1, 6), (S + 2, 7)]
    assert topic.counter.losses == Losses(received=3, lost=0, gaps=0, longest=0, before=4)


@pytest.mark.parametrize(('place', 'count'), [(raw_scenario.PADDING.start, 1), (-1, 2)])
def test_padding_tells_no_two_messages_apart_but_a_value_does(bench, place, count):
    kind, ends = 'nav_msgs/msg/Path', np.arange(2.0)
    topic = bench.filing(BagTopic('/t', kind, schema_text(kind), '', ''))
    path = bytearray(serialize_message(encode.reference(Reference(S, ends, ends, ends, ends))))
    bench.put(topic, Tick(S), bytes(path))
    path[place] ^= 1
    bench.put(topic, bytes(path))
    assert len(bench.times) == count


def test_log_lines_wait_for_the_clock_however_much_arrives_before(bench):
    """Their stamps are of the wall clock, and the bag begins with the run."""
    lines, topic = [], bench.filing()
    log = bench.filing(LOG, write=lambda log_ns, *row: lines.append(log_ns))
    bench.put(log, WALL_NS)
    bench.put(topic, *range(S, S + LARGEST_WAIT + 2))
    assert len(bench.times) > LARGEST_WAIT
    assert not lines
    bench.put(log, Tick(2 * S), Tick(3 * S), WALL_NS)
    assert lines == [2 * S, 3 * S]
    assert log.misdated == 0


def test_without_a_clock_log_lines_are_filed_at_the_end_of_the_rest(bench):
    bench.put(bench.filing(LOG), WALL_NS)
    bench.put(bench.filing(), S, 2 * S)
    bench.time.end()
    assert bench.times == [S, 2 * S, 2 * S]


def test_the_clock_is_heard_anew_before_a_stamp_is_called_one_of_the_future():
    bench = Bench(lambda: [(message(9 * S),)])
    bench.time.advance(2 * S)
    bench.put(bench.filing(), 9 * S, WALL_NS)
    assert bench.times == [9 * S]
    bench.time.end()
    assert bench.times == [9 * S, 9 * S]


def test_a_clock_that_falls_back_leaves_out_what_fell_back_before_it_and_nothing_else(bench):
    plant, other = bench.filing(**PLANT), bench.filing()
    bench.put(plant, Tick(5 * S), Tick(5 * S), 5 * S, S)  # /clock sent again: no fault
    bench.put(other, WALL_NS, WALL_NS + 1)
    why = r'/clock: .* backwards from 5\.0+ s to 4\.9+ s: was the plant started again, or .* two\?'
    with pytest.raises(ClockError, match=why):
        bench.put(plant, Tick(5 * S - 1))
    assert bench.times == [5 * S]
    assert bench.time.end(fell_back=True) == 1
    assert bench.times == [5 * S] * 3


def test_a_clock_that_is_heard_while_one_is_filed_is_filed_behind_it():
    wire, late = deque(message(k * S) for k in (2, 3)), deque([message(4 * S)])

    def arrived():
        while wire:
            yield wire.popleft(), 0, 0, None
        wire.extend(late)  # until somebody looks again
        late.clear()

    bench = Bench(arrived)
    clock = bench.filing(CLOCK)
    bench.put(bench.filing(), WALL_NS)  # waits for the first /clock, and makes it listen for more
    for _ in range(2):
        for item in bench.time.take():
            clock.file(*item)
    assert bench.times[1:] == [2 * S, 3 * S, 4 * S]


def test_messages_of_a_topic_stay_in_order_where_the_clock_is_heard_between_them():
    bench = Bench(deque([[], [(message(2 * S + 700_000_000),)]]).popleft)
    topic = bench.filing(**PLANT)
    bench.put(topic, Tick(S), 3 * S, 3 * S + 600_000_000)  # the second one is no longer ahead
    assert bench.times == []
    bench.put(topic, Tick(3 * S))
    assert bench.times == [3 * S, 3 * S + 600_000_000]


@pytest.mark.parametrize('name', [name for name in contract.load().topics if name != CLOCK.name])
def test_what_cannot_be_read_is_filed_byte_for_byte(bench, name):
    kept, raw = [], serialize_message(load_example(name))
    one = bag_topic(contract.load().topics[name], 'lockstep')
    topic = bench.filing(one, write=lambda log_ns, source_ns, data, number: kept.append(data))
    torn = [raw[:length] for length in (0, 3, 6, 13, len(raw) // 2, len(raw) - 1)] + [b'no message']
    bench.put(topic, Tick(2 * S), *torn, Tick(3 * S), raw, torn[4])
    bench.time.end()
    assert sorted(kept) == sorted([*torn, raw, torn[4]])


@pytest.mark.parametrize('options', [{}, PLANT])
def test_wall_clock_that_is_set_back_is_refused_but_a_message_sent_again_is_not(bench, options):
    topic = bench.filing(mode='realtime', **options)
    for received_ns in (10**12, 10**12 - 99_000_000):
        topic.file(message(0), 0, received_ns, None)
    with pytest.raises(ClockError, match='the clock of the machine was set back'):
        topic.file(message(0), 0, 10**12 - 300_000_000, None)
    assert len(bench.times) == 2


@pytest.mark.parametrize(
    ('sequence', 'losses'),
    [
        ((1, 2, 4, 5, 9), Losses(received=5, lost=4, gaps=2, longest=3, before=0)),
        ((11, 12), Losses(2, 0, 0, 0, before=10)),  # sent before anybody listened: no loss
        # numbers that tell nothing are not read as no loss
        *((s, Losses(len(s), *[None] * 4)) for s in ((), (0, 0), (None,), (1, 1), (5, 1), (1, 0))),
    ],
)
def test_losses_are_counted_with_their_places_and_the_longest(sequence, losses):
    assert LossCounter().add_all(sequence).losses == losses


@pytest.mark.parametrize(
    ('sequences', 'level', 'messages', 'lost', 'silent'),
    [
        ({}, STALE, 0, 0, {'/controller/why', '/vehicle/odometry'}),
        ({'/vehicle/odometry': (1, 2, 3)}, OK, 3, 0, {'/controller/why'}),
        ({'/vehicle/odometry': (1, 2, 5)}, WARN, 3, 2, {'/controller/why'}),
        (dict.fromkeys(contract.load().topics, (1,)), OK, len(contract.load().topics), 0, {'none'}),
    ],
)
def test_the_recorder_tells_what_it_hears_and_what_was_lost(
    sequences, level, messages, lost, silent
):
    counted = {
        name: LossCounter().add_all(sequences.get(name, ())).losses
        for name in contract.load().topics
    }
    monitor, now_ns = RecordingHealth('realtime'), 10**18
    result = monitor.health(now_ns, counted)
    assert (result.name, result.level) == ('recorder', level)
    assert (result.values['messages'], result.values['lost']) == (messages, lost)
    named = set(result.values['silent'].split())
    assert silent <= named
    assert named.isdisjoint([*sequences, '/markers/vehicle'])  # the latter only on request
    if level == WARN:  # until nothing was lost for a while
        assert monitor.health(now_ns + HOLD_NS - 1, counted).level == WARN
        assert monitor.health(now_ns + HOLD_NS, counted).level == OK
