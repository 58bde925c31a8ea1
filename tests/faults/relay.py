"""A process between publisher and subscriber that damages the messages for a while.

    python relay.py --mode realtime --go FILE --do nan --from-s 1.5 --for-s 0.5 SOURCE TARGET \
        TOPIC [...]

Each topic of the contract is subscribed under SOURCE and published under TARGET. Time begins with
the first command; in lockstep it is the time of the stamps. When the damage begins it prints
`begins` and the instant [ns] on the clock of the recorder's log times. Without topics it does
nothing else. It subscribes to all topics of the controller and so counts as one more recorder: a
controller that waits for it sends no command that the relay misses. It subscribes when the file
FILE exists, so that a drive begins only after the program is loaded.
"""

import argparse
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

import damage
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.serialization import deserialize_message, serialize_message

from bags.storage.decoding import stamp_reader
from msgs_yaml import contract
from msgs_yaml.decode import DecodeError
from node_runtime import ros, scheduling, spin_node

BEGIN = '/controller/command'
OTHERS = ('/controller/prediction', '/controller/why')
POLL_S = 0.002  # of the delayed messages
HUGE_EVERY_S = 0.05
GO_S = 0.01  # poll period of the file that lets it begin


class Relay(Node):
    """Forwards raw messages, damaged during the fault."""

    def __init__(self, given: argparse.Namespace):
        while not given.go.exists():
            time.sleep(GO_S)
        super().__init__('relay')
        if given.mode == 'realtime':  # as the nodes beside it
            scheduling.apply(replace(scheduling.DEFAULTS, priority=given.priority))
        self.given = given
        self.effect = _make_effect(given)
        self.began = None  # start of the drive [s], on the clock of `now`
        self.announced = False
        self.delayed: list[tuple[float, Callable[[], None]]] = []  # (when, send)
        topics = contract.load().topics
        self.stamps = {name: stamp_reader(topics[name].type) for name in topics}
        for name in given.topics:
            profile = ros.to_qos_profile(topics[name].qos[given.mode])
            kind = ros.message_type(name)
            pub = self.create_publisher(kind, given.target + name, profile)
            callback = partial(self.on_message, name, kind, pub)
            self.create_subscription(kind, given.source + name, callback, profile, raw=True)
        callbacks = {BEGIN: self.on_tick} | dict.fromkeys(OTHERS, self.on_other)
        for name, callback in callbacks.items():
            profile = ros.to_qos_profile(topics[name].qos[given.mode])
            self.create_subscription(ros.message_type(name), name, callback, profile, raw=True)
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(POLL_S, self.send_due, clock=steady)

    def now(self, name: str, raw: bytes) -> float | None:
        """Return the time [s] of a message; None for a message without a stamp in lockstep."""
        if self.given.mode == 'realtime':
            return time.monotonic()
        try:
            return self.stamps[name](raw) / damage.NS_PER_S
        except DecodeError:
            return None

    def on_tick(self, raw):
        """Store the start of the drive, and announce the fault when it is due."""
        now = self.now(BEGIN, raw)
        if self.began is None:
            self.began = now
        self.announce(now)

    def on_other(self, raw):
        """Do nothing: the controller waits for this subscription."""

    def announce(self, now):
        """Print the instant at which the fault begins, once."""
        if not self.announced and self.is_active(now):
            self.announced = True
            at_ns = time.time_ns() if self.given.mode == 'realtime' else round(now * 1e9)
            print('begins', at_ns, flush=True)

    def on_message(self, name, kind, pub, raw):
        """Forward a message, damaged during the fault."""
        now = self.now(name, raw)
        self.announce(now)
        if self.is_active(now):
            self.effect.apply(self, pub, raw, kind)
        else:
            self.effect.forward(pub, raw, kind)

    def is_active(self, now):
        """Return whether the fault is active at this time."""
        if self.began is None or now is None:
            return False
        since = now - self.began - self.given.from_s
        return 0.0 <= since < self.given.for_s

    def send_later(self, seconds, send):
        """Call `send` after some wall time."""
        self.delayed.append((time.monotonic() + seconds, send))

    def send_due(self):
        """Send the delayed messages that are due."""
        if self.given.mode == 'realtime':
            self.announce(time.monotonic())
        while self.delayed and self.delayed[0][0] <= time.monotonic():
            _, send = self.delayed.pop(0)
            send()


