"""The right messages, in the right order, at the right moment of the bag."""

import pytest

from bags.errors import BagError
from bags.playback import Part, PlaybackClock, build_playlist
from bags.storage import read
from bags.storage.bag_writer import BagWriter
from bags.storage.rosbag2_metadata import BagTopic, qos_text

MS, S = 1_000_000, 1_000_000_000
START_NS = 5_000_000_000
BEGIN_NS = 77 * S
LATCHED = qos_text('keep_last', 1, 'reliable', 'transient_local')
PLAIN = qos_text('keep_last', 5, 'best_effort', 'volatile')


@pytest.fixture
def make_bag(tmp_path):
    """make({topic: [ms of each message]}, latched=[topic]) -> Bag; each payload names itself."""

    def make(times, latched=()):
        topics = [
            BagTopic(n, 'std_msgs/msg/String', 'string data\n', '', (PLAIN, LATCHED)[n in latched])
            for n in times
        ]
        writer = BagWriter(tmp_path / 'bag', topics, {})
        for index, (name, each) in enumerate(times.items()):
            for i, ms in enumerate(each):
                writer.write(index, START_NS + round(ms * MS), 1, f'{name}{i}'.encode(), i + 1)
        writer.close()
        return read.load(tmp_path / 'bag')

    return make


def sent(made):
    return [(ns / MS, data.decode()) for ns, data in zip(made.due_ns.tolist(), made.payloads)]


def test_topics_meet_in_time_and_ties_keep_the_order_of_the_bag(make_bag):
    result = build_playlist(make_bag({'/a': [0, 2, 2], '/b': [1, 2]}))
    assert sent(result) == [(0, '/a0'), (1, '/b0'), (2, '/a1'), (2, '/a2'), (2, '/b1')]
    assert [result.topics[i].name for i in result.topic] == ['/a', '/b', '/a', '/a', '/b']
    assert result.first_ns == START_NS
    assert result.duration_ns == 2 * MS


def test_topic_whose_times_step_back_keeps_its_order(make_bag):
    result = build_playlist(make_bag({'/a': [0, 5, 3, 6], '/b': [4]}))
    assert sent(result) == [(0, '/a0'), (4, '/b0'), (5, '/a1'), (5, '/a2'), (6, '/a3')]


def test_part_has_both_its_ends(make_bag):
    bag = make_bag({'/a': range(10)})
    result = build_playlist(bag, Part(start_s=0.003, duration_s=0.002))
    assert sent(result) == [(0, '/a3'), (1, '/a4'), (2, '/a5')]
    assert result.duration_ns == 2 * MS


def test_latched_message_in_force_is_sent_at_the_start_of_a_part(make_bag):
    bag = make_bag({'/map': [0, 1, 7], '/a': range(10)}, latched=['/map'])
    result = build_playlist(bag, Part(start_s=0.005, duration_s=0.002))
    assert sent(result) == [(0, '/map1'), (0, '/a5'), (1, '/a6'), (2, '/map2'), (2, '/a7')]


def test_only_the_topics_asked_for_are_sent(make_bag):
    bag = make_bag({'/a': [0], '/b': [1], '/c': [2]})
    assert sent(build_playlist(bag, Part(topics=['/c', '/a']))) == [(0, '/a0'), (2, '/c0')]


def test_bag_without_a_clock_is_given_one_that_ticks_before_the_messages(make_bag):
    result = build_playlist(make_bag({'/a': [0, 10, 25]}), clock_hz=100.0)
    assert [result.topics[i].name for i in result.topic] == ['/clock', '/a'] * 3
    assert result.due_ns.tolist() == [0, 0, 10 * MS, 10 * MS, 20 * MS, 25 * MS]
    # CDR of builtin_interfaces/Time after the encapsulation header
    stamps = [data[4:] for i, data in zip(result.topic, result.payloads) if i == 0]
    assert [int.from_bytes(d[:4], 'little') for d in stamps] == [5, 5, 5]
    assert [int.from_bytes(d[4:], 'little') for d in stamps] == [0, 10 * MS, 20 * MS]


def test_recorded_clock_is_the_only_one(make_bag):
    result = build_playlist(make_bag({'/clock': [0, 5], '/a': [1]}), clock_hz=100.0)
    assert sent(result) == [(0, '/clock0'), (1, '/a0'), (5, '/clock1')]


def test_no_clock_is_made_where_none_is_wanted(make_bag):
    assert len(build_playlist(make_bag({'/a': [0, 100]})).payloads) == 2


def test_topic_that_is_not_there_is_refused_with_those_that_are(make_bag):
    with pytest.raises(BagError, match='no message of /c; it has /a, /b'):
        build_playlist(make_bag({'/a': [0], '/b': [0]}), Part(topics=['/c']))


def test_part_behind_the_end_is_refused(make_bag):
    with pytest.raises(BagError, match='no message from 7 s on'):
        build_playlist(make_bag({'/a': [0, 10]}), Part(start_s=7.0))


def test_rate_scales_time():
    clock = PlaybackClock(2.0, BEGIN_NS)
    assert clock.position_ns(BEGIN_NS + 3 * S) == 6 * S
    assert clock.wait_s(10 * S, BEGIN_NS + 3 * S) == 2.0
    assert clock.wait_s(4 * S, BEGIN_NS + 3 * S) == -1.0


def test_pause_costs_no_moment_of_the_bag():
    clock = PlaybackClock(1.0, BEGIN_NS)
    clock.toggle(BEGIN_NS + 2 * S)
    assert clock.position_ns(BEGIN_NS + 50 * S) == 2 * S
    assert clock.wait_s(3 * S, BEGIN_NS + 50 * S) is None
    clock.toggle(BEGIN_NS + 100 * S)
    assert clock.wait_s(3 * S, BEGIN_NS + 100 * S) == 1.0


def test_what_was_due_before_the_pause_is_still_due():
    clock = PlaybackClock(1.0, BEGIN_NS)
    clock.toggle(BEGIN_NS + 2 * S)
    assert clock.wait_s(2 * S, BEGIN_NS + 9 * S) == 0.0


def test_step_brings_a_stretch_and_at_least_the_next_message():
    clock = PlaybackClock(1.0, BEGIN_NS, paused=True)
    clock.step(S, S // 2, BEGIN_NS)
    assert clock.wait_s(S, BEGIN_NS) == 0.0
    assert clock.wait_s(S + 1, BEGIN_NS) is None
    clock.step(S, 9 * S, BEGIN_NS)
    assert clock.wait_s(9 * S, BEGIN_NS) == 0.0
    assert clock.wait_s(9 * S + 1, BEGIN_NS) is None


def test_step_while_playing_pauses():
    clock = PlaybackClock(1.0, BEGIN_NS)
    clock.step(0, 3 * S, BEGIN_NS + 2 * S)
    assert clock.paused
    assert clock.position_ns(BEGIN_NS + 20 * S) == 3 * S


def test_playing_goes_on_from_the_last_step():
    clock = PlaybackClock(1.0, BEGIN_NS, paused=True)
    clock.step(4 * S, 0, BEGIN_NS)
    clock.toggle(BEGIN_NS + 9 * S)
    assert not clock.paused
    assert clock.wait_s(5 * S, BEGIN_NS + 9 * S) == 1.0
