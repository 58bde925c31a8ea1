"""When messages were sent and when they were answered, from the times that a bag keeps.

The publisher's time is wall clock in every mode; so latency means something in lockstep too: how
long a state waited for its command, transport and computing together.


Where the time of each tick went, and which ticks were missed: from the times in a bag.

The recorder keeps when each message was sent (wall clock, in every mode); the controller says in
/controller/why when it heard the state and how long each part took. All in ms here.
"""

import itertools
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from bags.evaluation.controller_log import is_answer, report_number
from bags.evaluation.metrics.driving import count_periods
from bags.storage import read
from bags.storage.decoding import header_stamps_ns
from bags.storage.invalid_messages import count_invalid, drop_invalid
from msgs_yaml import contract
from msgs_yaml.conversions import NS_PER_S
from msgs_yaml.types import Why

STATE = '/vehicle/odometry'
COMMAND = '/controller/command'
CLOCK = '/clock'
WHY = '/controller/why'


class Latency(NamedTuple):
    """One row per command that answers a recorded state, n of them."""

    stamp_ns: np.ndarray  # (n,) int64, of the state and of the command
    latency_s: np.ndarray  # (n,) from sending the state to sending the command


def recording_stamps_ns(recorded: read.Recording) -> np.ndarray:
    """Header stamps (n,) int64 of a topic whose messages begin with one; BagError without."""
    return header_stamps_ns(recorded.topic.name, recorded.payloads)


def command_latency(bag: read.Bag) -> Latency:
    """Join every answer with the state of equal stamp; BagError when either topic is empty.

    A state that was sent again counts from the last time it was sent before the command.
    """
    states, commands = read.recording(bag, STATE), read.recording(bag, COMMAND)
    sent_ns = {}
    for stamp, publish in zip(recording_stamps_ns(states).tolist(), states.publish_ns.tolist()):
        sent_ns.setdefault(stamp, []).append(publish)
    rows = []
    of_ns = recording_stamps_ns(commands)
    kept = is_answer(of_ns, controller_reports(bag))
    for stamp, publish in zip(of_ns[kept].tolist(), commands.publish_ns[kept].tolist()):
        before = [sent for sent in sent_ns.get(stamp, ()) if sent <= publish]
        if before:
            rows.append((stamp, publish - max(before)))
    joined = np.array(rows, dtype=np.int64).reshape(-1, 2)
    return Latency(joined[:, 0], joined[:, 1] / NS_PER_S)


def controller_period_ns(mode: str) -> int:
    """Period of the controller in a mode, from the contract."""
    return round(NS_PER_S / contract.load().topics[COMMAND].rate_hz[mode])


def has_messages(bag: read.Bag, *topics: str) -> bool:
    """Tell whether there is a message of each of the topics."""
    return all(name in bag.recordings and bag.recordings[name].payloads for name in topics)


def run_mode(bag: read.Bag) -> str:
    """Return lockstep or realtime: only lockstep has simulated time."""
    return 'lockstep' if has_messages(bag, CLOCK) else 'realtime'


def controller_reports(bag: read.Bag) -> list[Why]:
    """Return what the controller said of its answers; nothing where that was not recorded."""
    return list(read.values(bag, WHY)) if has_messages(bag, WHY) else []


NS_PER_MS = 1e6
MS_PER_S = 1e3
QUANTILES = {'p50': 50.0, 'p90': 90.0, 'p99': 99.0, 'p99.9': 99.9, 'max': 100.0}


class TickParts(NamedTuple):
    """One row per command that answers a recorded state; (n,) ms."""

    total: np.ndarray  # from sending the state to sending the command
    transport: np.ndarray  # from sending the state until the controller hears it
    wait: np.ndarray  # from then to the begin of the step
    prepare: np.ndarray  # numbers of the problem
    solve: np.ndarray  # every solver together
    publish: np.ndarray  # sending the command, until it left
    rest: np.ndarray  # what remains of the total: prediction to the effect, gate, records


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


