"""Replicates become tables of the study; one that has ended is read, whatever code drove it."""

import json
import shutil

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
    """Return the tables of four replicates, whose folders are in `tmp_path`, and a picture."""
    plan = yaml.safe_load((ROOT / PLAN).read_text())
    plan['stop'] = {'from': 3, 'widths': [1.0, 1.0], 'cap': 20}
    text = yaml.safe_dump(plan)
    (tmp_path / 'study.yaml').write_text(text)
    origin = {'plan': provenance.digest(text), 'sources': 'of another day'}
    (tmp_path / 'origin.json').write_text(json.dumps(origin))
    tuned = [
        {'replicate': number, 'arm': arm} | dict.fromkeys(plan['search']['ranges'], 2.0 * number)
        for number in (1, 2, 3, 4)
        for arm in plan['tuned']
    ]
    tables = {
        'tuned': pd.DataFrame(tuned),
        'trials': synthetic.trials(replicates=4),
        'drives': synthetic.study(synthetic.judged(4, 30), synthetic.factorial({}, 4, 2)),
    }
    tables = {
        name: table.sort_values('replicate', kind='stable', ignore_index=True)
        for name, table in tables.items()
    }
    for name, table in tables.items():
        for number, own in table.groupby('replicate'):
            folder = study.part_of(tmp_path, number)
            folder.mkdir(exist_ok=True)
            study.write(own, folder, name)
    picture = tables['drives'].query('replicate == 1 and start == 0 and not S.isna()')
    study.write(picture.assign(avoided=False), tmp_path, 'picture')
    return tables


def test_tables_hold_every_row_once_however_often_packing_is_interrupted(driven, tmp_path):
    shutil.copytree(study.part_of(tmp_path, 1), tmp_path / 'again')
    study.pack(tmp_path, 1)
    # killed before the folder was gone, and between two tables of the next call
    (tmp_path / 'again').rename(study.part_of(tmp_path, 1))
    study.write(driven['tuned'], tmp_path, 'tuned')
    study.pack(tmp_path, 4)
    assert not [*tmp_path.glob('replicate_*')]
    for name, table in driven.items():
        pd.testing.assert_frame_equal(study.read(tmp_path, name), table)
    before = (tmp_path / 'drives.parquet').stat().st_mtime_ns
    study.pack(tmp_path, 4)
    assert (tmp_path / 'drives.parquet').stat().st_mtime_ns == before


def test_numbers_that_hardly_repeat_take_less_than_in_a_file_of_pandas(tmp_path):
    numbers = np.random.default_rng(1).normal(15.0, 1.0, 20_000)
    frame = pd.DataFrame({'v': numbers, 'arm': 'mpcc', 'none': np.nan})
    study.write(frame, tmp_path, 'drives')
    frame.to_parquet(tmp_path / 'other.parquet', compression='zstd')
    sizes = [(tmp_path / f'{name}.parquet').stat().st_size for name in ('drives', 'other')]
    assert sizes[0] < 0.9 * sizes[1]
    pd.testing.assert_frame_equal(study.read(tmp_path, 'drives'), frame)


def test_a_study_that_its_rule_ends_is_packed_and_decided_by_any_code(driven, tmp_path, capsys):
    """The fourth replicate was driven ahead: it is kept, and decides nothing."""
    run = ['study', 'run', str(tmp_path), '--jobs', '1']
    decide = ['study', 'decide', str(tmp_path)]
    assert cli.main(decide) == 1
    assert 'writes it when the study has ended' in capsys.readouterr().err
    assert cli.main(run) == 0
    assert study.packed(tmp_path, 'drives') == {1, 2, 3}
    assert [path.name for path in tmp_path.glob('replicate_*')] == ['replicate_04']
    assert cli.main(decide) == 0
    assert 'over 3 replicates' in capsys.readouterr().out
    # the next ones would be driven by this code
    assert cli.main([*run, '--replicates', '4']) == 0
    assert study.packed(tmp_path, 'drives') == {1, 2, 3, 4}
    assert cli.main([*run, '--replicates', '5']) == 1
    assert 'origin.json: sources, ' in capsys.readouterr().err
