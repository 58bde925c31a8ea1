"""Intervals over replicates, and the rules of the study that were fixed before it was run."""

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

CONFIDENCE = 0.95


class Estimate(NamedTuple):
    """A mean over units with its interval; NaN where there is none."""

    mean: float
    low: float
    high: float
    units: int = 0
    scatter: float = math.nan  # standard deviation over units
    p: float = math.nan  # two-sided, of a mean of 0


class Verdict(NamedTuple):
    """A decision; the interval has the level at which Holm's procedure tests this hypothesis."""

    hypothesis: str
    estimate: Estimate
    confidence: float
    margin: float
    text: str
    more: int  # replicates that would make the interval as wide as the margin, 0 unless open


def estimate(values: Sequence[float], confidence: float = CONFIDENCE) -> Estimate:
    """Return the mean of units with Student's t interval; units without a value do not count."""
    from scipy.stats import t

    known = np.asarray(values, dtype=float)
    known = known[np.isfinite(known)]
    count = known.size
    if count < 2:
        return Estimate(float(known.mean()) if count else math.nan, math.nan, math.nan, count)
    mean, scatter = float(known.mean()), float(known.std(ddof=1))
    error = scatter / math.sqrt(count)
    half = float(t.ppf((1 + confidence) / 2, count - 1)) * error
    if error > 0.0:
        p = float(2 * t.sf(abs(mean) / error, count - 1))
    else:
        p = 1.0 if mean == 0.0 else 0.0
    return Estimate(mean, mean - half, mean + half, count, scatter, p)


def decide(
    gap: Sequence[float], balance: Sequence[float], rules: Mapping[str, Any]
) -> list[Verdict]:
    """Return the verdicts on avoidance gap and balance of sideslip, each given by replicate.

    `rules` are those under `confirmatory` in a plan.

    Holm's procedure (1979, Scandinavian Journal of Statistics 6, 65-70) over both, in terms of
    intervals: that with the smaller p has 97.5 %; if it excludes 0, the other has 95 %, else 97.5 %
    too. So an interval excludes 0 just where the procedure rejects 0 at a level of 5 %. What a
    verdict says about a size has the level of its own interval.
    """
    samples = {'avoidance gap': gap, 'win balance of sideslip': balance}
    margins = [rules[name]['margin'] for name in ('avoidance_gap', 'sideslip_balance')]
    levels = holm_levels([estimate(values).p for values in samples.values()])
    verdicts = []
    for (name, values), margin, level in zip(samples.items(), margins, levels):
        interval = estimate(values, 1 - level)
        verdicts.append(Verdict(name, interval, 1 - level, margin, *verdict(interval, margin)))
    return verdicts


def holm_levels(p: Sequence[float], alpha: float = 1 - CONFIDENCE) -> list[float]:
    """Return the level at which Holm's step-down procedure tests each hypothesis.

    The least p is tested at alpha / n, the next at alpha / (n - 1), and so on; behind the first
    that is not rejected the level stays, and nothing is rejected. NaN is never rejected.
    """
    values = [1.0 if math.isnan(value) else value for value in p]
    levels, level, rejected = [0.0] * len(values), 0.0, True
    for rank, k in enumerate(np.argsort(values, kind='stable')):
        if rejected:
            level = alpha / (len(values) - rank)
        rejected = rejected and values[k] < level
        levels[k] = level
    return levels


def verdict(interval: Estimate, margin: float) -> tuple[str, int]:
    """Return the verdict on a difference MPCC less baseline, and how many replicates it lacks."""
    low, high = interval.low, interval.high
    if low > 0.0 or high < 0.0:
        small = -margin <= low and high <= margin
        size = f', by less than {100 * margin:g} points' if small else ''
        return f'{"MPCC" if low > 0.0 else "baseline"} better{size}', 0
    if -margin <= low and high <= margin:
        return 'equivalent', 0
    if math.isnan(low):
        return 'open', 0
    return 'open', math.ceil(interval.units * ((width(interval) / margin) ** 2 - 1))


def stop_rule(replicates: int, widths: Sequence[float], rules: Mapping[str, Any]) -> str:
    """Return whether the study stops, from the widths of both intervals of 95 % alone.

    `rules` are those under `stop` in a plan.
    """
    if replicates >= rules['cap']:
        return 'stop: most replicates'
    if replicates < rules['from']:
        return 'go on: fewer than the least replicates'
    wide = any(not width <= most for width, most in zip(widths, rules['widths']))
    return 'go on: an interval is too wide' if wide else 'stop: both intervals are narrow'


def width(interval: Estimate) -> float:
    """Return the width of an interval."""
    return interval.high - interval.low
