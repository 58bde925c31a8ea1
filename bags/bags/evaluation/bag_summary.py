"""What a bag holds and how the run behind it went in time."""

from collections import Counter
from typing import Any

import numpy as np

from bags.evaluation import tick_timing
from bags.evaluation.controller_log import STATE_STALE
from bags.evaluation.drive import FRESH_PLAN
from bags.storage import read
from bags.storage.invalid_messages import count_invalid, drop_invalid
from bags.storage.message_loss import LossCounter
from msgs_yaml.conversions import NS_PER_S

MS_PER_S = 1000.0


def summarize_bag(bag: read.Bag) -> dict[str, Any]:
    """Return what is known of a bag, ready for JSON; None where the bag lacks what it takes.

    Rates and gaps are of log time: ROS time in lockstep, time of arrival in realtime. Messages that
    break the contract are counted by topic; what is said about the loop leaves them out.
    """
    valid = drop_invalid(bag)
    present = [r for r in bag.recordings.values() if r.payloads]
    first = min(int(r.log_ns.min()) for r in present)
    last = max(int(r.log_ns.max()) for r in present)
    return {
        'path': str(bag.path),
        'files': {file.name: file.stat().st_size for file in bag.files},
        'bytes': sum(file.stat().st_size for file in bag.files),
        'mode': tick_timing.run_mode(bag),
        'start_s': first / NS_PER_S,
        'duration_s': (last - first) / NS_PER_S,
        'messages': sum(len(r.payloads) for r in present),
        'damage': bag.damage,
        'topics': {name: summarize_topic(recorded) for name, recorded in bag.recordings.items()},
        **count_invalid(valid),
        **_loop(valid),
        **_levels(valid),
        'run': bag.run_info,
    }


def summarize_topic(recorded: read.Recording) -> dict[str, Any]:
    """Count, rate [1/s], longest gap [s] and losses of one topic; losses None where unknown."""
    n = len(recorded.payloads)
    gaps = np.diff(np.sort(recorded.log_ns)) / NS_PER_S
    span = float(gaps.sum())
    counted = LossCounter().add_all(recorded.sequence.tolist()).losses
    return {
        'type': recorded.topic.type,
        'messages': n,
        'rate_hz': (n - 1) / span if span > 0.0 else None,
        'longest_gap_s': float(gaps.max()) if n > 1 else None,
        'lost': counted.lost,
        'lost_places': counted.gaps,
        'lost_longest': counted.longest,
        'sent_before': counted.before,
    }


def _loop(bag):
    """How the controller answered, from the times at which states and commands were sent."""
    if not tick_timing.has_messages(bag, tick_timing.STATE, tick_timing.COMMAND):
        return {'latency_ms': None, 'ticks': None}
    latency_ms = MS_PER_S * tick_timing.command_latency(bag).latency_s
    counted = tick_timing.count_ticks(bag)
    return {
        'latency_ms': {
            'p50': float(np.percentile(latency_ms, 50)),
            'p99': float(np.percentile(latency_ms, 99)),
            'max': float(latency_ms.max()),
        }
        if latency_ms.size
        else None,
        'ticks': {
            'count': counted.count,
            'missed': counted.missed,
            'unanswered': counted.unanswered,
            'late': counted.late,
            'blind': counted.blind,
        },
    }


def _levels(bag):
    """What the controller says it did, and why it fell back."""
    if not tick_timing.has_messages(bag, tick_timing.WHY):
        return {'rungs': None, 'fallbacks': None, 'reports': None}
    whys = tick_timing.controller_reports(bag)
    reports = [why.values for why in whys]
    fell = [r for r in reports if r.get('rung') not in FRESH_PLAN]
    return {
        'rungs': dict(Counter(str(report.get('rung')) for report in reports)),
        'fallbacks': dict(Counter(str(report.get('reason')) for report in fell)),
        'reports': {'count': len(reports), 'on_last_state': _on_last_state(bag, whys)},
    }


def _on_last_state(bag, whys):
    """Count answers to the state that ended the run, which is no tick; blind braking is none."""
    if not tick_timing.has_messages(bag, tick_timing.STATE):
        return 0
    last_ns = int(tick_timing.recording_stamps_ns(read.recording(bag, tick_timing.STATE)).max())
    on_last = (why for why in whys if why.stamp_ns == last_ns)
    return sum(why.values.get('reason') != STATE_STALE for why in on_last)
