"""A process between publisher and subscriber that harms the messages for a while.

    python relay.py --mode realtime --go FILE --do nan --from-s 1.5 --for-s 0.5 SOURCE TARGET \
        TOPIC [...]

Each topic of the contract is heard under SOURCE and spoken under TARGET. Time begins with the first
command; in lockstep it is that of the stamps. When the time of the harm has come it prints `begins`
and the instant [ns], under which a recorder files what happens then. Without a topic that is all it
does. It hears everything that a controller says, and so counts as one recorder more: a controller
that waits for it gives no command that it does not hear. It hears nobody before the file FILE is
there: so the program is loaded, and the drive that waits for it begins when it is let go.
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
MORE = ('/controller/prediction', '/controller/why')
LOOK_S = 0.002  # between two looks at what was held back
HUGE_EVERY_S = 0.05
GO_S = 0.01  # between two looks at whether to begin


class Relay(Node):
    """Passes raw messages on, in the order in which they came but for the harm."""

    def __init__(self, given: argparse.Namespace):
        while not given.go.exists():
            time.sleep(GO_S)
        super().__init__('relay')
        if given.mode == 'realtime':  # as the nodes beside it
            scheduling.apply(replace(scheduling.DEFAULTS, priority=given.priority))
        self.given = given
        self.harm = _harm(given)
        self.began = None  # of the drive: s, on the clock of `now`
        self.told = False
        self.held: list[tuple[float, Callable[[], None]]] = []  # when to send, what
        topics = contract.load().topics
        self.stamps = {name: stamp_reader(topics[name].type) for name in topics}
        for name in given.topics:
            profile = ros.to_qos_profile(topics[name].qos[given.mode])
            kind = ros.message_type(name)
            pub = self.create_publisher(kind, given.target + name, profile)
            send = partial(self.pass_on, name, kind, pub)
            self.create_subscription(kind, given.source + name, send, profile, raw=True)
        hears = {BEGIN: self.on_tick} | dict.fromkeys(MORE, self.on_more)
        for name, hear in hears.items():
            profile = ros.to_qos_profile(topics[name].qos[given.mode])
            self.create_subscription(ros.message_type(name), name, hear, profile, raw=True)
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(LOOK_S, self.release, clock=steady)

    def now(self, name: str, raw: bytes) -> float | None:
        """Return the time [s] of a message; None for one that has no stamp where they count."""
        if self.given.mode == 'realtime':
            return time.monotonic()
        try:
            return self.stamps[name](raw) / damage.NS_PER_S
        except DecodeError:
            return None

    def on_tick(self, raw):
        """Note the beginning of the drive, and of the harm."""
        now = self.now(BEGIN, raw)
        if self.began is None:
            self.began = now
        self.tell(now)

    def on_more(self, raw):
        """Hear it, for the controller's sake."""

    def tell(self, now):
        """Print when the time of the harm has come."""
        if not self.told and self.is_harmed(now):
            self.told = True
            at_ns = time.time_ns() if self.given.mode == 'realtime' else round(now * 1e9)
            print('begins', at_ns, flush=True)

    def pass_on(self, name, kind, pub, raw):
        """Send a message, or what becomes of it."""
        now = self.now(name, raw)
        self.tell(now)
        if self.is_harmed(now):
            self.harm.hurt(self, pub, raw, kind)
        else:
            self.harm.pass_on(pub, raw, kind)

    def is_harmed(self, now):
        """Tell whether the harm is done at this time."""
        if self.began is None or now is None:
            return False
        since = now - self.began - self.given.from_s
        return 0.0 <= since < self.given.for_s

    def later(self, seconds, send):
        """Call `send` after some wall time."""
        self.held.append((time.monotonic() + seconds, send))

    def release(self):
        """Send what was held back for long enough."""
        if self.given.mode == 'realtime':
            self.tell(time.monotonic())
        while self.held and self.held[0][0] <= time.monotonic():
            _, send = self.held.pop(0)
            send()


