"""The pages about the study have what the tracked tables say; who avoids and who brakes."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from synthetic_study import make_study

from bags.errors import BagError
from experiments import page_block
from experiments.settings import arms
from experiments.settings_analysis import (
    dimension_shares,
    early_braking,
    outcome_report,
    published,
    who_avoids,
)

ROOT = Path(__file__).parents[3]
PAGES = ('docs/who_avoids.md', 'docs/early_braking.md')
SETTINGS, CRASHED = 60, range(0, 60, 6)


@pytest.mark.parametrize('name', PAGES)
def test_a_page_says_what_the_tracked_tables_say(name):
    blocks = published.build(ROOT / 'paper/settings', ROOT / name)
    assert blocks
    for block, text in blocks.items():
        _, between, _ = page_block.split(ROOT / name, block)
        assert between == f'\n{text}', 'regenerate it: `make paper`, or `make result`'


def test_the_block_of_a_page_is_replaced_alone_and_a_page_without_one_is_refused(tmp_path):
    page = tmp_path / 'page.md'
    page.write_text('a\n<!-- who avoids -->\nold\n<!-- /who avoids -->\nz\n')
    assert published.write(ROOT / 'paper/settings', [page]) == [page]
    written = page.read_text()
    assert written.startswith('a\n<!-- who avoids -->\nOf 3,000 settings drawn')
    assert written.endswith('\n<!-- /who avoids -->\nz\n')
    assert 'old' not in written
    page.write_text('nothing\n')
    with pytest.raises(BagError, match='has no block about the study; allowed <!-- who avoids -->'):
        published.write(ROOT / 'paper/settings', [page])


@pytest.fixture(scope='module')
def study():
    """A study in which the MPCC crashes in every sixth setting, and only the lineage avoids all."""
    made = make_study(SETTINGS, factorial=0)
    crashed = (made.drives['arm'] == arms.MPCC) & made.drives['setting'].isin(CRASHED)
    made.drives.loc[crashed, 'completed'] = False
    made.drives['min_v2o_m'] = made.drives['min_v2o_m'].clip(lower=0.1)
    made.drives['min_v2e_m'] = made.drives['min_v2e_m'].clip(lower=0.1)
    return made


def test_who_avoids_is_counted_by_controller_latency_and_dimension(study):
    found = who_avoids.summarise(study)
    assert found['settings'] == SETTINGS
    assert found['all'][arms.MPCC]['holds'] == SETTINGS - len(CRASHED)
    assert found['all'][arms.LINEAGE]['holds'] == SETTINGS
    rows = [row for row in found['by_latency_and_S'] if row['arm'] == arms.MPCC]
    assert sum(row['all']['of'] for row in rows) == SETTINGS
    for row in rows:
        assert sum(cell['holds'] for cell in row['strata']) == row['all']['holds']
    pair = found['paired'][0]
    assert (pair['mpcc_alone'], pair['baseline_alone']) == (0, len(CRASHED))
    assert pair['p_value'] == pytest.approx(2.0 * 0.5 ** len(CRASHED))


def test_onsets_are_compared_where_both_brake_and_the_rest_is_who_brakes_alone(study):
    table = early_braking.compare(study, arms.MATCHED, 'P1')
    tight = study.drives.drop_duplicates('setting').set_index('setting')['velocity_tolerance_mps']
    earlier = tight.loc[table.index] < 6.0
    assert 0 < earlier.sum() < len(earlier)
    assert (table.loc[earlier, 'who'] == 'MPCC earlier').all()
    assert (table.loc[~earlier, 'who'] == 'equal').all()
    assert table.loc[earlier, 'earlier_m'].to_numpy() == pytest.approx(20.0)


def test_a_car_that_does_not_brake_is_no_onset_but_counts(study):
    silent = study._replace(drives=study.drives.copy(), outcomes=study.outcomes.copy())
    mpcc = silent.drives['arm'] == arms.MPCC
    silent.drives.loc[mpcc, early_braking.ONSET] = np.nan
    silent.outcomes['brake_onset.difference'] = np.nan
    table = early_braking.compare(silent, arms.MATCHED, 'P1')
    assert (table['who'] == 'baseline alone').all()


def test_shares_are_of_quarters_or_of_choices_and_the_largest_range_comes_first():
    drawn = pd.DataFrame({'x': np.arange(80.0), 'kind': ['a', 'b.yaml'] * 40})
    happens = {'it': drawn['x'] >= 60.0, 'never': drawn['x'] < 0.0}
    first, second = dimension_shares.by_dimension(drawn, happens)
    assert first['dimension'] == 'x'
    assert [(one['holds'], one['of']) for one in first['it']] == [(0, 20)] * 3 + [(20, 20)]
    assert second['groups'] == ['a', 'b']
    assert [one['holds'] for one in second['it']] == [10, 10]
    assert all(one['holds'] == 0 and one['high'] > 0.0 for one in first['never'])


def test_the_text_about_braking_has_a_row_per_run_and_baseline(study, tmp_path):
    folder = tmp_path / outcome_report.LEVELS_RUN
    folder.mkdir()
    content = early_braking.summarise(study)
    outcome_report.write_json(folder / 'braking.json', content)
    text = outcome_report.braking_text(tmp_path, '.')
    assert text.count('| levels | `frenet_matched` |') == 2
    assert 'MPCC earlier by 10 m' in text
