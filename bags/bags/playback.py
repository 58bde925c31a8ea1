"""When each message of a bag is sent: playlist, clock, and the keys that control a player. No ROS.

build_playlist   the messages of a part of a bag in the order in which they are sent
PlaybackClock    the position in the bag at an instant of the wall clock
Keyboard         single keys of a terminal
"""

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

CLOCK = BagTopic(
    name='/clock',
    type='rosgraph_msgs/msg/Clock',
    schema='',  # sent, never written
    type_hash='',
    qos=qos_text('keep_last', 1, 'reliable', 'volatile'),
)
CLOCK_CDR = struct.Struct('<4siI')
# of the nodes of the recording: sent again, they would be taken for those of the nodes that run
OF_NODES = ('rcl_interfaces/msg/Log', 'lifecycle_msgs/msg/TransitionEvent')
LITTLE_ENDIAN = b'\x00\x01\x00\x00'
KEY_POLL_S = 0.1  # longest time until `Keyboard.close` is noticed


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

    def __repr__(self):
        return f'Playlist({len(self.payloads)} messages, {self.duration_ns / NS_PER_S:.3f} s)'


def build_playlist(bag: read.Bag, part: Part = WHOLE_BAG, clock_hz: float = 0.0) -> Playlist:
    """Return the messages of a part; each topic keeps its order, topics are merged by log time.

    Of a latched topic the last message before the part is sent at its start. A part without
    messages of /clock gets some, `clock_hz` per second of the bag, unless that is 0. Raises
    BagError for a topic that is not in the bag, and for a part without messages.
    """
    present = {name: r for name, r in bag.recordings.items() if r.payloads}
    for name in part.topics:
        if name not in present:
            raise BagError(f'{bag.path}: no message of {name}; it has {", ".join(present)}')
    names = part.topics or [n for n, r in present.items() if r.topic.type not in OF_NODES]
    selected = [recorded for name, recorded in present.items() if name in names]
    # within a topic the file has the order of arrival, times may repeat or step back a little
    times = [np.maximum.accumulate(recorded.log_ns) for recorded in selected]
    first_ns = min(int(t[0]) for t in times) + round(part.start_s * NS_PER_S)
    last_ns = max(int(t[-1]) for t in times)
    if part.duration_s:
        last_ns = min(last_ns, first_ns + round(part.duration_s * NS_PER_S))
    rows = []
    for recorded, t in zip(selected, times):
        begin, end = np.searchsorted(t, [first_ns, last_ns + 1]).tolist()
        # a late subscriber gets the last message before the part
        profiles = parse_qos(recorded.topic.qos)
        is_latched = any(profile['durability'] == 'transient_local' for profile in profiles)
        rows.append(np.arange(begin - (begin > 0 and is_latched), max(begin, end)))
    if not sum(map(len, rows)):
        raise BagError(f'{bag.path}: no message from {part.start_s:g} s on; nothing to play')
    due = [np.maximum(t[i] - first_ns, 0) for t, i in zip(times, rows)]
    payloads = [data for r, i in zip(selected, rows) for data in map(r.payloads.__getitem__, i)]
    topics = [recorded.topic for recorded in selected]
    if clock_hz and not any(t.name == CLOCK.name and len(i) for t, i in zip(topics, rows)):
        # before everything else: of equal times it is sent first
        ticks = np.arange(0, last_ns - first_ns + 1, round(NS_PER_S / clock_hz))
        topics, due = [CLOCK, *topics], [ticks, *due]
        clocks = (divmod(ns, NS_PER_S) for ns in (first_ns + ticks).tolist())
        payloads = [*(CLOCK_CDR.pack(LITTLE_ENDIAN, *clock) for clock in clocks), *payloads]
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


class PlaybackClock:
    """Moves through a bag at `rate` s per second of wall time; stands still while paused.

    Times are ns: `now_ns` of any steady clock, which callers read, positions from the start of
    what is played.
    """

    def __init__(self, rate: float, now_ns: int, paused: bool = False):
        self.rate = rate
        self.paused = paused
        self._position_ns, self._since_ns = 0, now_ns

    def position_ns(self, now_ns: int) -> int:
        """Return the position in the bag."""
        if self.paused:
            return self._position_ns
        return self._position_ns + round((now_ns - self._since_ns) * self.rate)

    def wait_s(self, due_ns: int, now_ns: int) -> float | None:
        """Return how long it takes to a position, at most 0 when it is reached.

        None while paused before it: only a key brings it nearer.
        """
        ahead_ns = due_ns - self.position_ns(now_ns)
        if self.paused and ahead_ns > 0:
            return None
        return ahead_ns / self.rate / NS_PER_S

    def toggle(self, now_ns: int) -> None:
        """Pause, or resume where the pause or its last step ended."""
        self._stand(now_ns)
        self.paused = not self.paused

    def _stand(self, now_ns):
        self._position_ns, self._since_ns = self.position_ns(now_ns), now_ns

    def step(self, length_ns: int, next_ns: int, now_ns: int) -> None:
        """Pause and advance by `length_ns` of the bag, at least up to `next_ns`."""
        self._stand(now_ns)
        self.paused = True
        self._position_ns = max(self._position_ns + length_ns, next_ns)


class Keyboard:
    """Calls `pressed(key)`, from a thread of its own, for every key until `close`.

    Does nothing where standard input is no terminal, or that of a foreground program while this
    one is in the background. Ctrl-C stays a signal. `close` restores the terminal.
    """

    def __init__(self, pressed: Callable[[str], None]):
        self._pressed, self._closing = pressed, False
        # a background process that changes the terminal is stopped by it
        try:
            terminal = sys.stdin.isatty() and os.tcgetpgrp(sys.stdin.fileno())
            self.attached = terminal == os.getpgrp()
        except (OSError, ValueError, AttributeError):  # closed, or none at all
            self.attached = False
        if self.attached:
            self._descriptor = sys.stdin.fileno()
            self._before = termios.tcgetattr(self._descriptor)
            tty.setcbreak(self._descriptor)
            self._thread = Thread(target=self._read, daemon=True)
            self._thread.start()

    def _read(self):
        while not self._closing:
            ready, _, _ = select.select([self._descriptor], [], [], KEY_POLL_S)
            keys = os.read(self._descriptor, 1) if ready else b''
            if ready and not keys:  # the terminal was closed
                return
            for key in keys.decode('ascii', 'ignore'):
                self._pressed(key)

    def close(self) -> None:
        """Stop reading, restore the terminal."""
        self._closing = True
        if self.attached:
            self._thread.join()
            termios.tcsetattr(self._descriptor, termios.TCSADRAIN, self._before)
