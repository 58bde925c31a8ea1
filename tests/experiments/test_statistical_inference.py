"""The interval of a share against its closed form."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from experiments.statistical_inference import wilson_interval

Z = 1.959963984540054  # quantile of the normal distribution for 95 %, both sides


@given(st.integers(1, 400).flatmap(lambda n: st.tuples(st.integers(0, n), st.just(n))))
def test_the_interval_is_the_roots_of_the_score_test(counts):
    """Where (share - p)^2 = z^2 p (1 - p) / n; at shares of 0 and 1 one root is that end."""
    successes, n = counts
    share = successes / n
    for p in wilson_interval(successes, n):
        assert 0.0 <= p <= 1.0
        assert abs(share - p) == pytest.approx(Z * math.sqrt(p * (1 - p) / n), abs=1e-7)
    assert wilson_interval(successes, n)[0] <= share + 1e-12
    assert share - 1e-12 <= wilson_interval(successes, n)[1]


def test_without_a_trial_nothing_is_known():
    assert wilson_interval(0, 0) == (0.0, 1.0)
