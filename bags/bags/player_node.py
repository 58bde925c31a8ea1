"""Plays a bag: publishes the recorded bytes at the intervals of their log times.

Its topics are those of the bag, in the namespace of the node. In a terminal the keys pause it
(space), step (s) and quit (q).

build_playlist   the messages of a part of a bag in the order in which they are sent
PlaybackClock    the position in the bag at an instant of the wall clock
Keyboard         single keys of a terminal
"""

import os
import select
import sys
import termios
import time
import traceback
import tty
from collections.abc import Collection
from importlib import import_module
from threading import Thread
from typing import Annotated, NamedTuple

import numpy as np
from rclpy.node import Node

from bags.errors import BagError
from bags.storage import read
from bags.storage.rosbag2_metadata import DEPTH, BagTopic, parse_qos, qos_text
from msgs_yaml import encode, share
from msgs_yaml.contract import Qos
from msgs_yaml.conversions import NS_PER_S
from node_runtime import ros, spin_node
from node_runtime.parameters import ParameterError, Range, Struct

PLAIN = Qos('reliable', 'volatile', 'keep_last', DEPTH)  # of a topic whose QoS is not in the bag
PAUSE, STEP, QUIT = ' ', 's', 'q'
HELP = 'space: pause and resume, s: step, q: quit'
NS_PER_MS = 1e6
CLOCK = BagTopic(
    name='/clock',
    type='rosgraph_msgs/msg/Clock',
    schema='',  # sent, never written
    type_hash='',
    qos=qos_text(Qos('reliable', 'volatile', 'keep_last', 1)),
)
# of the nodes of the recording: sent again, they would be taken for those of the nodes that run
OF_NODES = ('rcl_interfaces/msg/Log', 'lifecycle_msgs/msg/TransitionEvent')


class Playlist(NamedTuple):
    """n messages in the order in which they are sent."""

    topics: tuple[BagTopic, ...]
    due_ns: np.ndarray  # (n,) int64, from the start of the part, never decreasing
    topic: np.ndarray  # (n,) index into `topics`
    payloads: list[bytes]  # CDR with its encapsulation header
    duration_ns: int

    def __repr__(self):
        return f'Playlist({len(self.payloads)} messages, {self.duration_ns / NS_PER_S:.3f} s)'


