"""What a bag contains: topics, rates, gaps and losses, latency and deadline misses of its run."""

from collections import Counter
from typing import Any

import numpy as np

from bags.evaluation.controller_log import STATE_STALE, WHY
from bags.evaluation.drive import FRESH_PLAN
from bags.evaluation.tick_timing import (
    COMMAND,
    MS_PER_S,
    STATE,
    command_latency,
    controller_reports,
    count_ticks,
    quantiles,
    run_mode,
    stamps_ns,
)
from bags.storage import read
from bags.storage.invalid_messages import count_invalid, drop_invalid
from bags.storage.message_loss import LossCounter
from msgs_yaml.conversions import NS_PER_S


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
        counts = count_ticks(valid)
        names = ('count', 'missed', 'unanswered', 'late', 'blind')
        summary['ticks'] = {name: counts[name] for name in names}
    if read.has_messages(valid, WHY):
        whys, last_ns = controller_reports(valid), None
        if read.has_messages(valid, STATE):
            last_ns = int(stamps_ns(valid, STATE).max())
        reports = [why.values for why in whys]
        fell_back = [report for report in reports if report.get('rung') not in FRESH_PLAN]
        on_last = [why.values.get('reason') for why in whys if why.stamp_ns == last_ns]
        on_last = sum(reason != STATE_STALE for reason in on_last)
        summary['rungs'] = dict(Counter(str(report.get('rung')) for report in reports))
        summary['fallbacks'] = dict(Counter(str(report.get('reason')) for report in fell_back))
        summary['reports'] = {'count': len(reports), 'on_last_state': on_last}
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
