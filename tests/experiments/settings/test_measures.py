"""What is held for a while: by definition, and against brute force."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from experiments.settings import measures

STEP_NS = 10_000_000


def stamps(count):
    return np.arange(count) * STEP_NS


def test_a_peak_shorter_than_the_time_does_not_count():
    values = np.full(100, 2.0)
    values[40:45] = 9.0  # 40 ms
    values[60:72] = 5.0  # 110 ms
    assert measures.held_peak(stamps(100), values, 0.1) == 5.0
    assert measures.held_peak(stamps(100), values, 0.03) == 9.0
    assert measures.held_peak(stamps(5), values[:5], 0.1) is None


@given(st.lists(st.floats(0.0, 10.0), min_size=12, max_size=60), st.integers(1, 10))
def test_the_held_peak_is_the_largest_that_every_sample_of_a_window_reaches(values, steps):
    expected = max(min(values[k : k + steps + 1]) for k in range(len(values) - steps))
    held = measures.held_peak(stamps(len(values)), np.array(values), steps * STEP_NS * 1e-9)
    assert held == pytest.approx(expected)


@given(st.lists(st.booleans(), max_size=40), st.integers(0, 6))
def test_starts_are_where_a_condition_begins_and_stays(condition, steps):
    held_s = steps * STEP_NS * 1e-9 - 1e-6  # safely below the next sample
    starts = measures.held_starts(stamps(len(condition)), np.array(condition, bool), held_s)
    expected = [
        k
        for k in range(len(condition))
        if condition[k]
        and (k == 0 or not condition[k - 1])
        and len(condition) - k > steps
        and all(condition[k : k + steps + 1])
    ]
    assert starts == expected
