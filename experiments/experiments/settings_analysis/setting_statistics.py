"""Statistics over settings: bootstrap intervals, exact ones at the ends.

A setting is the unit: repeated drives of one setting are summarised before they come here, so
that the values of different settings are independent.
"""

from typing import NamedTuple

import numpy as np
from scipy import stats

CONFIDENCE = 0.95
RESAMPLES = 4999
SEED = 1


class Interval(NamedTuple):
    """A confidence interval."""

    low: float
    high: float


def share_interval(holds: np.ndarray, confidence: float = CONFIDENCE) -> Interval:
    """Return the interval of the share of truths among independent settings, (n,) bool, n > 0.

    The bias-corrected and accelerated bootstrap (Efron 1987) over settings. Where all values agree
    no resample differs, so that it has no width; there the interval is the exact one of Clopper and
    Pearson, one-sided: 0 of n gives [0, 1 - (1 - confidence)^(1/n)], which is the "rule of three"
    3/n at 95 %.
    """
    holds = np.asarray(holds, dtype=float)
    n = len(holds)
    missed = 1.0 - (1.0 - confidence) ** (1.0 / n)
    if not holds.any():
        return Interval(0.0, missed)
    if holds.all():
        return Interval(1.0 - missed, 1.0)
    return _bootstrap(holds, np.mean, 'BCa', confidence)


def median_interval(values: np.ndarray, confidence: float = CONFIDENCE) -> Interval:
    """Return the percentile bootstrap interval of the median of the values (n,), n > 0.

    The jackknife, which BCa needs, is not consistent for a median.
    """
    values = np.asarray(values, dtype=float)
    if len(values) == 1:
        return Interval(-np.inf, np.inf)
    return _bootstrap(values, np.median, 'percentile', confidence)


def mean_interval(values: np.ndarray, confidence: float = CONFIDENCE) -> Interval:
    """Return the bootstrap interval (BCa) of the mean of the values (n,), n > 0."""
    values = np.asarray(values, dtype=float)
    if len(values) == 1:
        return Interval(-np.inf, np.inf)
    if np.ptp(values) <= 1e-9 * np.max(np.abs(values)):  # BCa is undefined without any spread
        return Interval(float(values.min()), float(values.max()))
    return _bootstrap(values, np.mean, 'BCa', confidence)


def _bootstrap(values, statistic, method, confidence):
    result = stats.bootstrap(
        (values,),
        statistic,
        n_resamples=RESAMPLES,
        confidence_level=confidence,
        method=method,
        # blocks of resamples: memory stays below 100 MB for 10,000 settings
        batch=1000,
        rng=np.random.default_rng(SEED),
    )
    return Interval(*map(float, result.confidence_interval))


def share_p_value(holds: int, settings: int, share: float, alternative: str) -> float:
    """Return the exact one-sided p-value against a true share of `share`; 1 without any setting.

    `alternative` is what is to be shown: that the true share is `greater` or `less`.
    """
    if not settings:
        return 1.0
    return float(stats.binomtest(holds, settings, share, alternative).pvalue)


def mean_p_value(values: np.ndarray) -> float:
    """Return the p-value of the hypothesis that the values (n,) are symmetric about zero.

    Wilcoxon's signed-rank test; 1 where all values are zero.
    """
    values = np.asarray(values, dtype=float)
    if not np.any(values):
        return 1.0
    return float(stats.wilcoxon(values).pvalue)


def relation(interval: Interval, margin: float) -> str:
    """Return what an interval of a paired difference says, given an equivalence margin > 0.

    `larger` or `smaller`: beyond the margin; `equivalent`: within it (both one-sided tests of
    Schuirmann reject); `not larger` or `not smaller`: one side is excluded; otherwise `open`.
    """
    low, high = interval
    if low > margin:
        return 'larger'
    if high < -margin:
        return 'smaller'
    if low > -margin and high < margin:
        return 'equivalent'
    if high < margin:
        return 'not larger'
    if low > -margin:
        return 'not smaller'
    return 'open'
