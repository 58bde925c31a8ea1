"""What a bag contains: topics, rates, gaps, losses; latency, parts of each tick, missed ticks.

A bag keeps when each message was sent (wall clock, in every mode), so latency is defined in
lockstep, too. /controller/why reports when the controller received the state and how long each
part of the tick took.
"""

import itertools
from collections import Counter
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from bags.evaluation.drive import (
    COMMAND,
    FRESH_PLAN,
    STATE_STALE,
    WHY,
    is_answer,
    report_number,
    tick_period_ns,
)
from bags.evaluation.metrics.driving import count_periods
from bags.storage import read
from bags.storage.columns import header_stamps_ns
from bags.storage.invalid_messages import count_invalid, drop_invalid
from bags.storage.message_filing import LossCounter
from bags.storage.read import LOCKSTEP, STATE
from msgs_yaml.conversions import NS_PER_S
from msgs_yaml.types import Why

CLOCK = '/clock'
NS_PER_MS = 1e6
MS_PER_S = 1e3
QUANTILES = {'p50': 50.0, 'p90': 90.0, 'p99': 99.0, 'p99.9': 99.9, 'max': 100.0}


class TickParts(NamedTuple):
    """One row per command that answers a recorded state; (n,) ms."""

    total: np.ndarray  # from sending the state to sending the command
    transport: np.ndarray  # from sending the state to receiving it in the controller
    wait: np.ndarray  # from then to the begin of the step
    prepare: np.ndarray  # parameters of the problem
    solve: np.ndarray  # every solver together
    publish: np.ndarray  # sending the command, until it left
    rest: np.ndarray  # remainder of the total: delay compensation, gate, records


def command_latency(bag: read.Bag) -> tuple[np.ndarray, np.ndarray]:
    """Return stamps (n,) int64 [ns] and latency (n,) [s] of every answer to a recorded state.

    The latency lasts from sending the state to sending the command; a state that was sent again
    counts from the last time it was sent before. Raises BagError when either topic is empty.
    """
    states, commands = read.recording(bag, STATE), read.recording(bag, COMMAND)
    sent_ns = {}
    for stamp, publish in zip(stamps_ns(bag, STATE).tolist(), states.publish_ns.tolist()):
        sent_ns.setdefault(stamp, []).append(publish)
    rows = []
    command_ns = stamps_ns(bag, COMMAND)
    answers = is_answer(command_ns, controller_reports(bag))
    for stamp, publish in zip(command_ns[answers].tolist(), commands.publish_ns[answers].tolist()):
        before = [sent for sent in sent_ns.get(stamp, ()) if sent <= publish]
        if before:
            rows.append((stamp, publish - max(before)))
    joined = np.array(rows, dtype=np.int64).reshape(-1, 2)
    return joined[:, 0], joined[:, 1] / NS_PER_S


def stamps_ns(bag: read.Bag, topic: str) -> np.ndarray:
    """Return the header stamps (n,) int64 of a topic; BagError without messages or a header."""
    return header_stamps_ns(topic, read.recording(bag, topic).payloads)


def run_mode(bag: read.Bag) -> str:
    """Return lockstep or realtime: only lockstep has simulated time."""
    return LOCKSTEP if read.has_messages(bag, CLOCK) else 'realtime'


def controller_reports(bag: read.Bag) -> list[Why]:
    """Return the messages of /controller/why; none where they were not recorded."""
    return list(read.values(bag, WHY)) if read.has_messages(bag, WHY) else []


def tick_parts(bag: read.Bag) -> TickParts:
    """Return the parts of every tick that was solved. Raises BagError when a topic is empty."""
    sent_ns = dict(zip(stamps_ns(bag, STATE), read.recording(bag, STATE).publish_ns))
    whys = controller_reports(bag)
    reports = {why.stamp_ns: why.values for why in whys}
    # the time to send a command is in the report of the next tick
    publish_ms = {
        this.stamp_ns: report_number(after.values, 'time.publish_ms')
        for this, after in itertools.pairwise(whys)
    }
    rows = []
    for stamp, latency_s in zip(*command_latency(bag)):
        report, publish = reports.get(stamp, {}), publish_ms.get(stamp, np.nan)
        total = latency_s * MS_PER_S
        known = (
            (report_number(report, 'time.heard_ns') - sent_ns[stamp]) / NS_PER_MS,
            *(report_number(report, f'time.{part}_ms') for part in ('wait', 'prepare', 'solve')),
        )
        if np.all(np.isfinite([*known, publish])):
            remaining = total - sum(known)
            # the call returns a while after the command has left
            publish = min(publish, remaining)
            rows.append((total, *known, publish, remaining - publish))
    return TickParts(*np.array(rows).reshape(-1, len(TickParts._fields)).T)