def tick_parts(bag: read.Bag) -> TickParts:
    """Return the parts of every tick that was solved. Raises BagError when a topic is empty."""
    joined = command_latency(bag)
    states = read.recording(bag, STATE)
    sent_ns = dict(zip(recording_stamps_ns(states).tolist(), states.publish_ns.tolist()))
    whys = controller_reports(bag)
    said = {why.stamp_ns: why.values for why in whys}
    # a tick's sending is told by the next one
    sending = {
        a.stamp_ns: report_number(b.values, 'time.publish_ms') for a, b in itertools.pairwise(whys)
    }
    rows = []
    for stamp, latency_s in zip(joined.stamp_ns.tolist(), joined.latency_s.tolist()):
        values, publish = said.get(stamp, {}), sending.get(stamp, np.nan)
        total = latency_s * MS_PER_S
        known = (
            (report_number(values, 'time.heard_ns') - sent_ns[stamp]) / NS_PER_MS,
            *(report_number(values, f'time.{part}_ms') for part in ('wait', 'prepare', 'solve')),
        )
        if not np.all(np.isfinite([*known, publish])):
            continue
        remaining = total - sum(known)
        # the call goes on for a while after the command has left
        publish = min(publish, remaining)
        rows.append((total, *known, publish, remaining - publish))
    return TickParts(*np.array(rows).reshape(-1, len(TickParts._fields)).T)


def count_ticks(bag: read.Bag) -> TickCounts:
    """Count the ticks by the stamps in the bag.

    Raises BagError when there are no states or no commands.
    """
    mode = run_mode(bag)
    period_ns = controller_period_ns(mode)
    states = recording_stamps_ns(read.recording(bag, STATE))
    commands = recording_stamps_ns(read.recording(bag, COMMAND))
    kept = is_answer(commands, controller_reports(bag))
    count, answered = count_periods(states, commands[kept], period_ns)
    late = 0
    if mode == 'realtime':
        late = int(np.count_nonzero(command_latency(bag).latency_s * NS_PER_S > period_ns))
    return TickCounts(count, count - answered, late, int(np.count_nonzero(~kept)))


def timing_report(bag: read.Bag) -> dict[str, Any]:
    """Return quantiles [ms] of the parts, of the command interval and of the plant's lateness.

    Of valid messages; `invalid_messages` counts the others by topic. In lockstep stamps are no wall
    time: the plant's lateness is None. Raises BagError when a topic is empty.
    """
    bag = drop_invalid(bag)
    mode = run_mode(bag)
    counted = count_ticks(bag)
    sent_ns = np.unique(read.recording(bag, COMMAND).publish_ns)
    states = read.recording(bag, STATE)
    lateness = (states.publish_ns - recording_stamps_ns(states)) / NS_PER_MS
    intervals = np.diff(sent_ns) / NS_PER_MS
    return {
        'mode': mode,
        'ticks': {**counted._asdict(), 'missed': counted.missed},
        'parts_ms': {name: quantiles(part) for name, part in tick_parts(bag)._asdict().items()},
        'interval_ms': {**quantiles(intervals), 'mean': _mean(intervals)},
        'state_sent_after_its_stamp_ms': None if mode == 'lockstep' else quantiles(lateness),
        **count_invalid(bag),
    }


def describe_ticks(counts: Mapping[str, int]) -> str:
    """Return counted ticks, as in the report, as one line for a person."""
    return (
        f'{counts["count"]} ticks, {counts["missed"]} missed: {counts["unanswered"]} unanswered, '
        f'{counts["late"]} late; {counts["blind"]} commands without a state'
    )


def quantiles(values: np.ndarray) -> dict[str, float]:
    """Return the quantiles by name; none of nothing."""
    if not values.size:
        return {}
    return {name: float(np.percentile(values, q)) for name, q in QUANTILES.items()}


def _mean(values):
    return float(values.mean()) if values.size else None
