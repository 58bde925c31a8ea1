"""The recorded ticks of a controller: the inputs of each tick, and its recorded answer. No ROS.

In lockstep this is exact: the inputs are the state, the obstacles and, at the start, the actuators
of the tick's own stamp. In realtime they are the newest messages sent before the tick began; the
bag gives that instant to within the transport time.
"""

import json
from bisect import bisect_right
from collections.abc import Iterator, Mapping
from contextlib import suppress
from itertools import islice
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np

from bags.errors import BagError
from bags.evaluation.drive import LOCKSTEP, report_number
from bags.storage import read
from bags.storage.bag_writer import BagWriter
from bags.storage.columns import DECODE_ERRORS, decode_message, stamp_reader
from mpcc_controller import run_time_parameters
from mpcc_controller.driving.tick_report import ACTUATORS_AGE, RESUMED
from msgs_yaml import types
from msgs_yaml.conversions import NS_PER_S
from msgs_yaml.decode import DecodeError

NS_PER_MS = NS_PER_S // 1000
MAX_MS = 60_000.0  # no part of a tick takes a minute: other programs may report anything
STATE, WHY = '/vehicle/odometry', '/controller/why'
BELIEVED = '/estimator/odometry'  # what the controller answers in place of it, where there is one
COMMAND, PREDICTION = '/controller/command', '/controller/prediction'
STOP_PLAN = '/controller/stop_plan'
ACTUATORS, OBSTACLES = '/vehicle/actuators', '/scenario/obstacles'
REFERENCE, EDGES = '/scenario/reference', '/scenario/road_edges'
PREDICTIONS = '/scenario/predictions'
NEEDED = (STATE, ACTUATORS, REFERENCE, EDGES, OBSTACLES, COMMAND, WHY)
# joined with a tick by the stamp: an invalid message means that the controller had none
JOINED = (STATE, BELIEVED, ACTUATORS, OBSTACLES)
# words of /controller/why, see docs/safety.md
TIME_LIMIT = 'time limit'
STALE, STATE_STALE, HEARD = '_stale', 'state_stale', 'time.heard_ns'
REJECTED_BY_AGE = ('too_old', 'from_future')
# of a golden recording: the largest, and what is kept of the run information, which decides the
# numbers, without traces of the machine
LARGEST_BYTES = 2_000_000
ROLES, MACHINE = ('controller', 'plant'), ('processor', 'architecture', 'libc')
NO_CHANGES: Mapping[str, float] = MappingProxyType({})


class RecordedInputs(NamedTuple):
    """The inputs of the controller at a tick; None where it had no valid message."""

    state: types.VehicleState | None
    reference: types.Reference | None
    edges: types.RoadEdges | None
    obstacles: types.Obstacles | None
    actuators: types.Actuators | None  # at a (re)start only
    acts_ns: int  # stamp at which the command takes effect
    fault: str  # the reason of the watchdog for not planning, '' for none
    # parameters that had been changed since the start of the controller, by dotted name
    changes: Mapping[str, float] = NO_CHANGES
    resumed: bool = False  # the first tick after a pause, in which the controller was not active
    compared: types.Actuators | None = None  # with the set-points
    predictions: types.Predictions | None = None  # of the obstacles, from outside


class Tick(NamedTuple):
    """One recorded tick."""

    number: int  # from 0
    stamp_ns: int  # of the state that it answers
    t_s: float  # since the first tick
    inputs: RecordedInputs
    command: types.Command | None  # None where it was lost
    why: types.Why
    prediction: types.Prediction | None
    stop: types.StopPlan | None
    gaps: tuple[str, ...]  # reasons why it cannot be repeated exactly


