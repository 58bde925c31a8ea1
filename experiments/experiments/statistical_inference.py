"""Statistical inference: intervals of shares, of their paired differences, and of means."""

import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

CONFIDENCE = 0.95
NEAR = 1e-9


class Estimate(NamedTuple):
    """A mean over units with its interval; NaN where there is none."""

    mean: float
    low: float
    high: float
    units: int = 0
    scatter: float = math.nan  # standard deviation over units
    p: float = math.nan  # two-sided, of a mean of 0


def wilson_interval(successes: int, trials: int) -> tuple[float, float]:
    """Return the Wilson score interval of 95 % of a share (Wilson 1927): 0 to 1 without a trial.

    Unlike the normal approximation it never leaves 0 to 1, and has a width where all succeed.
    """
    # imported late: scipy.stats takes half a second to load
    from scipy.stats import binomtest

    if not trials:
        return 0.0, 1.0
    interval = binomtest(successes, trials).proportion_ci(CONFIDENCE, method='wilson')
    return float(interval.low), float(interval.high)


def paired_interval(only_first: int, only_second: int, pairs: int) -> tuple[float, float]:
    """Return Tango's score interval of 95 % of the difference of two shares of the same pairs.

    `only_first` and `only_second` are the pairs in which one of the two succeeded alone; the
    difference is (only_first - only_second) / pairs. Unlike an interval that takes the number of
    pairs that differ as given it has a width where all of them fall on one side, and where none
    differs (Tango 1998, doi 10.1002/(SICI)1097-0258(19980430)17:8<891::AID-SIM780>3.0.CO;2-B).
    -1 to 1 without a pair.
    """
    if not pairs:
        return -1.0, 1.0
    # imported late, as above
    from scipy.optimize import brentq
    from scipy.stats import norm

    z = float(norm.ppf((1 + CONFIDENCE) / 2))
    estimate = (only_first - only_second) / pairs

    def excess(difference):
        """Return the distance of a difference from the estimate, less what does not reject it."""
        # share of pairs in which the second succeeds alone, the likeliest given the difference
        b = (2 - estimate) * difference - (only_first + only_second) / pairs
        c = only_second / pairs * difference * (1 - difference)
        second = (math.sqrt(max(0.0, b * b + 8 * c)) - b) / 4
        variance = max(0.0, 2 * second + difference * (1 - difference)) / pairs
        return abs(estimate - difference) - z * math.sqrt(variance)

    # at the estimate itself the variance is 0 where no pair differs
    low = brentq(excess, -1.0, estimate - NEAR) if estimate > -1.0 else -1.0
    high = brentq(excess, estimate + NEAR, 1.0) if estimate < 1.0 else 1.0
    return float(low), float(high)


def bootstrap_interval(
    values: np.ndarray,
    statistic: Callable[..., Any],
    resamples: int,
    batch: int,
    rng: np.random.Generator,
) -> tuple[float, float]:
    """Return the percentile bootstrap interval of 95 % of a statistic; NaN of fewer than two."""
    from scipy.stats import bootstrap

    if len(values) < 2:
        return math.nan, math.nan
    how = {'n_resamples': resamples, 'confidence_level': CONFIDENCE, 'batch': batch}
    drawn = bootstrap((values,), statistic, method='percentile', rng=rng, **how)
    return float(drawn.confidence_interval.low), float(drawn.confidence_interval.high)


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
