"""Intervals of a share and of a paired difference against what defines them."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import norm

from experiments.statistical_inference import paired_interval, wilson_interval

Z = norm.ppf(0.975)  # of 95 %, both sides


def score(only_first, only_second, pairs, difference):
    """Return by how many standard deviations a difference of two shares misses the found one.

    The deviation is that of the likeliest shares with this difference, found on a fine grid.
    """
    second = np.linspace(max(0.0, -difference), (1 - difference) / 2, 200_001)[1:-1]
    first = second + difference
    likelihood = (pairs - only_first - only_second) * np.log(1 - first - second)
    likelihood += only_first * np.log(first) + only_second * np.log(second)
    k = np.argmax(likelihood)
    deviation = math.sqrt((first[k] + second[k] - difference**2) / pairs)
    return ((only_first - only_second) / pairs - difference) / deviation


@pytest.mark.parametrize('counts', [(187, 1, 300), (12, 2, 50), (4, 4, 9), (0, 3, 10), (7, 0, 36)])
def test_the_ends_of_a_paired_interval_are_rejected_just_so(counts):
    low, high = paired_interval(*counts)
    assert score(*counts, low) == pytest.approx(Z, abs=2e-3)
    assert score(*counts, high) == pytest.approx(-Z, abs=2e-3)


@given(st.lists(st.integers(0, 30), min_size=3, max_size=3).filter(any))
def test_a_paired_interval_holds_the_difference_turns_around_and_has_a_width(counts):
    first, second, _ = counts
    pairs = sum(counts)
    low, high = paired_interval(first, second, pairs)
    assert -1.0 <= low <= (first - second) / pairs <= high <= 1.0
    assert paired_interval(second, first, pairs) == pytest.approx((-high, -low), abs=1e-7)
    assert high - low > 0.5 / math.sqrt(pairs + 4)


def test_without_a_trial_or_a_pair_nothing_is_known():
    assert wilson_interval(0, 0) == (0.0, 1.0)
    assert paired_interval(0, 0, 0) == (-1.0, 1.0)