class RecordedTopic:
    """The usable messages of one topic, decoded on demand; BagError for a topic without any.

    Messages without a valid stamp are left out, and except for the topics in JOINED, those that
    break the contract: nodes reject them.
    """

    def __init__(self, bag: read.Bag, name: str):
        recorded = read.recording(bag, name)
        self.path, self.topic = bag.path, recorded.topic
        self._decoded = {}
        stamp_of = {}
        for row, payload in enumerate(recorded.payloads):
            stamp_ns = self._stamp_ns(payload)
            if stamp_ns is not None and (name in JOINED or self._decode(payload) is not None):
                stamp_of[row] = stamp_ns
        if not stamp_of:
            raise BagError(f'{bag.path}: no valid message of {name}')
        self.rows = np.array([*stamp_of])  # in the recording
        self.stamp_ns = np.array([*stamp_of.values()], dtype=np.int64)
        self.payloads = [recorded.payloads[row] for row in stamp_of]
        # monotonic, in spite of small steps of the wall clock
        self.sent_ns = np.maximum.accumulate(recorded.publish_ns)[self.rows]
        self.sequence = recorded.sequence[self.rows]
        # the first of a stamp: a state that waits for its answer is sent repeatedly
        self.row_of = {int(stamp_ns): i for i, stamp_ns in reversed([*enumerate(self.stamp_ns)])}

    def _stamp_ns(self, payload):
        try:
            return stamp_reader(self.topic.type)(payload)
        except DecodeError:
            return None

    def _decode(self, payload):
        if payload not in self._decoded:
            try:
                self._decoded[payload] = decode_message(self.topic, payload)
            except DECODE_ERRORS:
                self._decoded[payload] = None
        return self._decoded[payload]

    def value(self, i: int) -> Any:
        """Return the value of message `i`; None when it breaks the contract."""
        return self._decode(self.payloads[i])

    def at_stamp(self, stamp_ns: int) -> Any:
        """Return the value of a stamp, None when it breaks the contract.

        Raises BagError when it was not recorded, and for two different valid ones.
        """
        if stamp_ns not in self.row_of:
            raise BagError(
                f'{self.path}: {self.topic.name} has no message of stamp {stamp_ns} ns, which '
                'the controller answered: it was lost, and the tick cannot be repeated'
            )
        payloads = {self.payloads[i] for i in np.flatnonzero(self.stamp_ns == stamp_ns)}
        valid = [payload for payload in payloads if self._decode(payload) is not None]
        if len(valid) > 1:
            raise BagError(
                f'{self.path}: {self.topic.name} has unlike messages of stamp {stamp_ns} ns: the '
                'bag holds two drives, and their ticks cannot be distinguished'
            )
        return self._decode(valid[0]) if valid else None

    def find(self, stamp_ns: int) -> Any:
        """Return the value of a stamp; None when it was not recorded."""
        return self.value(self.row_of[stamp_ns]) if stamp_ns in self.row_of else None

    def newest(self, count: int) -> Any:
        """Return the newest valid value of the first `count` messages, at least of the first."""
        values = (self.value(i) for i in reversed(range(max(count, 1))))
        return next((value for value in values if value is not None), None)


def _count(topic, stamp_ns, wall_ns):
    """Return how many messages there were up to a stamp, in realtime up to an instant [ns]."""
    if wall_ns is None:
        return bisect_right(topic.stamp_ns, stamp_ns)
    return bisect_right(topic.sent_ns, wall_ns)


def _current(topic, stamp_ns, wall_ns, gaps):
    """Return the message of a stamp, in realtime the newest."""
    if wall_ns is None:
        return topic.at_stamp(stamp_ns)
    count = _count(topic, stamp_ns, wall_ns)
    if not count:
        gaps.append(f'what it knew of {topic.topic.name} was not recorded')
    return topic.newest(count)


