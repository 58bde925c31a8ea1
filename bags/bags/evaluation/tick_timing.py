"""Latency of the controller, parts of each tick and deadline misses, from the times in a bag.

A bag keeps when each message was sent (wall clock, in every mode), so latency is defined in
lockstep, too. /controller/why reports when the controller received the state and how long each
part of the tick took.
"""

import itertools
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from bags.evaluation.controller_log import WHY, is_answer, report_number
from bags.evaluation.drive import tick_period_ns
from bags.evaluation.metrics.driving import count_periods
from bags.storage import read
from bags.storage.decoding import header_stamps_ns
from bags.storage.invalid_messages import count_invalid, drop_invalid
from bags.storage.read import LOCKSTEP, STATE
from msgs_yaml.conversions import NS_PER_S
from msgs_yaml.types import Why

COMMAND = '/controller/command'
CLOCK = '/clock'
NS_PER_MS = 1e6
MS_PER_S = 1e3
QUANTILES = {'p50': 50.0, 'p90': 90.0, 'p99': 99.0, 'p99.9': 99.9, 'max': 100.0}


class Latency(NamedTuple):
    """One row per command that answers a recorded state, n of them."""

    stamp_ns: np.ndarray  # (n,) int64, of the state and of the command
    latency_s: np.ndarray  # (n,) from sending the state to sending the command


class TickParts(NamedTuple):
    """One row per command that answers a recorded state; (n,) ms."""

    total: np.ndarray  # from sending the state to sending the command
    transport: np.ndarray  # from sending the state to receiving it in the controller
    wait: np.ndarray  # from then to the begin of the step
    prepare: np.ndarray  # parameters of the problem
    solve: np.ndarray  # every solver together
    publish: np.ndarray  # sending the command, until it left
    rest: np.ndarray  # remainder of the total: delay compensation, gate, records


class TickCounts(NamedTuple):
    """Controller periods between the first command and the last state."""

    count: int
    unanswered: int  # no state of the period was answered
    late: int  # answered later than a period after its state; simulated time waits for it
    blind: int  # commands without a state

    @property
    def missed(self) -> int:
        """Ticks without an answer in time."""
        return self.unanswered + self.late


def command_latency(bag: read.Bag) -> Latency:
    """Join every answer with the state of equal stamp; BagError when either topic is empty.

    A state that was sent again counts from the last time it was sent before the command.
    """
    states, commands = read.recording(bag, STATE), read.recording(bag, COMMAND)
    sent_ns = {}
    for stamp, publish in zip(recording_stamps_ns(states).tolist(), states.publish_ns.tolist()):
        sent_ns.setdefault(stamp, []).append(publish)
    rows = []
    command_ns = recording_stamps_ns(commands)
    answers = is_answer(command_ns, controller_reports(bag))
    for stamp, publish in zip(command_ns[answers].tolist(), commands.publish_ns[answers].tolist()):
        before = [sent for sent in sent_ns.get(stamp, ()) if sent <= publish]
        if before:
            rows.append((stamp, publish - max(before)))
    joined = np.array(rows, dtype=np.int64).reshape(-1, 2)
    return Latency(joined[:, 0], joined[:, 1] / NS_PER_S)


def recording_stamps_ns(recorded: read.Recording) -> np.ndarray:
    """Return the header stamps (n,) int64 of a topic; BagError for a message without one."""
    return header_stamps_ns(recorded.topic.name, recorded.payloads)


def run_mode(bag: read.Bag) -> str:
    """Return lockstep or realtime: only lockstep has simulated time."""
    return LOCKSTEP if read.has_messages(bag, CLOCK) else 'realtime'


def controller_reports(bag: read.Bag) -> list[Why]:
    """Return the messages of /controller/why; none where they were not recorded."""
    return list(read.values(bag, WHY)) if read.has_messages(bag, WHY) else []


