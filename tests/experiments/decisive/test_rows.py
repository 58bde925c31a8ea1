"""Replicates become tables of the study; one that has ended is read, whatever code drove it."""

import json

import numpy as np
import pandas as pd
import pytest
import synthetic
import yaml
from test_study_command import PLAN, ROOT

from experiments import cli
from experiments.decisive import run as study
from node_runtime import provenance


@pytest.fixture
def driven(tmp_path):
    """Return the tables of three replicates in `tmp_path`, of another day, with a picture."""
    plan = yaml.safe_load((ROOT / PLAN).read_text())
    plan['stop'] = {'from': 3, 'widths': [1.0, 1.0], 'cap': 20}
    text = yaml.safe_dump(plan)
    (tmp_path / 'study.yaml').write_text(text)
    origin = {'plan': provenance.digest(text), 'sources': 'of another day'}
    (tmp_path / 'origin.json').write_text(json.dumps(origin))
    tuned = [
        {'replicate': number, 'arm': arm} | dict.fromkeys(plan['search']['ranges'], 2.0 * number)
        for number in (1, 2, 3)
        for arm in plan['tuned']
    ]
    tables = {
        'tuned': pd.DataFrame(tuned),
        'trials': synthetic.trials(replicates=3),
        'drives': synthetic.study(synthetic.judged(3, 30), synthetic.factorial({}, 3, 2)),
    }
    tables = {
        name: table.sort_values('replicate', kind='stable', ignore_index=True)
        for name, table in tables.items()
    }
    for name, table in tables.items():
        study.write(table, tmp_path, name)
    picture = tables['drives'].query('replicate == 1 and start == 0 and not S.isna()')
    study.write(picture.assign(avoided=False), tmp_path, 'picture')
    return tables


def test_tables_hold_every_row_once_however_often_a_replicate_is_added(driven, tmp_path):
    for name, table in driven.items():
        # killed between two tables, and driven again
        last = table.query('replicate == 3').reset_index(drop=True)
        study.add(last, tmp_path, name)
        pd.testing.assert_frame_equal(study.read(tmp_path, name), table)
        study.add(last.assign(replicate=4), tmp_path, name)
    assert study.kept_replicates(tmp_path) == {1, 2, 3, 4}
    assert len(study.read(tmp_path, 'tuned')) == 4 / 3 * len(driven['tuned'])


def test_numbers_that_hardly_repeat_take_less_than_in_a_file_of_pandas(tmp_path):
    numbers = np.random.default_rng(1).normal(15.0, 1.0, 20_000)
    frame = pd.DataFrame({'v': numbers, 'arm': 'mpcc', 'none': np.nan})
    study.write(frame, tmp_path, 'drives')
    frame.to_parquet(tmp_path / 'other.parquet', compression='zstd')
    sizes = [(tmp_path / f'{name}.parquet').stat().st_size for name in ('drives', 'other')]
    assert sizes[0] < 0.9 * sizes[1]
    pd.testing.assert_frame_equal(study.read(tmp_path, 'drives'), frame)


def test_a_study_that_its_rule_ends_is_decided_by_any_code(driven, tmp_path, capsys):
    run = ['study', 'run', str(tmp_path), '--jobs', '1']
    decide = ['study', 'decide', str(tmp_path)]
    assert cli.main(run) == 0
    assert study.kept_replicates(tmp_path) == {1, 2, 3}
    assert cli.main(decide) == 0
    assert 'over 3 replicates' in capsys.readouterr().out
    # the next ones would be driven by this code
    assert cli.main([*run, '--replicates', '4']) == 1
    assert 'origin.json: sources, ' in capsys.readouterr().err
    (tmp_path / 'picture.parquet').unlink()
    assert cli.main(decide) == 1
    assert 'writes it when the study has ended' in capsys.readouterr().err
