"""Intervals and medians against closed forms."""

import math

import pytest

from experiments.study import run_statistics


@pytest.mark.parametrize(('holds', 'runs'), [(0, 60), (57, 60), (60, 60), (1, 2)])
def test_the_interval_is_the_wilson_interval(holds, runs):
    found = run_statistics.share([True] * holds + [False] * (runs - holds))
    z, p = 1.959963984540054, holds / runs
    middle = (p + z**2 / (2 * runs)) / (1 + z**2 / runs)
    half = z / (1 + z**2 / runs) * math.sqrt(p * (1 - p) / runs + z**2 / (4 * runs**2))
    assert found.low == pytest.approx(middle - half, abs=1e-9)
    assert found.high == pytest.approx(middle + half, abs=1e-9)
    assert found.share == p


def test_a_missing_value_ranks_above_all_others():
    assert run_statistics.summarise([3.0, None, 1.0]) == (3.0, 1.0, 3.0, 2)
    assert run_statistics.summarise([3.0, None, None]) == (None, 3.0, 3.0, 1)
    assert run_statistics.summarise([None, None]) == (None, None, None, 0)


def test_the_median_run_is_in_the_middle_of_every_metric(make_record):
    def runs(values):
        return [
            make_record(**dict.fromkeys(run_statistics.MEDIAN_METRICS, value)) for value in values
        ]

    assert run_statistics.find_median_run({'mpcc': runs([5.0, 1.0, 3.0, 9.0, 2.0])}) == 2
    both = {'mpcc': runs([1.0, 2.0, 3.0]), 'frenet': runs([20.0, 30.0, 10.0])}
    # distances to the middle rank: 1 + 0, 0 + 1, 1 + 1
    assert run_statistics.find_median_run(both) == 0
