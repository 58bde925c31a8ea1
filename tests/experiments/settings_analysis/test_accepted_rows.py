"""Published claims are computed again from the kept rows, and a number that differs is named."""

import json
import shutil
from pathlib import Path

import pandas as pd
import pytest
from synthetic_study import make_study

from bags.errors import BagError
from experiments import cli
from experiments.settings import outcomes, preregistration
from experiments.settings_analysis import (
    accepted_rows,
    decide,
    decision_report,
    early_braking,
    study_tables,
)

PUBLISHED = Path(__file__).parents[3] / 'paper/settings'


@pytest.fixture(scope='module')
def folder(tmp_path_factory):
    """Two runs that are decided over all rows, with the rows of their accepted settings alone."""
    out = tmp_path_factory.mktemp('settings')
    notes = {'preregistration': preregistration.load().text}
    runs = {}
    for seed, name in enumerate(preregistration.RUNS[:2], start=1):
        study = make_study(40, seed=seed)
        study = study._replace(notes=study.notes | notes | {'seed': str(seed)})
        # not accepted: the MPCC is lost
        lost = (study.drives['arm'] == 'mpcc') & (study.drives['setting'] < 4)
        study.drives.loc[lost, 'completed'] = False
        judged = pd.DataFrame(outcomes.build(study.plan, study.drives.to_dict('records')))
        runs[name] = study._replace(outcomes=judged)
    both = study_tables.pool(list(runs.values()))
    for name, study in (*runs.items(), (study_tables.POOLED, both)):
        results = decide.decide(study, explained=())
        decision_report.write_claims(study, results, out / name)
    for name, study in runs.items():
        accepted_rows.write(study, out / name)
    return out


def test_every_claim_comes_out_as_published_from_fewer_rows(folder, capsys):
    kept = accepted_rows.read(folder / 'confirmatory' / accepted_rows.FILE)
    assert set(kept.drives['setting']) == set(range(4, 40))
    assert not kept.drives['arm'].str.startswith('factorial').any()
    assert cli.main(['study', 'recompute', str(folder)]) == 0
    said = capsys.readouterr().out
    assert said.count('| equal |') == 3 * 2 * 5  # runs, versions of the baseline, claims
    assert 'differs' not in said


def test_a_number_that_is_published_otherwise_is_named(folder, capsys):
    path = folder / 'repetition/claims.json'
    before = path.read_text()
    content = json.loads(before)
    content['claims'][1]['holds'] += 1
    path.write_text(json.dumps(content))
    assert cli.main(['study', 'recompute', str(folder)]) == 1
    path.write_text(before)
    said = [line for line in capsys.readouterr().out.splitlines() if 'differs' in line]
    assert len(said) == 1
    assert said[0].startswith('| repetition | frenet_matched | ')
    assert said[0].endswith('| differs: holds |')


def test_a_run_without_rows_is_named_and_the_others_are_decided(folder, tmp_path, capsys):
    shutil.copytree(folder / 'confirmatory', tmp_path / 'confirmatory')
    assert cli.main(['study', 'recompute', str(tmp_path)]) == 0
    said = capsys.readouterr().out
    assert said.count('| equal |') == 2 * 5
    assert 'no rows are kept of: repetition' in said


def test_the_published_rows_give_the_published_numbers(capsys):
    """What pages say of these is compared with claims.json and braking.json in tests/docs."""
    assert cli.main(['study', 'recompute', str(PUBLISHED)]) == 0
    said = capsys.readouterr().out
    assert said.count('| equal |') == 2 * 5  # versions of the baseline, claims
    for shown in ('unsafe_area | 1 of 222', 'sideslip | 1 of 222', 'min_speed | 83 of 222'):
        assert f'| confirmatory | frenet_matched | {shown} |' in said
    assert '| confirmatory | frenet_matched | conjunction | 0 of 69 |' in said


def test_the_published_rows_say_who_brakes_as_published():
    study = accepted_rows.read(PUBLISHED / 'confirmatory' / accepted_rows.FILE)
    published = json.loads((PUBLISHED / 'confirmatory/braking.json').read_text())
    pairs = early_braking.summarise(study)['pairs']
    for pair, other in zip(pairs, published['pairs'], strict=True):
        counts = ('baseline', 'level', 'settings', 'both', 'earlier', 'later')
        assert [pair[name] for name in counts] == [other[name] for name in counts]
        assert pair['lead_m'] == pytest.approx(other['lead_m'], rel=1e-9)


def test_rows_of_another_preregistration_and_missing_ones_are_refused(folder, tmp_path):
    study = accepted_rows.read(folder / 'confirmatory' / accepted_rows.FILE)
    path = accepted_rows.write(
        study._replace(notes=study.notes | {'preregistration': 'x'}), tmp_path
    )
    with pytest.raises(BagError, match='made with another preregistration'):
        accepted_rows.read(path)
    with pytest.raises(BagError, match=r'accepted_drives\.parquet: is no table of a study'):
        list(accepted_rows.recompute(tmp_path / 'nothing'))