def tick_parts(bag: read.Bag) -> TickParts:
    """Return the parts of every tick that was solved. Raises BagError when a topic is empty."""
    latency = command_latency(bag)
    states = read.recording(bag, STATE)
    sent_ns = dict(zip(recording_stamps_ns(states).tolist(), states.publish_ns.tolist()))
    whys = controller_reports(bag)
    reports = {why.stamp_ns: why.values for why in whys}
    # the time to send a command is in the report of the next tick
    publish_ms = {
        this.stamp_ns: report_number(after.values, 'time.publish_ms')
        for this, after in itertools.pairwise(whys)
    }
    rows = []
    for stamp, latency_s in zip(latency.stamp_ns.tolist(), latency.latency_s.tolist()):
        report, publish = reports.get(stamp, {}), publish_ms.get(stamp, np.nan)
        total = latency_s * MS_PER_S
        known = (
            (report_number(report, 'time.heard_ns') - sent_ns[stamp]) / NS_PER_MS,
            *(report_number(report, f'time.{part}_ms') for part in ('wait', 'prepare', 'solve')),
        )
        if not np.all(np.isfinite([*known, publish])):
            continue
        remaining = total - sum(known)
        # the call returns a while after the command has left
        publish = min(publish, remaining)
        rows.append((total, *known, publish, remaining - publish))
    return TickParts(*np.array(rows).reshape(-1, len(TickParts._fields)).T)


def count_ticks(bag: read.Bag) -> TickCounts:
    """Count the ticks by the stamps in the bag.

    Raises BagError when there are no states or no commands.
    """
    mode = run_mode(bag)
    period_ns = tick_period_ns(bag.run_info)
    states = recording_stamps_ns(read.recording(bag, STATE))
    commands = recording_stamps_ns(read.recording(bag, COMMAND))
    answers = is_answer(commands, controller_reports(bag))
    count, answered = count_periods(states, commands[answers], period_ns)
    late = 0
    if mode != LOCKSTEP:
        late = int(np.count_nonzero(command_latency(bag).latency_s * NS_PER_S > period_ns))
    return TickCounts(count, count - answered, late, int(np.count_nonzero(~answers)))


def timing_report(bag: read.Bag) -> dict[str, Any]:
    """Return quantiles [ms] of the parts, of the command interval and of the plant's lateness.

    Of valid messages; `invalid_messages` counts the others by topic. In lockstep stamps are no wall
    time: the plant's lateness is None. Raises BagError when a topic is empty.
    """
    bag = drop_invalid(bag)
    mode = run_mode(bag)
    counts = count_ticks(bag)
    sent_ns = np.unique(read.recording(bag, COMMAND).publish_ns)
    states = read.recording(bag, STATE)
    lateness = (states.publish_ns - recording_stamps_ns(states)) / NS_PER_MS
    intervals = np.diff(sent_ns) / NS_PER_MS
    mean = float(intervals.mean()) if intervals.size else None
    return {
        'mode': mode,
        'ticks': {**counts._asdict(), 'missed': counts.missed},
        'parts_ms': {name: quantiles(part) for name, part in tick_parts(bag)._asdict().items()},
        'interval_ms': {**quantiles(intervals), 'mean': mean},
        'state_sent_after_its_stamp_ms': None if mode == LOCKSTEP else quantiles(lateness),
        **count_invalid(bag),
    }


def describe_ticks(counts: Mapping[str, int]) -> str:
    """Return counted ticks, as in the report, as one line for a person."""
    return (
        f'{counts["count"]} ticks, {counts["missed"]} missed: {counts["unanswered"]} unanswered, '
        f'{counts["late"]} late; {counts["blind"]} commands without a state'
    )


def quantiles(values: np.ndarray) -> dict[str, float]:
    """Return the QUANTILES by name; none of no values."""
    if not values.size:
        return {}
    return {name: float(np.percentile(values, q)) for name, q in QUANTILES.items()}
