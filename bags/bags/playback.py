"""Which moment of a bag it is at an instant of the wall clock. It reads no clock itself.

Keys of a terminal, one by one as they are pressed, without Enter.

What of a bag is sent when: the part, the topics, and a clock where none was recorded. No ROS."""

import os
import select
import struct
import sys
import termios
import tty
from collections.abc import Callable, Collection
from threading import Thread
from typing import NamedTuple

import numpy as np

from bags.errors import BagError
from bags.storage import read
from bags.storage.rosbag2_metadata import BagTopic, parse_qos, qos_text
from msgs_yaml.conversions import NS_PER_S


class PlaybackClock:
    """Moves through a bag at `rate` s per second of wall time; stands still while paused.

    Times are ns: `now_ns` of any steady clock, positions from the start of what is played.
    """

    def __init__(self, rate: float, now_ns: int, paused: bool = False):
        self.rate = rate
        self.paused = paused
        self._at_ns, self._since_ns = 0, now_ns

    def position_ns(self, now_ns: int) -> int:
        """Return the moment of the bag."""
        if self.paused:
            return self._at_ns
        return self._at_ns + round((now_ns - self._since_ns) * self.rate)

    def wait_s(self, due_ns: int, now_ns: int) -> float | None:
        """Return how long it is until a moment of the bag, at most 0 when it has come.

        None while paused before it: only a key brings it nearer.
        """
        ahead_ns = due_ns - self.position_ns(now_ns)
        if self.paused and ahead_ns > 0:
            return None
        return ahead_ns / self.rate / NS_PER_S

    def toggle(self, now_ns: int) -> None:
        """Pause, or go on from where the pause or its last step ended."""
        self._at_ns, self._since_ns = self.position_ns(now_ns), now_ns
        self.paused = not self.paused

    def step(self, length_ns: int, next_ns: int, now_ns: int) -> None:
        """Pause and let another `length_ns` of the bag come, at least up to `next_ns`."""
        if not self.paused:
            self.toggle(now_ns)
        self._at_ns = max(self._at_ns + length_ns, next_ns)


WAKE_S = 0.1  # longest time until `close` is noticed


class Keyboard:
    """Calls `pressed(key)`, from a thread of its own, for every key until `close`.

    Does nothing where standard input is no terminal, or that of a program in the foreground while
    this one is in the background. Ctrl-C stays a signal. `close` gives the terminal back as it was.
    """

    def __init__(self, pressed: Callable[[str], None]):
        self._pressed = pressed
        self._closing = False
        self._thread = self._before = None
        self.attached = _in_the_foreground()
        if self.attached:
            self._descriptor = sys.stdin.fileno()
            self._before = termios.tcgetattr(self._descriptor)
            tty.setcbreak(self._descriptor)
            self._thread = Thread(target=self._read, daemon=True)
            self._thread.start()

    def _read(self):
        while not self._closing:
            ready, _, _ = select.select([self._descriptor], [], [], WAKE_S)
            keys = os.read(self._descriptor, 1) if ready else b''
            if ready and not keys:  # the terminal is gone
                return
            for key in keys.decode('ascii', 'ignore'):
                self._pressed(key)

    def close(self) -> None:
        """Stop reading, restore the terminal."""
        self._closing = True
        if self._thread is not None:
            self._thread.join()
            self._thread = None
            termios.tcsetattr(self._descriptor, termios.TCSADRAIN, self._before)


def _in_the_foreground():
    # whoever changes the terminal from the background is stopped by it
    try:
        return sys.stdin.isatty() and os.tcgetpgrp(sys.stdin.fileno()) == os.getpgrp()
    except (OSError, ValueError, AttributeError):  # closed, or none at all
        return False


