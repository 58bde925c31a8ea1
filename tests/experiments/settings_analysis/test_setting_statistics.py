"""Statistics over settings against closed forms and against simulated coverage."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import beta

from experiments.settings_analysis import setting_statistics as statistics
from experiments.statistical_inference import holm

P_VALUES = st.dictionaries(st.text(min_size=1, max_size=3), st.floats(0.0, 1.0), min_size=1)


def test_none_of_n_is_below_three_over_n():
    """The rule of three; 0 of 400 means below 0.75 %."""
    interval = statistics.share_interval(np.zeros(400, bool))
    assert interval.low == 0.0
    assert interval.high == pytest.approx(0.0075, rel=0.01)
    # the exact bound of Clopper and Pearson
    assert interval.high == pytest.approx(beta.ppf(0.95, 1, 400), rel=1e-9)


def test_all_of_n_mirrors_none_of_n():
    none = statistics.share_interval(np.zeros(50, bool))
    every = statistics.share_interval(np.ones(50, bool))
    assert every.high == 1.0
    assert every.low == pytest.approx(1.0 - none.high)


@pytest.mark.parametrize('share', [0.1, 0.5])
def test_a_share_is_covered_as_often_as_said(share):
    rng = np.random.default_rng(3)
    intervals = [statistics.share_interval(rng.random(120) < share) for _ in range(150)]
    covered = np.mean([low <= share <= high for low, high in intervals])
    # 95 % within four standard errors of 150 repeats, and what discreteness takes
    assert 0.87 <= covered <= 1.0


def test_a_median_is_covered_as_often_as_said():
    rng = np.random.default_rng(4)
    intervals = [statistics.median_interval(rng.standard_cauchy(80)) for _ in range(100)]
    assert np.mean([low <= 0.0 <= high for low, high in intervals]) >= 0.87


def test_one_setting_says_nothing():
    assert statistics.median_interval(np.array([3.0])) == (-np.inf, np.inf)


@pytest.mark.parametrize(
    ('interval', 'expected'),
    [
        ((0.6, 0.9), 'larger'),
        ((-0.9, -0.6), 'smaller'),
        ((-0.4, 0.4), 'equivalent'),
        ((-0.9, 0.4), 'not larger'),
        ((-0.4, 0.9), 'not smaller'),
        ((-0.9, 0.9), 'open'),
        ((0.5, 0.9), 'not smaller'),  # a margin that is only touched excludes nothing
    ],
)
def test_what_an_interval_says_at_a_margin_of_one_half(interval, expected):
    assert statistics.relation(statistics.Interval(*interval), 0.5) == expected


def test_holm_against_a_case_by_hand():
    adjusted = holm({'a': 0.01, 'b': 0.04, 'c': 0.03, 'd': 0.005})
    assert adjusted == pytest.approx({'a': 0.03, 'b': 0.06, 'c': 0.06, 'd': 0.02})


@given(P_VALUES)
def test_holm_keeps_the_order_and_is_between_itself_and_bonferroni(p_values):
    adjusted = holm(p_values)
    assert list(adjusted) == list(p_values)
    for name, p_value in p_values.items():
        assert p_value <= adjusted[name] <= min(1.0, len(p_values) * p_value) + 1e-12
        for other in p_values:
            if p_value < p_values[other]:
                assert adjusted[name] <= adjusted[other]


def test_holm_rarely_rejects_what_is_true():
    """The family-wise error of five true hypotheses stays at most 5 %."""
    rng = np.random.default_rng(5)
    draws = rng.random((2000, 5))
    names = 'abcde'
    wrong = [min(holm(dict(zip(names, row))).values()) <= 0.05 for row in draws]
    assert np.mean(wrong) <= 0.05 + 4 * np.sqrt(0.05 * 0.95 / len(draws))
