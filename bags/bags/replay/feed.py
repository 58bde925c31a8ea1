"""What a recorded controller was told, tick by tick, and what it answered. No ROS, no cores.

In lockstep this is exact: a tick has the state, the obstacles and, at the start, the actuators of
its own stamp. In realtime the newest message counts that was sent before the tick began; the bag
knows that instant to within the transport time.
"""

from bisect import bisect_right
from itertools import islice
from typing import NamedTuple

import numpy as np

from bags.errors import BagError
from bags.storage import cdr, read, stamps
from bags.verdict.recorded import LOCKSTEP
from msgs_yaml import decode
from msgs_yaml.stamp import NS_PER_S
from msgs_yaml.types import (
    Actuators,
    Command,
    Obstacles,
    Prediction,
    Reference,
    RoadEdges,
    VehicleState,
    Why,
)

NS_PER_MS = NS_PER_S // 1000
STATE, WHY = '/vehicle/odometry', '/controller/why'
COMMAND, PREDICTION = '/controller/command', '/controller/prediction'
ACTUATORS, OBSTACLES = '/vehicle/actuators', '/scenario/obstacles'
REFERENCE, EDGES = '/scenario/reference', '/scenario/road_edges'
# what the controller calls these, see docs/safety.md
TIME_LIMIT = 'time limit'
BY_AGE = ('too_old', 'from_future')
NEEDED = (STATE, ACTUATORS, REFERENCE, EDGES, OBSTACLES, COMMAND, WHY)


class Told(NamedTuple):
    """What the controller knew at a tick; None where it had not been told, or not legibly."""

    state: VehicleState | None
    reference: Reference | None
    edges: RoadEdges | None
    obstacles: Obstacles | None
    actuators: Actuators | None  # where it (re)started; else not asked for
    acts_ns: int  # when its command took hold


class Tick(NamedTuple):
    """One recorded tick."""

    number: int  # from 0
    stamp_ns: int  # of the state that it answers
    t_s: float  # the same since the first tick
    told: Told
    command: Command | None  # None where it was lost
    why: Why
    prediction: Prediction | None
    gaps: tuple[str, ...]  # why it cannot be repeated exactly; empty where it can


def ticks(bag: read.Bag, most: int | None = None) -> list[Tick]:
    """Return the ticks of a bag, or the first so many, in the order of their answers.

    Raises BagError for a topic without messages, for an answer that is not legible, for a state
    that was not recorded and, in lockstep, for obstacles or actuators that were not.
    """
    topics = {name: Topic(bag, name) for name in NEEDED}
    lockstep = bag.run_info.get('mode') == LOCKSTEP
    commands = topics[COMMAND]
    predictions = Topic(bag, PREDICTION) if _recorded(bag, PREDICTION) else None
    found = []
    for i, why in islice(_unrepeated(topics[WHY]), most):
        before = found[-1] if found else None
        begun = before is None or why.stamp_ns < before.stamp_ns
        look = _Stamps(why.stamp_ns) if lockstep else _Sent(_began_ns(topics[WHY], i, why))
        told = _told(topics, why, look, begun)
        command = commands.find(why.stamp_ns)
        found.append(
            Tick(
                number=len(found),
                stamp_ns=why.stamp_ns,
                t_s=(why.stamp_ns - (found[0].stamp_ns if found else why.stamp_ns)) / NS_PER_S,
                told=told,
                command=command,
                why=why,
                prediction=predictions.find(why.stamp_ns) if predictions else None,
                gaps=(*look.gaps, *gaps(why, command)),
            )
        )
    return found


def _told(topics, why, look, begun):
    return Told(
        state=topics[STATE].of_stamp(why.stamp_ns),
        reference=look.latched(topics[REFERENCE]),
        edges=look.latched(topics[EDGES]),
        obstacles=look.current(topics[OBSTACLES]),
        actuators=look.current(topics[ACTUATORS]) if begun else None,
        acts_ns=why.stamp_ns + round(why.values.get('time.lead_ms', 0.0) * NS_PER_MS),
    )