def read_ticks(bag: read.Bag, most: int | None = None) -> list[Tick]:
    """Return the ticks of a bag in the order of their reports, or the first `most`.

    Raises BagError for a topic without valid messages and, in lockstep, for a state, obstacles or
    actuators that were not recorded.
    """
    topics = {name: RecordedTopic(bag, name) for name in NEEDED}
    for name in (PREDICTION, STOP_PLAN, PREDICTIONS):
        with suppress(BagError):  # recordings without them can be repeated, too
            topics[name] = RecordedTopic(bag, name)
    with suppress(BagError):
        topics[STATE] = RecordedTopic(bag, BELIEVED)
    lockstep = bag.run_info.get('mode') == LOCKSTEP
    reports, ticks, last = topics[WHY], [], None
    for row, why in islice(_distinct_reports(reports), most):
        stamp_ns = why.stamp_ns
        gaps: list[str] = []
        # when it began in realtime
        wall_ns = int(reports.sent_ns[row]) - _duration_ns(why, 'prepare', 'solve')
        instant = stamp_ns, None if lockstep else wall_ns
        resumed = bool(why.values.get(RESUMED))
        restarted = (
            resumed
            or last is None
            # the stamp or the publisher's sequence decreases
            or reports.stamp_ns[row] < reports.stamp_ns[last]
            or 0 < reports.sequence[row] <= reports.sequence[last]
            # after braking without a state the set-points are reset to the actuators
            or (_has_no_state(ticks[-1].why) and not _has_no_state(why))
        )
        answered = topics[COMMAND].stamp_ns
        if not restarted and np.any((answered > reports.stamp_ns[last]) & (answered < stamp_ns)):
            gaps.append(f'a tick without a message of {WHY}')
        state = None
        if not _has_no_state(why):
            if lockstep or stamp_ns in topics[STATE].row_of:
                state = topics[STATE].at_stamp(stamp_ns)
                state = getattr(state, 'state', state)  # of an estimate
            else:
                gaps.append('its state was lost')
        predictions = topics.get(PREDICTIONS)  # unlike a path, unknown before the first message
        known = _count(predictions, *instant) if predictions else 0
        inputs = RecordedInputs(
            state=state,
            # repeated unchanged while valid: the first recorded message was already valid before
            reference=topics[REFERENCE].newest(_count(topics[REFERENCE], *instant)),
            edges=topics[EDGES].newest(_count(topics[EDGES], *instant)),
            obstacles=_current(topics[OBSTACLES], *instant, gaps),
            actuators=_current(topics[ACTUATORS], *instant, gaps) if restarted else None,
            acts_ns=stamp_ns + _duration_ns(why, 'lead'),
            fault=stale_input(why),
            resumed=resumed,
            changes=run_time_parameters.reported(why.values),
            compared=_compared_actuators(topics[ACTUATORS], why, gaps),
            predictions=predictions.newest(known) if known else None,
        )
        command, prediction, stop = (
            topics[name].find(stamp_ns) if name in topics else None
            for name in (COMMAND, PREDICTION, STOP_PLAN)
        )
        zero_ns = ticks[0].stamp_ns if ticks else stamp_ns
        ticks.append(
            Tick(
                number=len(ticks),
                stamp_ns=stamp_ns,
                t_s=(stamp_ns - zero_ns) / NS_PER_S,
                inputs=inputs,
                command=command,
                why=why,
                prediction=prediction,
                stop=stop,
                gaps=(*gaps, *find_gaps(why, command)),
            )
        )
        last = row
    return ticks


def _compared_actuators(topic, why, gaps):
    """Return the actuators that a tick compared with the set-points, None where there were none."""
    age_ms = report_number(why.values, ACTUATORS_AGE)
    if not abs(age_ms) <= MAX_MS:  # NaN, too
        return None
    actuators = topic.find(why.stamp_ns - round(age_ms * NS_PER_MS))
    if actuators is None:
        gaps.append('its actuators were lost')
    return actuators


def stale_input(why: types.Why) -> str:
    """Return the reason for which an input was too old to plan with, '' when none was."""
    reason = why.values['reason']
    return reason if reason.endswith(STALE) else ''


