"""What a recorded controller was told, tick by tick, and what it answered. No ROS, no cores.

In lockstep this is exact: a tick has the state, the obstacles and, at the start, the actuators of
its own stamp. In realtime the newest message counts that was sent before the tick began; the bag
knows that instant to within the transport time.
"""

from bisect import bisect_right
from collections.abc import Iterator
from itertools import islice
from typing import NamedTuple

import numpy as np

from bags.evaluation.controller_log import report_number
from bags.evaluation.drive import LOCKSTEP
from bags.storage import read
from experiments.replay.topic import Topic
from msgs_yaml.conversions import NS_PER_S
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
LONGEST_MS = 60_000.0  # no part of a tick takes a minute: another program reports more
STATE, WHY = '/vehicle/odometry', '/controller/why'
COMMAND, PREDICTION = '/controller/command', '/controller/prediction'
ACTUATORS, OBSTACLES = '/vehicle/actuators', '/scenario/obstacles'
REFERENCE, EDGES = '/scenario/reference', '/scenario/road_edges'
# what the controller calls these, see docs/safety.md
TIME_LIMIT = 'time limit'
TOO_OLD, STATE_STALE, HEARD = '_stale', 'state_stale', 'time.heard_ns'
BY_AGE = ('too_old', 'from_future')
ANSWERS = (COMMAND, PREDICTION)
NEEDED = (STATE, ACTUATORS, REFERENCE, EDGES, OBSTACLES, COMMAND, WHY)


class Told(NamedTuple):
    """What the controller knew at a tick; None where it had not been told, or not legibly."""

    state: VehicleState | None
    reference: Reference | None
    edges: RoadEdges | None
    obstacles: Obstacles | None
    actuators: Actuators | None  # where it (re)started; else not asked for
    acts_ns: int  # when its command took hold
    fault: str  # what its watchdog had found too old, '' for nothing


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

    Raises BagError for a topic without valid messages and, in lockstep, for a state, obstacles or
    actuators that were not recorded.
    """
    topics = {name: Topic(bag, name) for name in NEEDED}
    if _recorded(bag, PREDICTION):
        topics[PREDICTION] = Topic(bag, PREDICTION)
    lockstep = bag.run_info.get('mode') == LOCKSTEP
    reports, found, last = topics[WHY], [], None
    for row, why in islice(_unrepeated(reports), most):
        look = _Stamps(why.stamp_ns) if lockstep else _Sent(why.stamp_ns, _began_ns(reports, row))
        begun = last is None or reports.begins_anew(last, row)
        # who has braked blindly takes its set-points from the actuators
        begun = begun or (_is_blind(found[-1].why) and not _is_blind(why))
        if not begun and topics[COMMAND].any_between(reports.stamp_ns[last], why.stamp_ns):
            look.gaps.append(f'a tick without a message of {WHY}')
        zero_ns = found[0].stamp_ns if found else why.stamp_ns
        found.append(_tick(topics, look, why, begun, (len(found), zero_ns)))
        last = row
    return found


def _tick(topics, look, why, begun, place):
    number, zero_ns = place
    command, plan = (
        topics[name].find(why.stamp_ns) if name in topics else None for name in ANSWERS
    )
    told = Told(
        state=None if _is_blind(why) else look.state(topics[STATE]),
        reference=look.latched(topics[REFERENCE]),
        edges=look.latched(topics[EDGES]),
        obstacles=look.current(topics[OBSTACLES]),
        actuators=look.current(topics[ACTUATORS]) if begun else None,
        acts_ns=why.stamp_ns + _took_ns(why, 'lead'),
        fault=fault(why),
    )
    return Tick(
        number=number,
        stamp_ns=why.stamp_ns,
        t_s=(why.stamp_ns - zero_ns) / NS_PER_S,
        told=told,
        command=command,
        why=why,
        prediction=plan,
        gaps=(*look.gaps, *gaps(why, command)),
    )


def fault(why: Why) -> str:
    """Return the reason for which an input was too old to plan with, '' when none was."""
    reason = why.values['reason']
    return reason if reason.endswith(TOO_OLD) else ''


def _is_blind(why):
    """Tell whether a tick answers no state: it says nothing of how one came."""
    return why.values['reason'] == STATE_STALE and HEARD not in why.values


def gaps(why: Why, command: Command | None) -> Iterator[str]:
    """Yield what a recording cannot repeat: what was lost, and what the wall clock decided."""
    if command is None:
        yield 'its command was lost'
    for solver in ('solver', 'fallback'):
        if why.values.get(f'{solver}.message') == TIME_LIMIT:
            yield f'the {solver} was stopped by its time limit'
    if why.values.get('gate') in BY_AGE:
        yield 'the gate turned its command back because of the age of the state'


class _Stamps:
    """Lockstep: the message of the tick's stamp, of a latched topic the newest one up to it."""

    def __init__(self, stamp_ns):
        self.stamp_ns, self.gaps = stamp_ns, []

    def state(self, topic):
        return topic.of_stamp(self.stamp_ns)

    def current(self, topic):
        return topic.of_stamp(self.stamp_ns)

    def latched(self, topic):
        return topic.newest(bisect_right(topic.stamp_ns, self.stamp_ns))


class _Sent:
    """Realtime: the newest message that was sent up to an instant."""

    def __init__(self, stamp_ns, wall_ns):
        self.stamp_ns, self.wall_ns, self.gaps = stamp_ns, wall_ns, []

    def state(self, topic):
        if self.stamp_ns in topic.row_of:
            return topic.of_stamp(self.stamp_ns)
        self.gaps.append('its state was lost')
        return None

    def current(self, topic):
        sent = bisect_right(topic.sent_ns, self.wall_ns)
        if not sent:
            self.gaps.append(f'what it knew of {topic.topic.name} was not recorded')
        return topic.newest(sent)

    def latched(self, topic):
        # repeated unchanged as long as it holds: one that is recorded late was there before
        return topic.newest(bisect_right(topic.sent_ns, self.wall_ns))


def _began_ns(reports, row):
    """Return when a tick began: its report was sent when all the rest was done."""
    why = reports.value(row)
    return int(reports.sent_ns[row]) - _took_ns(why, 'prepare', 'solve')


def _took_ns(why, *parts):
    """Return how long parts of a tick took; what is no time from 0 to LONGEST_MS counts as 0."""
    ms = (report_number(why.values, f'time.{part}_ms') for part in parts)
    return round(sum(one for one in ms if 0.0 <= one <= LONGEST_MS) * NS_PER_MS)


def _unrepeated(topic):
    """Yield (row, report) of every report of a tick that is not the one before again."""
    for i, payload in enumerate(topic.payloads):
        report = topic.value(i)
        told = isinstance(report.values.get('reason'), str)
        if told and (not i or payload != topic.payloads[i - 1]):
            yield i, report


def same(one: Reference | RoadEdges | None, other: Reference | RoadEdges | None) -> bool:
    """Tell whether a path or edges say the same, whenever they were sent."""
    if one is None or other is None:
        return one is other
    return all(np.array_equal(a, b) for a, b in zip(one[1:], other[1:]))


def _recorded(bag, name):
    return name in bag.recordings and bool(bag.recordings[name].payloads)