class Effect:
    """Publishes a changed message during the fault, and others as they are."""

    def __init__(self, change):
        self.change = change

    def forward(self, pub, raw, kind):
        """Publish a message outside of the fault."""
        pub.publish(raw)

    def apply(self, relay, pub, raw, kind):
        """Publish a message during the fault."""
        message = deserialize_message(raw, kind)
        self.change(message)
        pub.publish(message)


class RawEffect(Effect):
    """Publishes a list of raw messages instead of one."""

    def apply(self, relay, pub, raw, kind):
        """Publish each of them."""
        for changed in self.change(raw, kind):
            pub.publish(changed)


class DelayEffect(Effect):
    """Publishes messages later, in their order."""

    def apply(self, relay, pub, raw, kind):
        """Delay the message."""
        relay.send_later(self.change, partial(pub.publish, raw))


class SwapEffect(Effect):
    """Swaps each pair of messages."""

    def __init__(self):
        super().__init__(None)
        self.waiting = {}

    def forward(self, pub, raw, kind):
        """Publish the waiting message, too."""
        if pub in self.waiting:
            pub.publish(self.waiting.pop(pub))
        pub.publish(raw)

    def apply(self, relay, pub, raw, kind):
        """Publish the first message of a pair after the second."""
        if pub not in self.waiting:
            self.waiting[pub] = raw
            return
        pub.publish(raw)
        pub.publish(self.waiting.pop(pub))


class EnlargeEffect(Effect):
    """Publishes a huge message, prepared before the fault because that takes longer than a tick."""

    def __init__(self):
        super().__init__(damage.enlarge)
        self.prepared, self.sent = {}, {}

    def forward(self, pub, raw, kind):
        """Prepare the huge message of a topic from its first message."""
        if pub not in self.prepared:
            self.prepared[pub] = self._enlarged(raw, kind)
        pub.publish(raw)

    def apply(self, relay, pub, raw, kind):
        """Publish the huge message, at a rate that a DDS writer can handle."""
        if time.monotonic() - self.sent.get(pub, 0.0) >= HUGE_EVERY_S:
            self.sent[pub] = time.monotonic()
            pub.publish(self.prepared.get(pub) or self._enlarged(raw, kind))

    def _enlarged(self, raw, kind):
        message = deserialize_message(raw, kind)
        self.change(message)
        return serialize_message(message)


def _make_effect(given):
    if given.do == 'delay':
        return DelayEffect(given.delay_s)
    if given.do == 'stamp':
        return Effect(lambda message: damage.shift_stamps(message, given.shift_s))
    if given.do in RAW_EFFECTS:
        return RAW_EFFECTS[given.do]()
    return Effect(damage.CHANGES[given.do])


def _empty(raw, kind):
    return [serialize_message(kind())]


RAW_EFFECTS = {
    'drop': lambda: RawEffect(lambda raw, kind: []),
    'duplicate': lambda: RawEffect(lambda raw, kind: [raw, raw]),
    'torn': lambda: RawEffect(lambda raw, kind: [raw[: len(raw) // 2]]),
    'empty': lambda: RawEffect(_empty),
    'reorder': SwapEffect,
    'huge': EnlargeEffect,
}
EFFECTS = ('delay', 'stamp', *RAW_EFFECTS, *damage.CHANGES)


def main() -> int:
    """Run until a signal ends it."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('source', help='prefix of the topics')
    parser.add_argument('target', help='prefix of the topics')
    parser.add_argument('topics', nargs='*')
    parser.add_argument('--go', type=Path, required=True, help='file whose creation lets it begin')
    parser.add_argument('--mode', required=True, choices=('lockstep', 'realtime'))
    parser.add_argument('--do', default='drop', choices=EFFECTS)
    parser.add_argument('--from-s', type=float, required=True)
    parser.add_argument('--for-s', type=float, required=True)
    parser.add_argument('--delay-s', type=float, default=0.0)
    parser.add_argument('--shift-s', type=float, default=0.0)
    parser.add_argument('--priority', type=int, default=0, help='of SCHED_FIFO')
    given = parser.parse_args()
    return spin_node.spin(lambda: Relay(given), args=[])


if __name__ == '__main__':
    sys.exit(main())