def _has_no_state(why):
    """Return whether a tick answers no state: its report has no time of arrival."""
    return why.values['reason'] == STATE_STALE and HEARD not in why.values


def find_gaps(why: types.Why, command: types.Command | None) -> Iterator[str]:
    """Yield what a replay cannot repeat: lost messages, and decisions by the wall clock."""
    if command is None:
        yield 'its command was lost'
    for solver in ('solver', 'fallback'):
        if why.values.get(f'{solver}.message') == TIME_LIMIT:
            yield f'the {solver} was stopped by its time limit'
    if why.values.get('gate') in REJECTED_BY_AGE:
        yield 'the gate turned its command back because of the age of the state'


def _duration_ns(why, *parts):
    """Return the time of parts of a tick; a value outside 0 to MAX_MS counts as 0."""
    times_ms = (report_number(why.values, f'time.{part}_ms') for part in parts)
    return round(sum(ms for ms in times_ms if 0.0 <= ms <= MAX_MS) * NS_PER_MS)


def _distinct_reports(topic):
    """Yield (row, report) of every report of a tick that does not repeat the one before."""
    for i, payload in enumerate(topic.payloads):
        report = topic.value(i)
        is_tick_report = isinstance(report.values.get('reason'), str)
        if is_tick_report and (not i or payload != topic.payloads[i - 1]):
            yield i, report


def has_same_content(
    first: types.Reference | types.RoadEdges | None,
    second: types.Reference | types.RoadEdges | None,
) -> bool:
    """Return whether two paths or edges are equal apart from their stamps."""
    if first is None or second is None:
        return first is second
    fields = (name for name in first._fields if name != 'stamp_ns')
    return all(np.array_equal(getattr(first, name), getattr(second, name)) for name in fields)


def cut(bag: read.Bag, folder: Path) -> Path:
    """Write the messages that a replay reads of a lockstep bag into a new `folder`; return it.

    States and actuators of the ticks, path and edges once, obstacles, and every answer. It is a
    complete bag all the same: a golden recording, whose answers every later controller must repeat.

    Raises BagError when it cannot be replayed, or is too large to be kept with the source.
    """
    answered = {tick.stamp_ns for tick in read_ticks(bag)}
    topics = (*NEEDED, PREDICTION)
    names = [name for name in topics if name in bag.recordings]
    kept = dict(bag.run_info)
    for name, wanted in (('parameters', ROLES), ('machine', MACHINE)):
        values = json.loads(kept.get(name, '{}'))
        kept[name] = json.dumps({k: values[k] for k in wanted if k in values}, sort_keys=True)
    writer = BagWriter(folder, [bag.recordings[name].topic for name in names], {'run': kept})
    rows = []
    for index, name in enumerate(names):
        recorded = bag.recordings[name]
        for row in _kept_rows(bag, name, answered):
            log_ns, publish_ns = int(recorded.log_ns[row]), int(recorded.publish_ns[row])
            message = (log_ns, publish_ns, recorded.payloads[row], int(recorded.sequence[row]))
            rows.append((log_ns, index, message))
    for _, index, message in sorted(rows, key=lambda row: row[:2]):
        writer.write(index, *message)
    writer.close()
    size = sum(file.stat().st_size for file in folder.iterdir())
    if size > LARGEST_BYTES:
        raise BagError(f'{folder}: {size} bytes; golden bags have at most {LARGEST_BYTES}')
    return folder


def _kept_rows(bag, name, answered):
    """Return the rows of a topic that a replay reads."""
    topic = RecordedTopic(bag, name)
    if name in (STATE, ACTUATORS):
        return [topic.rows[row] for stamp_ns, row in topic.row_of.items() if stamp_ns in answered]
    rows = range(len(topic.payloads))
    if name in (REFERENCE, EDGES):
        values = [topic.value(row) for row in rows]
        rows = [
            row for row in rows if not row or not has_same_content(values[row], values[row - 1])
        ]
    return topic.rows[[*rows]]
