"""Plays a bag: publishes the recorded bytes at the intervals of their log times.

Its topics are those of the bag, in the namespace of the node. In a terminal the keys pause it
(space), step (s) and quit (q).
"""

import sys
import time
import traceback
import warnings
from importlib import import_module
from queue import Empty, SimpleQueue
from threading import Thread
from typing import Annotated

import numpy as np
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy

from bags.errors import BagError, DamagedBagWarning
from bags.playback import Keyboard, Part, PlaybackClock, build_playlist
from bags.storage import read
from bags.storage.rosbag2_metadata import parse_qos
from msgs_yaml import share
from msgs_yaml.conversions import NS_PER_S
from node_runtime import ros, spin_node
from node_runtime.parameters import ParameterError, Range, Struct

DEPTH = 10  # of a publisher whose history is not in the bag
PAUSE, STEP, QUIT = ' ', 's', 'q'
HELP = 'space: pause and resume, s: step, q: quit'
NS_PER_MS = 1e6


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
        part = Part(self.params.start_s, self.params.duration_s, self.params.topics)
        try:
            with warnings.catch_warnings():
                # logged below
                warnings.simplefilter('ignore', DamagedBagWarning)
                self.bag = read.load(self.params.bag)
            self.playlist = build_playlist(self.bag, part, self.params.clock_hz)
        except BagError as error:
            raise ParameterError(f'bag: {error}') from error
        if self.bag.damage:
            self.get_logger().warning(self.bag.damage)
        self.topic_publishers = list(map(self._publisher, self.playlist.topics))
        self.keys = SimpleQueue()
        self.keyboard = Keyboard(self.keys.put)
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
        name, profile = ros.relative_name(topic.name), to_qos_profile(topic.qos)
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
            if self._pressed(0.01) == QUIT:
                return
        if self._pressed(self.params.delay_s) == QUIT:
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
            if is_due and self.keys.empty():
                return True
            key, now_ns = self._pressed(0.0 if is_due else wait_s), time.monotonic_ns()
            if key == QUIT:
                return False
            if key == PAUSE:
                clock.toggle(now_ns)
            elif key == STEP:
                clock.step(round(self.params.step_s * NS_PER_S), due_ns, now_ns)
            else:
                continue
            state = 'paused' if clock.paused else 'resumed'
            self.get_logger().info(f'{state} at {clock.position_ns(now_ns) / NS_PER_S:.3f} s')

    def _pressed(self, wait_s):
        """Return the next key, '' for none within `wait_s`; None waits without limit."""
        try:
            return self.keys.get(timeout=wait_s)
        except Empty:
            return ''

    def close(self):
        """Stop publishing, restore the terminal."""
        self.finished = True  # do not wait for subscribers any more
        self.keys.put(QUIT)
        self.thread.join()
        self.keyboard.close()


def to_qos_profile(text: str) -> QoSProfile:
    """Return the QoS profile of a publisher from its text in a bag: the first one offered.

    The defaults are reliable, volatile, the last DEPTH messages.
    """
    (offered, *_) = [*parse_qos(text), {}]
    depth = offered.get('depth')
    profile = QoSProfile(
        history=HistoryPolicy[(offered.get('history') or 'keep_last').upper()],
        depth=depth if isinstance(depth, int) and depth > 0 else DEPTH,
        reliability=ReliabilityPolicy[(offered.get('reliability') or 'reliable').upper()],
        durability=DurabilityPolicy[(offered.get('durability') or 'volatile').upper()],
    )
    if offered.get('deadline_ns'):
        profile.deadline = Duration(nanoseconds=offered['deadline_ns'])
    return profile


def main() -> int:
    """Play until the end, SIGINT, SIGTERM or the key q; exit code 0."""
    about = 'Play a bag: publish its messages at the rate at which they were recorded.'
    example = '--ros-args -p bag:=bags/runs/double_lane_change/mpcc -p rate:=0.5'
    return spin_node.run(PlayerNode, about, example)


if __name__ == '__main__':
    sys.exit(main())
