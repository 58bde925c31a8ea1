"""Shares of success over a quantity, here the speed, and where they fall through a level.

The speeds at which shares fall through LEVELS are those of the non-increasing shares closest to
them; intervals are those of the posterior with Jeffreys' prior per speed, each sample made monotone
(Dunson & Neelon, "Bayesian inference on order-constrained parameters in generalized linear models",
Biometrics 2003). Draws may be paired over speeds; the intervals take speeds for independent.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from experiments.statistical_inference import CONFIDENCE
from experiments.study import run_statistics
from experiments.study.run_statistics import Share

LEVELS = (0.9, 0.5)  # shares of successes
SAMPLES = 1000
SEED = 1


class Crossing(NamedTuple):
    """The speed [km/h] at which a share falls through a level, with its 95 % interval.

    Minus infinity where it is below the level at the lowest speed, infinity where it never falls
    below it.
    """

    level: float
    kph: float
    low: float
    high: float


class SuccessCurve(NamedTuple):
    """The shares of one controller over the speeds."""

    name: str
    speeds_kph: tuple[float, ...]
    shares: tuple[Share, ...]
    monotone: np.ndarray  # (speeds,) the non-increasing shares closest to them
    monotone_p: float  # of shares that are as uneven, if the true ones fall with the speed
    crossings: tuple[Crossing, ...]

    def __repr__(self) -> str:
        return f'SuccessCurve({self.name!r}, {[f"{s.holds}/{s.runs}" for s in self.shares]})'


def fit_curve(
    name: str, speeds_kph: Sequence[float], cleared: Sequence[int], runs: int
) -> SuccessCurve:
    """Return the curve of `cleared` runs of `runs` at each speed, in increasing order."""
    rng = np.random.default_rng(SEED)
    counts = np.array(cleared)
    monotone = _fall(counts / runs)
    simulated = rng.binomial(runs, monotone, (SAMPLES, len(counts))) / runs
    uneven = np.sum((counts / runs - monotone) ** 2)
    as_uneven = [np.sum((curve - _fall(curve)) ** 2) >= uneven - 1e-12 for curve in simulated]
    posterior = rng.beta(counts + 0.5, runs - counts + 0.5, (SAMPLES, len(counts)))
    samples = [_fall(curve) for curve in posterior]
    return SuccessCurve(
        name,
        tuple(speeds_kph),
        tuple(run_statistics.share_of_counts(int(count), runs) for count in counts),
        monotone,
        float(np.mean(as_uneven)),
        tuple(_crossing(speeds_kph, monotone, samples, level) for level in LEVELS),
    )


def _fall(shares):
    """Return the closest shares (n,) that do not rise."""
    from scipy.optimize import isotonic_regression

    return isotonic_regression(shares, increasing=False).x


def _crossing(speeds_kph, monotone, samples, level):
    at = find_crossing(speeds_kph, monotone, level)
    outer = (1 - CONFIDENCE) / 2
    sampled = [find_crossing(speeds_kph, curve, level) for curve in samples]
    # no value between two samples: one of them may be infinite
    low = np.quantile(sampled, outer, method='lower')
    high = np.quantile(sampled, 1 - outer, method='higher')
    return Crossing(level, at, float(min(low, at)), float(max(high, at)))


def find_crossing(speeds_kph: Sequence[float], shares: np.ndarray, level: float) -> float:
    """Return the speed at which shares that do not rise fall below a level, linear between speeds.

    Minus infinity or infinity where they do so before or after all speeds.
    """
    below = np.flatnonzero(shares < level)
    if not below.size:
        return np.inf
    k = int(below[0])
    if k == 0:
        return -np.inf
    part = (shares[k - 1] - level) / (shares[k - 1] - shares[k])
    return float(speeds_kph[k - 1] + part * (speeds_kph[k] - speeds_kph[k - 1]))
