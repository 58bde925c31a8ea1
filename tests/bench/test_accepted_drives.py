"""The accepted settings are those of the published tables; what differs of their drives is told."""

from pathlib import Path

import accepted_drives
import pandas as pd
import pytest
from pyarrow import parquet

from experiments.settings import arms, preregistration
from experiments.settings import setting as settings

PUBLISHED = Path(__file__).parents[2] / 'paper/settings/confirmatory'
ACCEPTED = accepted_drives.read_settings(PUBLISHED / accepted_drives.SETTINGS)


def test_the_settings_have_the_published_numbers_and_marginals():
    plan = preregistration.load()
    last = max(map(max, ACCEPTED.values()))
    drawn = pd.DataFrame(settings.draw(plan, plan.runs.confirmatory.seed, 0, last + 1))
    assert {name: len(numbers) for name, numbers in ACCEPTED.items()} == {
        arms.MATCHED: 222,
        arms.LINEAGE: 136,
    }
    for baseline, numbers in ACCEPTED.items():
        accepted = drawn.loc[sorted(numbers)]
        published = pd.read_csv(PUBLISHED / f'accepted_{baseline}.csv')
        for row in published.itertuples():
            values = accepted[row.dimension]
            if row.value.startswith('share of '):
                share = (values.astype(str) == row.value.removeprefix('share of ')).mean()
                assert share == pytest.approx(row.accepted, rel=1e-12)
            else:
                quantile = float(row.value.partition('%')[0]) / 100
                assert values.quantile(quantile) == pytest.approx(row.accepted, rel=1e-12)


def row(setting, arm, **changes):
    """Return what is judged of an undisturbed drive that avoids at the limit and brakes."""
    good = {'completed': True, 'lost': False, 'limit_share': 1.0, 'brake_onset_planned_at_m': 40.0}
    gaps = {'min_v2o_m': 0.5, 'min_v2e_m': 0.5, 'v2o_1_m': -0.1 if arm == arms.NO_CA else 0.5}
    named = {'setting': setting, 'arm': arm, 'perturbation': 0, 'S': 0.5, 'error': ''}
    return named | good | gaps | changes


def test_settings_that_are_lost_or_gained_and_rows_that_differ_are_told(tmp_path):
    (tmp_path / accepted_drives.SETTINGS).write_text(
        'setting,frenet_matched,frenet_lineage\n3,True,True\n7,True,False\n'
    )
    driven = (arms.NO_CA, arms.MPCC, arms.MATCHED, arms.LINEAGE)
    rows = [row(number, arm) for number in (3, 7) for arm in driven]
    rows[-1] = row(7, arms.LINEAGE, lost=True)
    accepted_drives.write(rows, {}, tmp_path / accepted_drives.FILE)
    assert parquet.read_table(tmp_path / accepted_drives.FILE).num_rows == 8
    assert list(accepted_drives.compare(rows, tmp_path)) == [
        'frenet_matched: 2 settings at P3, now 2; gone: none; new: none',
        'frenet_lineage: 1 settings at P3, now 1; gone: none; new: none',
        '8 of 8 drives have equal rows',
    ]
    rows[2] = row(3, arms.MATCHED, limit_share=0.9)
    rows[-1] = row(7, arms.LINEAGE)
    assert list(accepted_drives.compare(rows, tmp_path)) == [
        'frenet_matched: 2 settings at P3, now 1; gone: 3; new: none',
        'frenet_lineage: 1 settings at P3, now 2; gone: none; new: 7',
        '6 of 8 drives have equal rows',
    ]


@pytest.mark.slow
def test_a_setting_is_driven_by_those_whose_claims_count(tmp_path):
    number = min(ACCEPTED[arms.MATCHED] & ACCEPTED[arms.LINEAGE])
    rows = accepted_drives.drive('confirmatory', [number], tmp_path, 1)
    own = {(row['arm'], row['perturbation']) for row in rows}
    undisturbed = {(arm, 0) for arm in (arms.NO_CA, arms.MPCC, arms.MATCHED, arms.LINEAGE)}
    assert undisturbed <= own
    assert not any(row['error'] or 'wall_s' in row for row in rows)
