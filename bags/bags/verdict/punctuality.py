"""Where the time of each tick went, and which ticks were missed: from the times in a bag.

The recorder keeps when each message was sent (wall clock, in every mode); the controller says in
/controller/why when it heard the state and how long each part took. All in ms here.
"""

import itertools
from typing import Any, NamedTuple

import numpy as np

from bags.storage import read
from bags.storage.sift import counts, sift
from bags.verdict import answers, metrics, reported, timing
from msgs_yaml.stamp import NS_PER_S

NS_PER_MS = 1e6
MS_PER_S = 1e3
QUANTILES = {'p50': 50.0, 'p90': 90.0, 'p99': 99.0, 'p99.9': 99.9, 'max': 100.0}


class Parts(NamedTuple):
    """One row per command that answers a recorded state; (n,) ms."""

    total: np.ndarray  # from sending the state to sending the command
    transport: np.ndarray  # from sending the state until the controller hears it
    wait: np.ndarray  # from then to the begin of the step
    prepare: np.ndarray  # numbers of the problem
    solve: np.ndarray  # every solver together
    publish: np.ndarray  # sending the command, until it left
    rest: np.ndarray  # what remains of the total: prediction to the effect, gate, records


class Ticks(NamedTuple):
    """Controller periods between the first command and the last state."""

    count: int
    unanswered: int  # no state of the period was answered
    late: int  # answered later than a period after its state; simulated time waits for it
    blind: int  # commands without a state

    @property
    def missed(self) -> int:
        """Ticks without an answer in time."""
        return self.unanswered + self.late


def parts(bag: read.Bag) -> Parts:
    """Return the parts of every tick that was solved. Raises BagError when a topic is empty."""
    joined = timing.latency(bag)
    states = read.recording(bag, timing.STATE)
    sent_ns = dict(zip(timing.stamps_ns(states).tolist(), states.publish_ns.tolist()))
    whys = timing.whys(bag)
    said = {why.stamp_ns: why.values for why in whys}
    # a tick's sending is told by the next one
    sending = {
        a.stamp_ns: reported.number(b.values, 'time.publish_ms')
        for a, b in itertools.pairwise(whys)
    }
    rows = []
    for stamp, latency_s in zip(joined.stamp_ns.tolist(), joined.latency_s.tolist()):
        values, publish = said.get(stamp, {}), sending.get(stamp, np.nan)
        total = latency_s * MS_PER_S
        known = (
            (reported.number(values, 'time.heard_ns') - sent_ns[stamp]) / NS_PER_MS,
            *(reported.number(values, f'time.{part}_ms') for part in ('wait', 'prepare', 'solve')),
        )
        if not np.all(np.isfinite([*known, publish])):
            continue
        remaining = total - sum(known)
        # the call goes on for a while after the command has left
        publish = min(publish, remaining)
        rows.append((total, *known, publish, remaining - publish))
    return Parts(*np.array(rows).reshape(-1, len(Parts._fields)).T)


def ticks(bag: read.Bag) -> Ticks:
    """Count the ticks by the stamps in the bag.

    Raises BagError when there are no states or no commands.
    """
    mode = timing.mode(bag)
    period_ns = timing.period_ns(mode)
    states = timing.stamps_ns(read.recording(bag, timing.STATE))
    commands = timing.stamps_ns(read.recording(bag, timing.COMMAND))
    kept = answers.are(commands, timing.whys(bag))
    count, answered = metrics.periods(states, commands[kept], period_ns)
    late = 0
    if mode == 'realtime':
        late = int(np.count_nonzero(timing.latency(bag).latency_s * NS_PER_S > period_ns))
    return Ticks(count, count - answered, late, int(np.count_nonzero(~kept)))


def report(bag: read.Bag) -> dict[str, Any]:
    """Return quantiles [ms] of the parts, of the command interval and of the plant's lateness.

    Of valid messages; `invalid_messages` counts the others by topic. In lockstep stamps are no wall
    time: the plant's lateness is None. Raises BagError when a topic is empty.
    """
    bag = sift(bag)
    mode = timing.mode(bag)
    counted = ticks(bag)
    sent_ns = np.unique(read.recording(bag, timing.COMMAND).publish_ns)
    states = read.recording(bag, timing.STATE)
    lateness = (states.publish_ns - timing.stamps_ns(states)) / NS_PER_MS
    intervals = np.diff(sent_ns) / NS_PER_MS
    return {
        'mode': mode,
        'ticks': {**counted._asdict(), 'missed': counted.missed},
        'parts_ms': {name: quantiles(part) for name, part in parts(bag)._asdict().items()},
        'interval_ms': {**quantiles(intervals), 'mean': _mean(intervals)},
        'state_sent_after_its_stamp_ms': None if mode == 'lockstep' else quantiles(lateness),
        **counts(bag),
    }


def quantiles(values: np.ndarray) -> dict[str, float]:
    """Return the quantiles by name; none of nothing."""
    if not values.size:
        return {}
    return {name: float(np.percentile(values, q)) for name, q in QUANTILES.items()}


def _mean(values):
    return float(values.mean()) if values.size else None
