"""The right time, the right count, and no way back."""

import pytest

from bags.storage.inbox import ClockError, Filing
from bags.storage.losses import Counter, Losses
from bags.storage.rosbag2_layout import BagTopic

TOPIC = BagTopic('/t', 'nav_msgs/msg/Odometry', '', '', '')


def message(stamp_ns):
    sec, nanosec = divmod(stamp_ns, 10**9)
    return b'\0\1\0\0' + sec.to_bytes(4, 'little', signed=True) + nanosec.to_bytes(4, 'little')


@pytest.fixture
def filed():
    return []


@pytest.fixture
def filing(filed):
    def make(mode, **options):
        return Filing(TOPIC, mode, lambda *row: filed.append(row), **options)

    return make


def test_lockstep_files_under_the_stamp_and_realtime_under_the_arrival(filing, filed):
    filing('lockstep').put(message(7), 20, 30, 1)
    filing('realtime').put(message(7), 20, 30, 1)
    assert [(log_ns, publish_ns) for log_ns, publish_ns, *_ in filed] == [(7, 20), (30, 20)]


def test_stamp_that_falls_back_is_refused_and_not_filed(filing, filed):
    topic = filing('lockstep')
    for stamp_ns in (5 * 10**9, 5 * 10**9, 6 * 10**9):  # repeated while it waits: no fault
        topic.put(message(stamp_ns), 0, 0, None)
    with pytest.raises(ClockError, match=r'/t: .* backwards from 6\.0+ s to 5\.9+ s: .*two\?'):
        topic.put(message(6 * 10**9 - 1), 0, 0, None)
    assert len(filed) == 3


def test_what_has_no_stamp_is_filed_under_the_last_one(filing, filed):
    topic = filing('lockstep')
    for data in (b'', message(7), b'', message(8)):
        topic.put(data, 0, 0, None)
    assert [log_ns for log_ns, *_ in filed] == [0, 7, 7, 8]


def test_a_stamp_before_1970_is_filed_under_0_and_is_no_way_back(filing, filed):
    topic = filing('lockstep')
    for data in (message(-5), message(-(10**9)), message(7)):
        topic.put(data, 0, 0, None)
    assert [log_ns for log_ns, *_ in filed] == [0, 0, 7]
    with pytest.raises(ClockError):
        topic.put(message(-5), 0, 0, None)


def test_wall_clock_that_is_set_back_is_refused_but_a_message_sent_again_is_not(filing, filed):
    topic = filing('realtime')
    for received_ns in (10**12, 10**12 - 99_000_000):
        topic.put(message(0), 0, received_ns, None)
    with pytest.raises(ClockError, match='the clock of the machine was set back'):
        topic.put(message(0), 0, 10**12 - 300_000_000, None)
    assert len(filed) == 2


def test_several_publishers_have_several_times(filing, filed):
    topic = filing('lockstep', alone=False)
    for stamp_ns in (5 * 10**9, 10**9, 6 * 10**9):
        topic.put(message(stamp_ns), 0, 0, None)
    assert len(filed) == 3


def counted(*sequence):
    return Counter().add_all(sequence).losses


def test_gaps_are_counted_with_their_places_and_the_longest():
    assert counted(1, 2, 4, 5, 9) == Losses(received=5, lost=4, gaps=2, longest=3, before=0)


def test_what_was_sent_before_anybody_listened_is_no_loss():
    assert counted(11, 12) == Losses(2, 0, 0, 0, before=10)


@pytest.mark.parametrize('sequence', [(), (0, 0), (None,), (1, 1), (5, 1), (1, 0)])
def test_numbers_that_tell_nothing_are_not_read_as_no_loss(sequence):
    assert counted(*sequence) == Losses(len(sequence), None, None, None, None)