CLOCK = BagTopic(
    name='/clock',
    type='rosgraph_msgs/msg/Clock',
    schema='',  # sent, never written
    type_hash='',
    qos=qos_text('keep_last', 1, 'reliable', 'volatile'),
)
CLOCK_CDR = struct.Struct('<4siI')
LITTLE_ENDIAN = b'\x00\x01\x00\x00'


class Part(NamedTuple):
    """Which part of a bag; durations in s of the bag."""

    start_s: float = 0.0
    duration_s: float = 0.0  # 0: to the end
    topics: Collection[str] = ()  # none: all


WHOLE_BAG = Part()


class Playlist(NamedTuple):
    """n messages in the order in which they are sent."""

    topics: tuple[BagTopic, ...]
    due_ns: np.ndarray  # (n,) int64, from the start of the part, never decreasing
    topic: np.ndarray  # (n,) index into `topics`
    payloads: list[bytes]  # CDR with its encapsulation header
    first_ns: int  # log time at the start of the part
    duration_ns: int


def build_playlist(bag: read.Bag, part: Part = WHOLE_BAG, clock_hz: float = 0.0) -> Playlist:
    """Return the messages of a part; each topic keeps its order, topics meet in log time.

    Of a latched topic the last message before the part is sent at its start. A part without
    messages of /clock is given some, `clock_hz` per second of the bag, unless that is 0. Raises
    BagError for a topic that the bag has not, and for a part without messages.
    """
    chosen = _selected(bag, part.topics)
    # within a topic the file has the order of arrival, times may repeat or step back a little
    times = [np.maximum.accumulate(recorded.log_ns) for recorded in chosen]
    first_ns = min(int(t[0]) for t in times) + round(part.start_s * NS_PER_S)
    last_ns = max(int(t[-1]) for t in times)
    if part.duration_s:
        last_ns = min(last_ns, first_ns + round(part.duration_s * NS_PER_S))
    rows = [_rows(r, t, first_ns, last_ns) for r, t in zip(chosen, times)]
    if not sum(map(len, rows)):
        raise BagError(f'{bag.path}: no message from {part.start_s:g} s on; nothing to play')
    due = [np.maximum(t[i] - first_ns, 0) for t, i in zip(times, rows)]
    payloads = [data for r, i in zip(chosen, rows) for data in map(r.payloads.__getitem__, i)]
    topics = [recorded.topic for recorded in chosen]
    if clock_hz and not any(t.name == CLOCK.name and len(i) for t, i in zip(topics, rows)):
        # before everything else: of equal times it is sent first
        ticks = np.arange(0, last_ns - first_ns + 1, round(NS_PER_S / clock_hz))
        topics, due = [CLOCK, *topics], [ticks, *due]
        payloads = [*_clock_messages(first_ns + ticks), *payloads]
    number = np.repeat(np.arange(len(due)), [len(d) for d in due])
    due = np.concatenate(due)
    order = np.argsort(due, kind='stable')
    return Playlist(
        topics=tuple(topics),
        due_ns=due[order],
        topic=number[order],
        payloads=[payloads[i] for i in order],
        first_ns=first_ns,
        duration_ns=last_ns - first_ns,
    )


def _selected(bag, names):
    present = {name: r for name, r in bag.recordings.items() if r.payloads}
    for name in names:
        if name not in present:
            raise BagError(f'{bag.path}: no message of {name}; it has {", ".join(present)}')
    return [present[name] for name in present if not names or name in names]


def _rows(recorded, times, first_ns, last_ns):
    """Rows of the part, with the latched message that was in force at its start."""
    begin, end = np.searchsorted(times, [first_ns, last_ns + 1]).tolist()
    is_latched = begin > 0 and 'transient_local' in (
        profile['durability'] for profile in parse_qos(recorded.topic.qos)
    )
    return np.arange(begin - is_latched, max(begin, end))


def _clock_messages(times_ns):
    return [CLOCK_CDR.pack(LITTLE_ENDIAN, *divmod(ns, NS_PER_S)) for ns in times_ns.tolist()]
