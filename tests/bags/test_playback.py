"""The right messages at the right moment of the bag; a terminal of others left as it was."""

import os
import subprocess
import sys
import termios

import pytest

from bags.errors import BagError
from bags.player_node import PlaybackClock, build_playlist
from bags.storage import read
from bags.storage.bag_writer import BagWriter
from bags.storage.rosbag2_metadata import BagTopic, qos_text
from msgs_yaml.contract import Qos

MS, S = 1_000_000, 1_000_000_000
START_NS = 5_000_000_000
BEGIN_NS = 77 * S
LATCHED = qos_text(Qos('reliable', 'transient_local', 'keep_last', 1))
PLAIN = qos_text(Qos('best_effort', 'volatile', 'keep_last', 5))
TIMEOUT_S = 30


@pytest.fixture
def make_bag(tmp_path):
    """make({topic: [ms of each message]}) -> Bag; each payload names itself, /map is latched."""

    def make(times):
        topics = [
            BagTopic(n, 'std_msgs/msg/String', 'string data\n', '', (PLAIN, LATCHED)[n == '/map'])
            for n in times
        ]
        writer = BagWriter(tmp_path / 'bag', topics, {})
        for index, (name, each) in enumerate(times.items()):
            for i, ms in enumerate(each):
                writer.write(index, START_NS + round(ms * MS), 1, f'{name}{i}'.encode(), i + 1)
        writer.close()
        return read.load(tmp_path / 'bag')

    return make


MAP = {'/map': [0, 1, 7], '/a': range(10)}
ABC = {'/a': [0], '/b': [1], '/c': [2]}
STEPS_BACK = {'/a': [0, 5, 3, 6], '/b': [4]}
PART = {'start_s': 0.005, 'duration_s': 0.002}
SENT = {
    'ties': ({'/a': [0, 2, 2], '/b': [1, 2]}, {}, '0/a0 1/b0 2/a1 2/a2 2/b1'),
    'steps back': (STEPS_BACK, {}, '0/a0 4/b0 5/a1 5/a2 6/a3'),
    'both ends': ({'/a': range(10)}, PART, '0/a5 1/a6 2/a7'),
    'latched': (MAP, PART, '0/map1 0/a5 1/a6 2/map2 2/a7'),
    'latched alone': (MAP, {'topics': ['/map'], 'start_s': 0.008}, '0/map2'),
    'chosen topics': (ABC, {'topics': ['/c', '/a']}, '0/a0 2/c0'),
    'own clock': ({'/clock': [0, 5], '/a': [1]}, {}, '0/clock0 1/a0 5/clock1'),
}


@pytest.mark.parametrize(('times', 'part', 'sent'), SENT.values(), ids=SENT)
def test_topics_meet_in_time(make_bag, times, part, sent):
    result = build_playlist(make_bag(times), **part, clock_hz=100.0 * ('/clock' in times))
    rows = zip(result.due_ns.tolist(), result.payloads)
    assert ' '.join(f'{ns // MS}{data.decode()}' for ns, data in rows) == sent
    for number, data in zip(result.topic, result.payloads):
        assert data.decode().startswith(result.topics[number].name)
    assert result.duration_ns == result.due_ns[-1]


def test_bag_without_a_clock_is_given_one_that_ticks_before_the_messages(make_bag):
    result = build_playlist(make_bag({'/a': [0, 10, 25]}), clock_hz=100.0)
    assert [result.topics[i].name for i in result.topic] == ['/clock', '/a'] * 3
    assert result.due_ns.tolist() == [0, 0, 10 * MS, 10 * MS, 20 * MS, 25 * MS]
    # CDR of builtin_interfaces/Time after the encapsulation header
    stamps = [data[4:] for i, data in zip(result.topic, result.payloads) if i == 0]
    assert [int.from_bytes(d[:4], 'little') for d in stamps] == [5, 5, 5]
    assert [int.from_bytes(d[4:], 'little') for d in stamps] == [0, 10 * MS, 20 * MS]


@pytest.mark.parametrize(
    ('part', 'why'),
    [
        ({'topics': ['/z']}, 'no message of /z; it has /a, /b, /c'),
        ({'start_s': 7.0}, 'no message from 7 s on'),
    ],
)
def test_a_part_that_is_not_there_is_refused(make_bag, part, why):
    with pytest.raises(BagError, match=why):
        build_playlist(make_bag(ABC | {'/map': [0]}), **part)


PAUSE, RESUME = (2, 'toggle'), (100, 'toggle')
# rate; whether it begins paused; (s after the begin, 'toggle') or (s, length of a step, next
# message); a position, and when [s] it takes how long to it
WAITS = {
    'rate scales time': (2.0, False, [], 10, 3, 2.0),
    'late': (2.0, False, [], 4, 3, -1.0),
    'paused before it': (1.0, False, [PAUSE], 3, 50, None),
    'due before the pause': (1.0, False, [PAUSE], 2, 9, 0.0),
    'a pause costs nothing': (1.0, False, [PAUSE, RESUME], 3, 100, 1.0),
    'a step': (1.0, True, [(0, 1, 0.5)], 1, 0, 0.0),
    'no further than a step': (1.0, True, [(0, 1, 0.5)], 1.001, 0, None),
    'at least the next message': (1.0, True, [(0, 1, 9)], 9, 0, 0.0),
    'and no further': (1.0, True, [(0, 1, 9)], 9.001, 0, None),
    'a step while playing pauses': (1.0, False, [(2, 0, 3)], 3.001, 20, None),
    'on from the last step': (1.0, True, [(0, 4, 0), (9, 'toggle')], 5, 9, 1.0),
}


@pytest.mark.parametrize(
    ('rate', 'paused', 'events', 'due_s', 'at_s', 'wait_s'), WAITS.values(), ids=WAITS
)
def test_how_long_it_takes_to_a_position(rate, paused, events, due_s, at_s, wait_s):
    clock = PlaybackClock(rate, BEGIN_NS, paused=paused)
    for begin_s, *event in events:
        now_ns = BEGIN_NS + begin_s * S
        if event == ['toggle']:
            clock.toggle(now_ns)
        else:
            clock.step(*(round(value * S) for value in event), now_ns)
    assert clock.wait_s(round(due_s * S), BEGIN_NS + at_s * S) == wait_s
    position_s = due_s if wait_s is None else due_s - wait_s * rate
    assert clock.position_ns(BEGIN_NS + at_s * S) <= round(position_s * S)


def test_no_terminal_and_that_of_others_are_left_alone():
    leader, follower = os.openpty()
    before = termios.tcgetattr(follower)
    code = 'from bags.player_node import Keyboard; print(Keyboard().attached)'
    # a session of its own, but not this terminal's: a program in the background
    for options in ({'stdin': subprocess.DEVNULL}, {'stdin': follower, 'start_new_session': True}):
        words, given = [sys.executable, '-c', code], {'timeout': TIMEOUT_S, **options}
        assert subprocess.check_output(words, text=True, **given) == 'False\n'
    assert termios.tcgetattr(follower) == before
    os.close(leader)
    os.close(follower)