class Harm:
    """Changes a message; the sound ones pass."""

    def __init__(self, change):
        self.change = change

    def pass_on(self, pub, raw, kind):
        """Send a message that is not harmed."""
        pub.publish(raw)

    def hurt(self, relay, pub, raw, kind):
        """Send the changed message instead."""
        message = deserialize_message(raw, kind)
        self.change(message)
        pub.publish(message)


class Raw(Harm):
    """Sends bytes made from the bytes, none for None."""

    def hurt(self, relay, pub, raw, kind):
        """Send each of them."""
        for one in self.change(raw, kind):
            pub.publish(one)


class Late(Harm):
    """Sends everything later, in order."""

    def hurt(self, relay, pub, raw, kind):
        """Hold it back."""
        relay.later(self.change, partial(pub.publish, raw))


class Swapped(Harm):
    """Sends every second message before the one that it follows."""

    def __init__(self):
        super().__init__(None)
        self.waiting = {}

    def pass_on(self, pub, raw, kind):
        """Send what still waits, too."""
        if pub in self.waiting:
            pub.publish(self.waiting.pop(pub))
        pub.publish(raw)

    def hurt(self, relay, pub, raw, kind):
        """Keep the first of a pair until the second was sent."""
        if pub not in self.waiting:
            self.waiting[pub] = raw
            return
        pub.publish(raw)
        pub.publish(self.waiting.pop(pub))


class Huge(Harm):
    """Sends a huge message now and then, made beforehand: that takes longer than a tick."""

    def __init__(self):
        super().__init__(damage.swell)
        self.made, self.sent = {}, {}

    def pass_on(self, pub, raw, kind):
        """Make the huge message of a topic from its first one."""
        if pub not in self.made:
            self.made[pub] = self._huge(raw, kind)
        pub.publish(raw)

    def hurt(self, relay, pub, raw, kind):
        """Send it instead, not more often than a DDS writer can stand."""
        if time.monotonic() - self.sent.get(pub, 0.0) >= HUGE_EVERY_S:
            self.sent[pub] = time.monotonic()
            pub.publish(self.made.get(pub) or self._huge(raw, kind))

    def _huge(self, raw, kind):
        message = deserialize_message(raw, kind)
        self.change(message)
        return serialize_message(message)


def _harm(given):
    if given.do == 'delay':
        return Late(given.delay_s)
    if given.do == 'stamp':
        return Harm(lambda message: damage.shift_stamps(message, given.shift_s))
    if given.do in WHOLE:
        return WHOLE[given.do]()
    return Harm(damage.CHANGES[given.do])


def _empty(raw, kind):
    return [serialize_message(kind())]


WHOLE = {
    'drop': lambda: Raw(lambda raw, kind: []),
    'duplicate': lambda: Raw(lambda raw, kind: [raw, raw]),
    'torn': lambda: Raw(lambda raw, kind: [raw[: len(raw) // 2]]),
    'empty': lambda: Raw(_empty),
    'reorder': Swapped,
    'huge': Huge,
}
DEEDS = ('delay', 'stamp', *WHOLE, *damage.CHANGES)


def main() -> int:
    """Relay until told to end, by a signal."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('source', help='put before the name of a topic')
    parser.add_argument('target', help='put before the name of a topic')
    parser.add_argument('topics', nargs='*')
    parser.add_argument('--go', type=Path, required=True, help='file whose existence lets it begin')
    parser.add_argument('--mode', required=True, choices=('lockstep', 'realtime'))
    parser.add_argument('--do', default='drop', choices=DEEDS)
    parser.add_argument('--from-s', type=float, required=True)
    parser.add_argument('--for-s', type=float, required=True)
    parser.add_argument('--delay-s', type=float, default=0.0)
    parser.add_argument('--shift-s', type=float, default=0.0)
    parser.add_argument('--priority', type=int, default=0, help='of SCHED_FIFO')
    given = parser.parse_args()
    return spin_node.spin(lambda: Relay(given), args=[])


if __name__ == '__main__':
    sys.exit(main())