def build_playlist(
    bag: read.Bag,
    start_s: float = 0.0,
    duration_s: float = 0.0,
    topics: Collection[str] = (),
    clock_hz: float = 0.0,
) -> Playlist:
    """Return the messages of a part; each topic keeps its order, topics are merged by log time.

    It begins `start_s` after the first message and lasts `duration_s` of the bag, 0: to the end;
    no `topics`: all but those of nodes. Of a latched topic the last message before the part is sent
    at its start. A part without messages of /clock gets some, `clock_hz` per second of the bag,
    unless that is 0. Raises BagError for a topic that is not in the bag, and for a part without
    messages.
    """
    present = {name: r for name, r in bag.recordings.items() if r.payloads}
    for name in topics:
        if name not in present:
            raise BagError(f'{bag.path}: no message of {name}; it has {", ".join(present)}')
    names = topics or [n for n, r in present.items() if r.topic.type not in OF_NODES]
    selected = [recorded for name, recorded in present.items() if name in names]
    # within a topic the file has the order of arrival, times may repeat or step back a little
    times = [np.maximum.accumulate(recorded.log_ns) for recorded in selected]
    first_ns = min(int(t[0]) for t in times) + round(start_s * NS_PER_S)
    last_ns = max(first_ns, *(int(t[-1]) for t in times))
    if duration_s:
        last_ns = min(last_ns, first_ns + round(duration_s * NS_PER_S))
    rows = []
    for recorded, t in zip(selected, times):
        begin, end = np.searchsorted(t, [first_ns, last_ns + 1]).tolist()
        # a late subscriber gets the last message before the part
        is_latched = any(q.durability == 'transient_local' for q in parse_qos(recorded.topic.qos))
        rows.append(np.arange(begin - (begin > 0 and is_latched), max(begin, end)))
    if not sum(map(len, rows)) or first_ns > max(int(r.log_ns[-1]) for r in present.values()):
        raise BagError(f'{bag.path}: no message from {start_s:g} s on; nothing to play')
    due = [np.maximum(t[i] - first_ns, 0) for t, i in zip(times, rows)]
    payloads = [data for r, i in zip(selected, rows) for data in map(r.payloads.__getitem__, i)]
    sent = [recorded.topic for recorded in selected]
    if clock_hz and not any(t.name == CLOCK.name and len(i) for t, i in zip(sent, rows)):
        # before everything else: of equal times it is sent first
        ticks = np.arange(0, last_ns - first_ns + 1, round(NS_PER_S / clock_hz))
        sent, due = [CLOCK, *sent], [ticks, *due]
        clocks = map(encode.clock, (first_ns + ticks).tolist())
        payloads = [*map(ros.serialize, clocks), *payloads]
    number = np.repeat(np.arange(len(due)), [len(d) for d in due])
    due = np.concatenate(due)
    order = np.argsort(due, kind='stable')
    return Playlist(
        topics=tuple(sent),
        due_ns=due[order],
        topic=number[order],
        payloads=[payloads[i] for i in order],
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
    """Reads single keys of the terminal, until `close` restores it.

    There are none where standard input is no terminal, or that of a foreground program while this
    one is in the background. Ctrl-C stays a signal.
    """

    def __init__(self):
        pressed, self._presses = os.pipe()  # keys from `press`
        self._inputs = [pressed]
        # a background process that changes the terminal is stopped by it
        try:
            terminal = sys.stdin.isatty() and os.tcgetpgrp(sys.stdin.fileno())
            self.attached = terminal == os.getpgrp()
        except (OSError, ValueError, AttributeError):  # closed, or none at all
            self.attached = False
        if self.attached:
            self._inputs.append(sys.stdin.fileno())
            self._before = termios.tcgetattr(sys.stdin)
            tty.setcbreak(sys.stdin)

    def next_key(self, wait_s: float | None) -> str:
        """Return the next key, '' for none within `wait_s`; None waits without limit."""
        ready, _, _ = select.select(self._inputs, [], [], wait_s)
        keys = os.read(ready[-1], 1) if ready else b''
        if ready and not keys:
            self._inputs.remove(ready[-1])  # the terminal was closed
        return keys.decode('ascii', 'ignore')

    def press(self, key: str) -> None:
        """Press a key from another thread."""
        os.write(self._presses, key.encode())

    def close(self) -> None:
        """Restore the terminal."""
        if self.attached:
            termios.tcsetattr(sys.stdin, termios.TCSADRAIN, self._before)


class PlayerParams(Struct):
    """Parameters of the player, see config/player.yaml."""

    bag: str
    rate: Annotated[float, Range(0.001, 1000.0, 's/s')]
    start_s: Annotated[float, Range(0.0, 1e9, 's')]
    duration_s: Annotated[float, Range(0.0, 1e9, 's')]
    loop: bool
    topics: tuple[str, ...]
    clock_hz: Annotated[float, Range(0.0, 1000.0, '1/s')]
    paused: bool
    step_s: Annotated[float, Range(0.0, 1e9, 's')]
    delay_s: Annotated[float, Range(0.0, 60.0, 's')]


class PlayerNode(Node):
    """Publishes from a thread of its own, so that the node serves its parameters meanwhile."""

    def __init__(self):
        super().__init__('player')
        defaults = share.path('bags', 'config', 'player.yaml')
        self.params = ros.declare(self, PlayerParams, defaults)
        if not self.params.bag:
            raise ParameterError('bag: is missing; it names the bag to play')
        names = ('start_s', 'duration_s', 'topics', 'clock_hz')
        part = {name: getattr(self.params, name) for name in names}
        try:
            self.bag = read.load(self.params.bag, warn=False)  # logged below
            self.playlist = build_playlist(self.bag, **part)
        except BagError as error:
            raise ParameterError(f'bag: {error}') from error
        if self.bag.damage:
            self.get_logger().warning(self.bag.damage)
        self.topic_publishers = list(map(self._publisher, self.playlist.topics))
        self.keyboard = Keyboard()
        if self.params.paused and not self.keyboard.attached:
            raise ParameterError('paused: is true, but no keyboard is attached to resume')
        self.thread = Thread(target=self._play_guarded, daemon=True)
        self.thread.start()

    def _publisher(self, topic):
        """Return the publisher of a topic, None where its type is not installed."""
        package, _, name = topic.type.split('/')
        try:
            kind = getattr(import_module(f'{package}.msg'), name)
        except (ImportError, AttributeError):
            self.get_logger().warning(f'{topic.name}: {topic.type} is not installed; left out')
            return None
        (offered, *_) = [*parse_qos(topic.qos), PLAIN]
        name, profile = ros.relative_name(topic.name), ros.to_qos_profile(offered)
        return ros.BlockingPublisher(self, self.create_publisher(kind, name, profile))

    def _play_guarded(self):
        code = 1
        try:
            self._play()
            code = 0
        except Exception:
            traceback.print_exc()
        spin_node.finish(self, code)

    def _play(self):
        while ros.missing_subscriptions(self, {}):  # of recorders
            if self.keyboard.next_key(0.01) == QUIT:
                return
        if self.keyboard.next_key(self.params.delay_s) == QUIT:
            return
        playlist, paused = self.playlist, self.params.paused
        self.get_logger().info(
            f'playing {self.bag.path}: {len(playlist.payloads)} messages, '
            f'{playlist.duration_ns / NS_PER_S:.3f} s at rate {self.params.rate:g}'
            + (f'; {HELP}' if self.keyboard.attached else '')
        )
        while self._play_once(paused) and self.params.loop:
            paused = False

    def _play_once(self, paused):
        """Publish everything once; return False when the user quits."""
        clock = PlaybackClock(self.params.rate, time.monotonic_ns(), paused)
        late_ns = []
        rows = zip(self.playlist.due_ns.tolist(), self.playlist.topic.tolist())
        for (due_ns, topic), data in zip(rows, self.playlist.payloads):
            if not self._wait(clock, due_ns):
                self.get_logger().info(f'ended at {due_ns / NS_PER_S:.3f} s')
                return False
            if not clock.paused:
                late_ns.append(-clock.wait_s(due_ns, time.monotonic_ns()) * NS_PER_S)
            if self.topic_publishers[topic] is not None:
                self.topic_publishers[topic].send(data)
        text = f'played {len(self.playlist.payloads)} messages'
        if late_ns:
            p50, p99, most = np.percentile(late_ns, [50, 99, 100]) / NS_PER_MS
            text += f', late by {p50:.2f} ms (median), {p99:.2f} ms (p99), {most:.2f} ms (max)'
        self.get_logger().info(text)
        if self.bag.damage:
            self.get_logger().warning(self.bag.damage)
        return True

    def _wait(self, clock, due_ns):
        """Wait for a position in the bag and handle keys; return False to quit."""
        while True:
            wait_s = clock.wait_s(due_ns, time.monotonic_ns())
            is_due = wait_s is not None and wait_s <= 0.0
            key, now_ns = self.keyboard.next_key(0.0 if is_due else wait_s), time.monotonic_ns()
            if key == QUIT:
                return False
            if key == PAUSE:
                clock.toggle(now_ns)
            elif key == STEP:
                clock.step(round(self.params.step_s * NS_PER_S), due_ns, now_ns)
            elif is_due:
                return True
            else:
                continue
            state = 'paused' if clock.paused else 'resumed'
            self.get_logger().info(f'{state} at {clock.position_ns(now_ns) / NS_PER_S:.3f} s')

    def close(self):
        """Stop publishing, restore the terminal."""
        self.finished = True  # do not wait for subscribers any more
        self.keyboard.press(QUIT)
        self.thread.join()
        self.keyboard.close()


def main() -> int:
    """Play until the end, SIGINT, SIGTERM or the key q; exit code 0."""
    about = 'Play a bag: publish its messages at the rate at which they were recorded.'
    example = '--ros-args -p bag:=bags/runs/double_lane_change/mpcc -p rate:=0.5'
    return spin_node.run(PlayerNode, about, example)


if __name__ == '__main__':
    sys.exit(main())
