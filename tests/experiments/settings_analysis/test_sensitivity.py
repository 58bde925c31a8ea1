"""What the tables say beside the verdicts, on a study whose answers are known."""

import pytest
from synthetic_study import make_study

from experiments.settings import arms
from experiments.settings_analysis import sensitivity


@pytest.fixture(scope='module')
def study():
    return make_study(40, factorial=0)


def change(study, arm, settings, **values):
    drives = study.drives.copy()
    chosen = (drives['arm'] == arm) & drives['setting'].isin(settings)
    for name, value in values.items():
        drives.loc[chosen, name] = value
    return study._replace(drives=drives)


def test_every_undisturbed_drive_ends_in_one_way(study):
    study = change(study, arms.MPCC, [0], lost=True, min_v2o_m=-0.1)
    study = change(study, arms.MPCC, [1, 2], min_v2o_m=-0.1)
    study = change(study, arms.MPCC, [3], min_v2e_m=-0.1)
    study = change(study, arms.MPCC, [4], completed=False, min_speed_mps=0.0)
    study = change(study, arms.MPCC, [5], completed=False)
    study = change(study, arms.MPCC, [6], error='its process was ended')
    ends = sensitivity.ends(study, arms.MPCC)
    assert sum(ends.values()) == 40
    assert ends == {
        'avoids': 33,
        'loses control': 1,
        'stops': 1,
        'hits an obstacle': 2,
        'beyond an edge': 1,
        'other': 1,
        'no result': 1,
    }


def test_where_an_outline_touches_a_setting_does_not_count_by_outline(study):
    before = {one.claim: one for one in sensitivity.by_outline(study, arms.MATCHED)}
    assert (before['sideslip'].settings, before['sideslip'].holds) == (40, 40)
    touched = change(study, arms.MATCHED, [0], outline_edge_m=-0.2)
    touched = change(touched, arms.MPCC, [1], min_outline_gap_m=-0.1)
    after = {one.claim: one for one in sensitivity.by_outline(touched, arms.MATCHED)}
    assert (after['sideslip'].settings, after['sideslip'].holds) == (38, 38)
    assert after['min_speed'].holds == before['min_speed'].holds == 0


def test_the_marginals_of_the_accepted_settings_are_theirs(study):
    fast = study.drives.loc[study.drives['velocity_tolerance_mps'] > 6.0, 'setting'].unique()
    outcomes = study.outcomes.copy()
    outcomes.loc[outcomes['setting'].isin(fast), 'P3'] = False
    table = sensitivity.marginals(study._replace(outcomes=outcomes), arms.MATCHED)
    table = table.set_index(['dimension', 'value'])
    assert table.loc[('velocity_tolerance_mps', '75% quantile'), 'accepted'] < 6.0
    assert table.loc[('velocity_tolerance_mps', '75% quantile'), 'all'] > 6.0
    assert table.loc['circles'].sum().to_list() == pytest.approx([1.0, 1.0])
