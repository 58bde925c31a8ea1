"""The draws are the same for everybody, inside their ranges, and spread over them."""

import numpy as np
import pytest

from bags.errors import BagError
from experiments.batch import run_spec


def test_a_longer_study_begins_with_the_draws_of_a_shorter_one():
    assert run_spec.draw_runs(100)[:60] == run_spec.draw_runs(60)


def test_another_seed_gives_other_draws():
    assert not set(run_spec.draw_runs(10)[0]) & set(run_spec.draw_runs(10, seed=2)[0])


def test_draws_fill_their_ranges_evenly():
    speed, grip = map(np.array, zip(*run_spec.draw_runs(60)))
    unit = [
        (speed / run_spec.SPEED_SPREAD_KPH + 1) / 2,
        ((grip - 1) / run_spec.GRIP_SPREAD + 1) / 2,
    ]
    for values in unit:
        # no tenth of a range is left out, none is preferred: 6 +- 3 of 60
        counts, _ = np.histogram(values, bins=10, range=(0, 1))
        assert counts.sum() == 60
        assert counts.min() >= 3
        assert counts.max() <= 9


@pytest.mark.parametrize('runs', [0, -1, run_spec.MAX_RUNS + 1])
def test_a_number_of_runs_out_of_range_is_refused_with_the_range(runs):
    with pytest.raises(BagError, match='from 1 to 10000'):
        run_spec.draw_runs(runs)