def gaps(why, command):
    """Return what a recording cannot repeat: decisions that the wall clock made."""
    if command is None:
        yield 'its command was lost'
    for solver in ('solver', 'fallback'):
        if why.values.get(f'{solver}.message') == TIME_LIMIT:
            yield f'the {solver} was stopped by its time limit'
    if why.values.get('gate') in BY_AGE:
        yield 'the gate turned its command back because of the age of the state'


class _Stamps:
    """Lockstep: the message of the tick's stamp, of a latched topic the newest one up to it."""

    gaps = ()

    def __init__(self, stamp_ns):
        self.stamp_ns = stamp_ns

    def current(self, topic):
        return topic.of_stamp(self.stamp_ns)

    def latched(self, topic):
        return topic.newest(bisect_right(topic.stamp_ns, self.stamp_ns))


class _Sent:
    """Realtime: the newest message that was sent up to an instant."""

    def __init__(self, wall_ns):
        self.wall_ns, self.gaps = wall_ns, []

    def current(self, topic):
        sent = bisect_right(topic.sent_ns, self.wall_ns)
        if not sent:
            self.gaps.append(f'what it knew of {topic.topic.name} was not recorded')
        return topic.newest(sent)

    def latched(self, topic):
        # repeated unchanged as long as it holds: one that is recorded late was there before
        return topic.newest(bisect_right(topic.sent_ns, self.wall_ns))


def _began_ns(topic, i, why):
    """Return when a tick began: its report was sent when all the rest was done."""
    took_ms = sum(why.values.get(f'time.{part}_ms', 0.0) for part in ('prepare', 'solve'))
    return int(topic.sent_ns[i]) - round(took_ms * NS_PER_MS)


def _unrepeated(topic):
    """Yield (row, report) of every report that is not the one before again."""
    for i, payload in enumerate(topic.payloads):
        if not i or payload != topic.payloads[i - 1]:
            yield i, topic.legible(i)


def same(one: Reference | RoadEdges | None, other: Reference | RoadEdges | None) -> bool:
    """Tell whether a path or edges say the same, whenever they were sent."""
    if one is None or other is None:
        return one is other
    return all(np.array_equal(a, b) for a, b in zip(one[1:], other[1:]))


def _recorded(bag, name):
    return name in bag.recordings and bool(bag.recordings[name].payloads)


class Topic:
    """The messages of one topic, decoded when they are asked for."""

    def __init__(self, bag, name):
        recorded = read.recording(bag, name)
        self.path, self.topic, self.payloads = bag.path, recorded.topic, recorded.payloads
        self.decode = read.DECODERS[name]
        times = map(stamps.reader(self.topic.type), self.payloads)
        self.stamp_ns = np.fromiter(times, np.int64, len(self.payloads))
        # a time in order, whatever small steps the clock of the wall made
        self.sent_ns = np.maximum.accumulate(recorded.publish_ns)
        self.row_of = {int(stamp_ns): i for i, stamp_ns in enumerate(self.stamp_ns)}
        self.known = {}

    def value(self, i: int):
        """Return the value of a message; None when it breaks the contract: nodes turn it down."""
        payload = self.payloads[i]
        if payload not in self.known:
            message = cdr.decode(payload, self.topic.schema, self.topic.type)
            try:
                self.known[payload] = self.decode(message)
            except decode.DecodeError:
                self.known[payload] = None
        return self.known[payload]

    def legible(self, i: int):
        """Return the value of a message; BagError when it breaks the contract."""
        found = self.value(i)
        if found is None:
            raise BagError(f'{self.path}: message {i} of {self.topic.name} breaks the contract')
        return found

    def of_stamp(self, stamp_ns: int):
        """Return the value of a stamp; BagError when it was not recorded."""
        if stamp_ns not in self.row_of:
            raise BagError(
                f'{self.path}: {self.topic.name} has no message of stamp {stamp_ns} ns, which '
                'the controller answered: it was lost, and the tick cannot be repeated'
            )
        return self.value(self.row_of[stamp_ns])

    def find(self, stamp_ns: int):
        """Return the value of a stamp; None when it was not recorded. Raises BagError."""
        return self.legible(self.row_of[stamp_ns]) if stamp_ns in self.row_of else None

    def newest(self, count: int):
        """Return the newest legible value of the first `count` messages; of one at least."""
        values = (self.value(i) for i in reversed(range(max(count, 1))))
        return next((value for value in values if value is not None), None)
