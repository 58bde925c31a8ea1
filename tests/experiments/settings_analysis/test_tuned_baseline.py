"""The tuned baseline: what its cost rewards, its table, and that it is read back."""

import math
from itertools import pairwise

import pandas as pd
import pytest

from bags.errors import BagError
from experiments.settings import preregistration
from experiments.settings.run_settings import read_tuned
from experiments.settings_analysis import baseline_tuning, tuned_table
from experiments.settings_analysis.tuned_table import Cell

GOOD = {
    'completed': True,
    'collided': False,
    'left_road': False,
    'min_v2o_m': 0.6,
    'min_v2e_m': 0.6,
    'rms_contouring_m': 0.2,
    'peak_sideslip_deg': 3.0,
    'min_speed_mps': 20.0,
}
TABLE = (
    Cell(0.1, 0.2, ({'tolerances.contouring_m': 0.3}, {'tolerances.contouring_m': 0.4})),
    Cell(0.2, 1.2, ({'tolerances.contouring_m': 0.5},)),
)


def cost(off=0.5, **changes):
    return baseline_tuning.cost(GOOD | changes, 0.5, 0.5, off)


def test_tracking_speed_and_kept_distances_cost():
    assert cost(rms_contouring_m=0.3) > cost()
    assert cost(off=1.0) > cost()
    assert cost(min_v2o_m=0.4) > cost()
    assert cost(min_v2e_m=0.4) > cost()
    assert cost(min_v2o_m=0.5) == cost()  # more than the safety distance is no better


@pytest.mark.parametrize('failure', [{'completed': False}, {'collided': True}, {'left_road': True}])
def test_a_failed_drive_costs_most(failure):
    assert cost(**failure) == baseline_tuning.FAILED > cost(off=10.0, min_v2o_m=0.0)


def test_what_the_claims_are_about_costs_nothing():
    assert cost(peak_sideslip_deg=20.0, min_speed_mps=1.0, brake_onset_planned_at_m=3.0) == cost()


def test_cells_cover_the_strata_once():
    plan = preregistration.load()
    cells = baseline_tuning.cells_of(plan)
    assert cells[0][0] == plan.strata.S[0]
    assert cells[-1][1] == plan.strata.S[-1]
    assert all(one[1] == other[0] for one, other in pairwise(cells))
    assert max(baseline_tuning.SEEDS) < 1000  # seeds that judge begin there


def test_a_table_is_read_as_it_was_written(tmp_path):
    file = tmp_path / 'tuned.yaml'
    file.write_text(tuned_table.dump(TABLE))
    assert tuned_table.load(file) == TABLE


@pytest.mark.parametrize(
    ('old', 'new', 'named'),
    [
        ('tolerances.contouring_m', 'tolerances.contour', 'tolerances.contour'),
        ('- 1.2', '- 0.1', 'low < high'),
        ('baseline: frenet', 'baseline: mpcc', 'frenet'),
        ('0.5', '.inf', 'finite'),
    ],
)
def test_a_wrong_table_says_what_is_wrong(tmp_path, old, new, named):
    file = tmp_path / 'tuned.yaml'
    text = tuned_table.dump(TABLE)
    assert old in text
    file.write_text(text.replace(old, new))
    with pytest.raises(BagError, match=named):
        tuned_table.load(file)


@pytest.mark.parametrize(
    ('number', 'S', 'expected'),
    [(4, 0.15, 0.3), (5, 0.15, 0.4), (5, 0.7, 0.5), (4, 0.05, 0.3), (4, 2.0, 0.5)],
)
def test_a_setting_has_the_set_of_its_number_in_the_nearest_cell(number, S, expected):
    values = tuned_table.parameters_of(TABLE, number, S)
    assert values == {'tolerances.contouring_m': expected}


def test_the_drives_read_the_parameters_by_setting(tmp_path):
    file = tmp_path / 'tuned.csv'
    tuned_table.by_setting(TABLE, {4: 0.15, 9: 0.7}).to_csv(file)
    assert read_tuned(file) == {
        4: {'tolerances.contouring_m': 0.3},
        9: {'tolerances.contouring_m': 0.5},
    }
    assert not math.isnan(pd.read_csv(file)['tolerances.contouring_m'].sum())