def count_ticks(bag: read.Bag) -> dict[str, int]:
    """Count the controller periods between the first command and the last state, by their stamps.

    `unanswered` are those of which no state was answered, `late` those that were answered more than
    a period after their state (simulated time waits for it), `missed` both, `blind` the commands
    without a state. Raises BagError when there are no states or no commands.
    """
    period_ns, commands = tick_period_ns(bag.run_info), stamps_ns(bag, COMMAND)
    answers = is_answer(commands, controller_reports(bag))
    count, answered = count_periods(stamps_ns(bag, STATE), commands[answers], period_ns)
    late = 0
    if run_mode(bag) != LOCKSTEP:
        late = int(np.count_nonzero(command_latency(bag)[1] * NS_PER_S > period_ns))
    return {
        'count': count,
        'missed': count - answered + late,
        'unanswered': count - answered,
        'late': late,
        'blind': int(np.count_nonzero(~answers)),
    }


def timing_report(bag: read.Bag) -> dict[str, Any]:
    """Return quantiles [ms] of the parts, of the command interval and of the plant's lateness.

    Of valid messages; `invalid_messages` counts the others by topic. In lockstep stamps are no wall
    time: the plant's lateness is None. Raises BagError when a topic is empty.
    """
    bag = drop_invalid(bag)
    mode, ticks = run_mode(bag), count_ticks(bag)
    lateness = (read.recording(bag, STATE).publish_ns - stamps_ns(bag, STATE)) / NS_PER_MS
    intervals = np.diff(np.unique(read.recording(bag, COMMAND).publish_ns)) / NS_PER_MS
    mean = float(intervals.mean()) if intervals.size else None
    return {
        'mode': mode,
        'ticks': ticks,
        'parts_ms': {name: quantiles(part) for name, part in tick_parts(bag)._asdict().items()},
        'interval_ms': {**quantiles(intervals), 'mean': mean},
        'state_sent_after_its_stamp_ms': None if mode == LOCKSTEP else quantiles(lateness),
        **count_invalid(bag),
    }


def describe_ticks(counts: Mapping[str, int]) -> str:
    """Return counted ticks, as in the report, as one line for a person."""
    return (
        '{count} ticks, {missed} missed: {unanswered} unanswered, {late} late; '
        '{blind} commands without a state'
    ).format(**counts)


def quantiles(values: np.ndarray) -> dict[str, float]:
    """Return the QUANTILES by name; none of no values."""
    if not values.size:
        return {}
    return dict(zip(QUANTILES, np.percentile(values, [*QUANTILES.values()]).tolist()))


def summarize_bag(bag: read.Bag) -> dict[str, Any]:
    """Return the summary of a bag, ready for JSON; None where the bag lacks the messages for it.

    Rates and gaps are of log time: ROS time in lockstep, time of arrival in realtime. Messages that
    break the contract are counted by topic and left out of everything about the controller. Answers
    to the state that ended the run, which is no tick, are counted apart.
    """
    valid = drop_invalid(bag)
    present = [r for r in bag.recordings.values() if r.payloads]
    first = min(int(r.log_ns.min()) for r in present)
    last = max(int(r.log_ns.max()) for r in present)
    summary = {
        'path': str(bag.path),
        'files': {file.name: file.stat().st_size for file in bag.files},
        'bytes': sum(file.stat().st_size for file in bag.files),
        'mode': run_mode(bag),
        'start_s': first / NS_PER_S,
        'duration_s': (last - first) / NS_PER_S,
        'messages': sum(len(r.payloads) for r in present),
        'damage': bag.damage,
        'topics': {name: _summarize_topic(recorded) for name, recorded in bag.recordings.items()},
        **count_invalid(valid),
        **dict.fromkeys(('latency_ms', 'ticks', 'rungs', 'fallbacks', 'reports')),
    }
    if read.has_messages(valid, STATE, COMMAND):
        known = quantiles(MS_PER_S * command_latency(valid)[1])
        if known:
            summary['latency_ms'] = {name: known[name] for name in ('p50', 'p99', 'max')}
        summary['ticks'] = count_ticks(valid)
    if whys := controller_reports(valid):
        rungs = [(why.values.get('rung'), why.values.get('reason')) for why in whys]
        last_ns = stamps_ns(valid, STATE).max() if read.has_messages(valid, STATE) else None
        on_last = [r for why, (_, r) in zip(whys, rungs) if why.stamp_ns == last_ns]
        fell_back = (reason for rung, reason in rungs if rung not in FRESH_PLAN)
        summary['rungs'] = dict(Counter(str(rung) for rung, _ in rungs))
        summary['fallbacks'] = dict(Counter(map(str, fell_back)))
        count = sum(reason != STATE_STALE for reason in on_last)
        summary['reports'] = {'count': len(whys), 'on_last_state': count}
    return {**summary, 'run': bag.run_info}


def _summarize_topic(recorded):
    """Count, rate [1/s], longest gap [s] and losses of one topic; losses None where unknown."""
    n = len(recorded.payloads)
    gaps = np.diff(np.sort(recorded.log_ns)) / NS_PER_S
    span = float(gaps.sum())
    losses = LossCounter().add_all(recorded.sequence.tolist()).losses
    return {
        'type': recorded.topic.type,
        'messages': n,
        'rate_hz': (n - 1) / span if span > 0.0 else None,
        'longest_gap_s': float(gaps.max()) if n > 1 else None,
        'lost': losses.lost,
        'lost_places': losses.gaps,
        'lost_longest': losses.longest,
        'sent_before': losses.before,
    }
