"""Shares with their intervals, medians with their ranges, and the run that stands for the rest."""

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from experiments.study.drives import Record

CONFIDENCE = 0.95
# what decides which run is the median one
JUDGED = ('min_v2o_m', 'min_v2e_m', 'peak_sideslip_deg', 'min_speed_mps', 'rms_contouring_m')


class Share(NamedTuple):
    """In how many of the runs something holds, with its Wilson interval."""

    holds: int
    runs: int
    low: float
    high: float

    @property
    def share(self) -> float:
        """The share itself."""
        return self.holds / self.runs


class Summary(NamedTuple):
    """A number over the runs in which it has a meaning; None where it has none in most of them."""

    median: float | None
    least: float | None
    most: float | None
    runs: int  # in which it has a meaning


def share(holds: Sequence[bool]) -> Share:
    """Return the share of truths among at least one, with its 95 % Wilson score interval."""
    return share_of(sum(map(bool, holds)), len(holds))


def share_of(holds: int, runs: int) -> Share:
    """Return the share `holds` of `runs` with its 95 % Wilson score interval."""
    from scipy.stats import binomtest

    interval = binomtest(holds, runs).proportion_ci(CONFIDENCE, method='wilson')
    return Share(holds, runs, float(interval.low), float(interval.high))


def summary(values: Sequence[float | None]) -> Summary:
    """Return median and range; a value that is None counts as later than any (no braking)."""
    known = [float(value) for value in values if value is not None]
    padded = known + [math.inf] * (len(values) - len(known))
    median = float(np.median(padded)) if known else math.inf
    return Summary(
        median if math.isfinite(median) else None,
        min(known, default=None),
        max(known, default=None),
        len(known),
    )


def median_run(records: Mapping[str, Sequence[Record]]) -> int:
    """Return the index of the draw that is nearest to the median of every controller at once.

    For each controller and each of JUDGED the runs are ranked (ties share their mean rank); the
    draw with the smallest sum of distances to the middle rank is chosen, the first one of equals.
    """
    from scipy.stats import rankdata

    distances = sum(
        np.abs(rankdata([_last(run.value(name)) for run in runs]) - (len(runs) + 1) / 2)
        for runs in records.values()
        for name in JUDGED
    )
    return int(np.argmin(distances))


def _last(value):
    return math.inf if value is None else value
