"""Plays a bag: sends what was recorded, as it came over the wire, when it came over the wire.

Its topics are those of the bag, in the namespace of the node. While it plays, the keyboard of a
terminal pauses it (space), steps (s) and ends it (q).
"""

import sys
import time
import traceback
import warnings
from dataclasses import dataclass
from importlib import import_module
from queue import Empty, SimpleQueue
from threading import Thread
from typing import Annotated

import numpy as np
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.qos import (
    DurabilityPolicy,
    HistoryPolicy,
    QoSProfile,
    ReliabilityPolicy,
)

from bags.errors import BagError, DamagedBagWarning
from bags.playback import Keyboard, Part, PlaybackClock, build_playlist
from bags.storage import read
from bags.storage.rosbag2_metadata import parse_qos
from msgs_yaml import share
from msgs_yaml.conversions import NS_PER_S
from node_runtime import ros, spin_node
from node_runtime.parameters import ParameterError, Range

DEPTH = 10  # of a publisher about whose history the bag says nothing
PAUSE, STEP, QUIT = ' ', 's', 'q'
HELP = 'space: pause and go on, s: step, q: quit'
NS_PER_MS = 1e6


@dataclass(frozen=True)
class PlayerParams:
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
    """Sends from a thread of its own; parameters are served meanwhile."""

    def __init__(self):
        super().__init__('player')
        defaults = share.path('bags', 'config', 'player.yaml')
        self.params = ros.declare(self, PlayerParams, defaults)
        self.bag, self.playlist = self._load()
        self.senders = [self._sender(topic) for topic in self.playlist.topics]
        self.keys = SimpleQueue()
        self.keyboard = Keyboard(self.keys.put)
        if self.params.paused and not self.keyboard.attached:
            raise ParameterError('paused: is true, but there is no keyboard whose key would go on')
        self.thread = Thread(target=self._play_guarded, daemon=True)
        self.thread.start()

    def _load(self):
        given = self.params
        if not given.bag:
            raise ParameterError('bag: is not given; it names the bag to play')
        part = Part(given.start_s, given.duration_s, given.topics)
        try:
            with warnings.catch_warnings():
                # said below, as what a node says
                warnings.simplefilter('ignore', DamagedBagWarning)
                bag = read.load(given.bag)
            made = build_playlist(bag, part, given.clock_hz)
        except BagError as error:
            raise ParameterError(f'bag: {error}') from error
        if bag.damage:
            self.get_logger().warning(bag.damage)
        return bag, made

    def _sender(self, topic):
        """Return what sends the messages of a topic, None where its type is not installed."""
        package, _, name = topic.type.split('/')
        try:
            kind = getattr(import_module(f'{package}.msg'), name)
        except (ImportError, AttributeError):
            self.get_logger().warning(f'{topic.name}: {topic.type} is not installed; left out')
            return None
        return ros.BlockingPublisher(
            self, self.create_publisher(kind, ros.relative_name(topic.name), profile(topic.qos))
        )

    def _play_guarded(self):
        try:
            self._play()
        except Exception:
            traceback.print_exc()
            spin_node.finish(self, 1)
        else:
            spin_node.finish(self)

    def _play(self):
        if not self._wait_for_recorders() or self._pressed(self.params.delay_s) == QUIT:
            return
        duration_s = self.playlist.duration_ns / NS_PER_S
        self.get_logger().info(
            f'playing {self.bag.path}: {len(self.playlist.payloads)} messages, {duration_s:.3f} s '
            f'at rate {self.params.rate:g}' + (f'; {HELP}' if self.keyboard.attached else '')
        )
        paused = self.params.paused
        while self._once(paused) and self.params.loop:
            paused = False

    def _wait_for_recorders(self):
        while ros.missing_subscriptions(self, {}):
            if self._pressed(0.01) == QUIT:
                return False
        return True

    def _once(self, paused):
        """Send everything once; return False when told to end."""
        pace = PlaybackClock(self.params.rate, time.monotonic_ns(), paused)
        late_ns = []
        rows = zip(self.playlist.due_ns.tolist(), self.playlist.topic.tolist())
        for (due_ns, topic), data in zip(rows, self.playlist.payloads):
            if not self._wait(pace, due_ns):
                self.get_logger().info(f'ended at {due_ns / NS_PER_S:.3f} s')
                return False
            if not pace.paused:
                late_ns.append(-pace.wait_s(due_ns, time.monotonic_ns()) * NS_PER_S)
            if self.senders[topic] is not None:
                self.senders[topic].send(data)
        self._report(late_ns)
        return True

    def _wait(self, pace, due_ns):
        """Wait for a moment of the bag and do what keys say; return False to end."""
        while True:
            wait_s = pace.wait_s(due_ns, time.monotonic_ns())
            is_due = wait_s is not None and wait_s <= 0.0
            if is_due and self.keys.empty():
                return True
            key, now_ns = self._pressed(0.0 if is_due else wait_s), time.monotonic_ns()
            if key == QUIT:
                return False
            if key == PAUSE:
                pace.toggle(now_ns)
                self._say_where(pace, now_ns)
            elif key == STEP:
                pace.step(round(self.params.step_s * NS_PER_S), due_ns, now_ns)
                self._say_where(pace, now_ns)

    def _pressed(self, wait_s):
        """The next key, '' for none within a time; None waits for one."""
        try:
            return self.keys.get(timeout=wait_s)
        except Empty:
            return ''

    def _say_where(self, pace, now_ns):
        where = f'{pace.position_ns(now_ns) / NS_PER_S:.3f} s'
        self.get_logger().info(f'paused at {where}' if pace.paused else f'going on at {where}')

    def _report(self, late_ns):
        text = f'played {len(self.playlist.payloads)} messages'
        if late_ns:
            p50, p99, most = np.percentile(late_ns, [50, 99, 100]) / NS_PER_MS
            text += f', late by {p50:.2f} ms (median), {p99:.2f} ms (p99), {most:.2f} ms (max)'
        self.get_logger().info(text)
        if self.bag.damage:
            self.get_logger().warning(self.bag.damage)

    def close(self):
        """Stop sending, give the terminal back."""
        self.finished = True  # nothing waits for a reader any more
        self.keys.put(QUIT)
        self.thread.join()
        self.keyboard.close()


def profile(text: str) -> QoSProfile:
    """Return the QoS profile of a publisher from what a bag says: the first it offered.

    What the bag does not say is reliable, volatile, the last DEPTH messages.
    """
    (found, *_) = [*parse_qos(text), {}]
    depth = found.get('depth')
    made = QoSProfile(
        history=HistoryPolicy[(found.get('history') or 'keep_last').upper()],
        depth=depth if isinstance(depth, int) and depth > 0 else DEPTH,
        reliability=ReliabilityPolicy[(found.get('reliability') or 'reliable').upper()],
        durability=DurabilityPolicy[(found.get('durability') or 'volatile').upper()],
    )
    if found.get('deadline_ns'):
        made.deadline = Duration(nanoseconds=found['deadline_ns'])
    return made


def main() -> int:
    """Play until the end, SIGINT, SIGTERM or the key q; exit code 0."""
    return spin_node.spin(PlayerNode)


if __name__ == '__main__':
    sys.exit(main())
