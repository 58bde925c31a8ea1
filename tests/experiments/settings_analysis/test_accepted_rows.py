"""Published claims are computed again from the kept rows, and a number that differs is named."""

import json
import shutil

import pandas as pd
import pytest
from synthetic_study import make_study

from bags.errors import BagError
from experiments import cli
from experiments.settings import outcomes, preregistration
from experiments.settings_analysis import accepted_rows, decide, decision_report, study_tables


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


def test_rows_of_another_preregistration_and_missing_ones_are_refused(folder, tmp_path):
    study = accepted_rows.read(folder / 'confirmatory' / accepted_rows.FILE)
    path = accepted_rows.write(
        study._replace(notes=study.notes | {'preregistration': 'x'}), tmp_path
    )
    with pytest.raises(BagError, match='made with another preregistration'):
        accepted_rows.read(path)
    with pytest.raises(BagError, match=r'accepted_drives\.parquet: is no table of a study'):
        list(accepted_rows.recompute(tmp_path / 'nothing'))
