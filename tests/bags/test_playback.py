"""The right messages at the right moment of the bag; keys, and a terminal left as it was."""

import fcntl
import os
import subprocess
import sys
import termios

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


TEN = {'/a': range(10)}
MAP = {'/map': [0, 1, 7], '/a': range(10)}
ABC = {'/a': [0], '/b': [1], '/c': [2]}


@pytest.mark.parametrize(
    ('times', 'part', 'clock_hz', 'sent'),
    [
        pytest.param(
            {'/a': [0, 2, 2], '/b': [1, 2]}, {}, 0.0, '0/a0 1/b0 2/a1 2/a2 2/b1', id='ties'
        ),
        pytest.param(
            {'/a': [0, 5, 3, 6], '/b': [4]}, {}, 0.0, '0/a0 4/b0 5/a1 5/a2 6/a3', id='steps back'
        ),
        pytest.param(
            TEN, {'start_s': 0.003, 'duration_s': 0.002}, 0.0, '0/a3 1/a4 2/a5', id='both ends'
        ),
        pytest.param(
            MAP,
            {'start_s': 0.005, 'duration_s': 0.002},
            0.0,
            '0/map1 0/a5 1/a6 2/map2 2/a7',
            id='latched',
        ),
        pytest.param(ABC, {'topics': ['/c', '/a']}, 0.0, '0/a0 2/c0', id='chosen topics'),
        pytest.param(
            {'/clock': [0, 5], '/a': [1]}, {}, 100.0, '0/clock0 1/a0 5/clock1', id='own clock'
        ),
    ],
)
def test_topics_meet_in_time(make_bag, times, part, clock_hz, sent):
    result = build_playlist(make_bag(times), Part(**part), clock_hz)
    rows = zip(result.due_ns.tolist(), result.payloads)
    assert ' '.join(f'{ns // MS}{data.decode()}' for ns, data in rows) == sent
    for number, data in zip(result.topic, result.payloads):
        assert data.decode().startswith(result.topics[number].name)
    assert result.first_ns == START_NS + round(part.get('start_s', 0.0) * S)
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
        (Part(topics=['/z']), 'no message of /z; it has /a, /b, /c'),
        (Part(start_s=7.0), 'no message from 7 s on'),
    ],
)
def test_a_part_that_is_not_there_is_refused(make_bag, part, why):
    with pytest.raises(BagError, match=why):
        build_playlist(make_bag(ABC), part)


def after(clock, *events):
    """Return a clock after events: (seconds after the begin, 'toggle') or (..., length, next)."""
    for at_s, *event in events:
        now_ns = BEGIN_NS + round(at_s * S)
        if event == ['toggle']:
            clock.toggle(now_ns)
        else:
            clock.step(*(round(value * S) for value in event), now_ns)
    return clock


@pytest.mark.parametrize(
    ('rate', 'paused', 'events', 'due_s', 'at_s', 'wait_s'),
    [
        pytest.param(2.0, False, [], 10, 3, 2.0, id='rate scales time'),
        pytest.param(2.0, False, [], 4, 3, -1.0, id='late'),
        pytest.param(1.0, False, [(2, 'toggle')], 3, 50, None, id='paused before it'),
        pytest.param(1.0, False, [(2, 'toggle')], 2, 9, 0.0, id='due before the pause'),
        pytest.param(
            1.0, False, [(2, 'toggle'), (100, 'toggle')], 3, 100, 1.0, id='a pause costs nothing'
        ),
        pytest.param(1.0, True, [(0, 1, 0.5)], 1, 0, 0.0, id='a step'),
        pytest.param(1.0, True, [(0, 1, 0.5)], 1.001, 0, None, id='no further than a step'),
        pytest.param(1.0, True, [(0, 1, 9)], 9, 0, 0.0, id='at least the next message'),
        pytest.param(1.0, True, [(0, 1, 9)], 9.001, 0, None, id='and no further'),
        pytest.param(1.0, False, [(2, 0, 3)], 3.001, 20, None, id='a step while playing pauses'),
        pytest.param(1.0, True, [(0, 4, 0), (9, 'toggle')], 5, 9, 1.0, id='on from the last step'),
    ],
)
def test_how_long_it_takes_to_a_position(rate, paused, events, due_s, at_s, wait_s):
    clock = after(PlaybackClock(rate, BEGIN_NS, paused=paused), *events)
    assert clock.wait_s(round(due_s * S), BEGIN_NS + at_s * S) == wait_s
    position_s = due_s if wait_s is None else due_s - wait_s * rate
    assert clock.position_ns(BEGIN_NS + at_s * S) <= round(position_s * S)


PROGRAM = """
import sys
from bags.playback import Keyboard
from queue import SimpleQueue
keys = SimpleQueue()
keyboard = Keyboard(keys.put)
print('attached' if keyboard.attached else 'alone', flush=True)
while keyboard.attached and (key := keys.get(timeout=20)) != 'q':
    print(f'key {key!r}', flush=True)
keyboard.close()
"""


def start(stdin, **options):
    return subprocess.Popen(
        [sys.executable, '-c', PROGRAM], stdin=stdin, stdout=subprocess.PIPE, text=True, **options
    )


@pytest.fixture
def terminal():
    leader, follower = os.openpty()
    yield leader, follower
    os.close(leader)
    os.close(follower)


def test_keys_come_without_enter_and_the_terminal_is_restored(terminal):
    leader, follower = terminal
    before = termios.tcgetattr(follower)
    # as a shell would in the foreground of this terminal
    program = start(
        follower,
        start_new_session=True,
        preexec_fn=lambda: fcntl.ioctl(0, termios.TIOCSCTTY, 0),
    )
    try:
        assert program.stdout.readline() == 'attached\n'
        assert not termios.tcgetattr(follower)[3] & termios.ICANON
        os.write(leader, b' s')
        assert program.stdout.readline() == "key ' '\n"
        assert program.stdout.readline() == "key 's'\n"
        os.write(leader, b'q')
        assert program.wait(TIMEOUT_S) == 0
        assert termios.tcgetattr(follower) == before
    finally:
        program.kill()


def test_no_terminal_and_that_of_others_are_left_alone(terminal):
    _, follower = terminal
    before = termios.tcgetattr(follower)
    # a session of its own, but not this terminal's: a program in the background
    programs = [start(subprocess.DEVNULL), start(follower, start_new_session=True)]
    for program in programs:
        assert program.communicate(timeout=TIMEOUT_S)[0] == 'alone\n'
    assert termios.tcgetattr(follower) == before
