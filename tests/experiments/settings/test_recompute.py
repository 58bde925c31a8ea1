"""Shares from rows whose answer is known, and the command that shows them."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from pyarrow import parquet

from experiments import cli
from experiments.settings import plan as plans
from experiments.settings import recompute
from experiments.settings.primaries import CLAIMS
from experiments.settings.recompute import Study

PUBLISHED = Path(__file__).parents[3] / 'paper/settings'
STARTS = 5
UNKNOWN = np.nan


@pytest.fixture(scope='module')
def plan():
    """Return what was fixed before the published rows were driven."""
    return plans.rules((PUBLISHED / 'settings_study.yaml').read_text())


@pytest.fixture
def share_of(plan):
    """Return share_of(holds, knows=...) -> Share of `sideslip`; rows are settings, columns starts.

    A start with `knows` 0 is not at P2.
    """

    def share_of(holds, knows=None):
        holds = np.array(holds, dtype=float)
        knows = np.ones_like(holds) if knows is None else np.array(knows)
        rows = []
        for setting, start in np.ndindex(holds.shape):
            claims = {
                f'{claim}.{name}': holds[setting, start]
                for claim in CLAIMS
                for name in ('holds', 'difference')
            }
            met = dict.fromkeys(plans.LEVELS, True) | {'start.P2': bool(knows[setting, start])}
            rows += [
                {'setting': setting, 'baseline': baseline, 'perturbation': start} | met | claims
                for baseline in ('frenet_matched', 'frenet_lineage')
            ]
        study = Study(plan, pd.DataFrame(), pd.DataFrame(rows))
        shares = {(share.baseline, share.claim): share for share in recompute.shares(study)}
        return shares['frenet_matched', 'sideslip']

    return share_of


def test_a_setting_holds_when_most_of_its_starts_do(share_of):
    share = share_of([[1] * 5, [1, 1, 1, 0, 0], [1, 1, 0, 0, 0], [0] * 5])
    assert (share.holds, share.settings) == (2, 4)
    assert (share.undetermined, share.silent) == (2, 0)
    assert share.low_if_none < share.low < share.low_if_all


def test_a_start_outside_the_preconditions_does_not_tell(share_of):
    share = share_of([[1] * 5, [1] * 5], [[1] * 5, [1, 1, 0, 1, 1]])
    assert (share.holds, share.undetermined, share.silent) == (2, 1, 1)


def test_a_setting_none_of_whose_starts_tells_is_left_out(share_of):
    share = share_of([[1] * 5, [UNKNOWN] * 5, [1] * 5], [[1] * 5, [1] * 5, [0] * 5])
    assert (share.holds, share.settings) == (1, 1)


@pytest.mark.parametrize(
    ('holding', 'settings', 'verdict'),
    [(60, 80, 'reproduced'), (0, 100, 'not reproduced'), (20, 100, 'in part'), (40, 80, 'open')],
)
def test_a_verdict_follows_from_the_interval(share_of, holding, settings, verdict):
    holds = np.zeros((settings, STARTS))
    holds[:holding] = 1.0
    assert share_of(holds).verdict == verdict


def test_what_is_undetermined_leaves_a_verdict_open(share_of):
    holds, knows = np.zeros((100, STARTS)), np.ones((100, STARTS))
    knows[:10, 3] = 0
    assert share_of(holds, knows).verdict == 'open'


def test_the_median_of_the_differences_has_an_interval_around_it(share_of):
    share = share_of(np.linspace(0.0, 1.0, 41)[:, None] * np.ones(STARTS))
    assert share.median == pytest.approx(0.5)
    assert share.median_low < 0.5 < share.median_high


def test_the_conditions_from_P1_to_the_level_count():
    outcomes = pd.DataFrame({'baseline': ['frenet_matched'] * 3, 'setting': [1, 2, 3]})
    outcomes = outcomes.assign(P0=False, P1=[True, True, False], P2=True, P3=[True, False, True])
    study = Study(SimpleNamespace(), pd.DataFrame(), outcomes)
    assert recompute.reaching(study, 'frenet_matched', 'P3')['setting'].tolist() == [1]
    assert recompute.reaching(study, 'frenet_matched', 'P2')['setting'].tolist() == [1, 2]


def test_the_kept_rows_carry_the_preregistration():
    kept = parquet.read_schema(PUBLISHED / recompute.FILE).metadata[b'preregistration']
    assert kept.decode() == (PUBLISHED / 'settings_study.yaml').read_text()


def test_the_kept_rows_are_those_of_the_accepted_settings():
    study = recompute.read(PUBLISHED)
    accepted = pd.read_csv(PUBLISHED / 'confirmatory/accepted_settings.csv', index_col='setting')
    assert set(study.drives['setting']) == set(accepted.index)
    for baseline, at_P3 in accepted.items():
        reached = recompute.reaching(study, baseline, 'P3')['setting']
        assert set(reached) == set(accepted.index[at_P3])


def test_the_command_shows_shares_and_who_brakes(capsys):
    assert cli.main(['study', 'recompute', str(PUBLISHED)]) == 0
    shown = [line.split() for line in capsys.readouterr().out.splitlines()]
    assert ['frenet_matched', 'min_speed', '83', '222'] in [line[:4] for line in shown]
    assert ['frenet_lineage', '136', '14', '6', '2', '41', '12'] in shown


@pytest.mark.parametrize('content', [None, b'no table'], ids=['missing', 'damaged'])
def test_a_folder_without_rows_is_one_line(tmp_path, capsys, content):
    file = tmp_path / recompute.FILE
    if content is not None:
        file.parent.mkdir()
        file.write_bytes(content)
    assert cli.main(['study', 'recompute', str(tmp_path)]) == 1
    assert f'{file}: holds no rows of the study' in capsys.readouterr().err


def test_rows_without_their_preregistration_are_refused(tmp_path, capsys):
    file = tmp_path / recompute.FILE
    file.parent.mkdir()
    pd.DataFrame({'setting': [1]}).to_parquet(file)
    assert cli.main(['study', 'recompute', str(tmp_path)]) == 1
    assert 'holds no rows of the study' in capsys.readouterr().err
