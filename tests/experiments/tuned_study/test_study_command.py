"""A small study from its plan to its figures, through the command; tables of its replicates."""

import json
from pathlib import Path

import pandas as pd
import pytest
import synthetic
import yaml
from PIL import Image

from experiments import cli
from experiments.tuned_study import analysis
from experiments.tuned_study import run as study
from node_runtime import provenance

ROOT = Path(__file__).parents[3]
PLAN = 'paper/study/study.yaml'


@pytest.fixture(scope='module')
def plan():
    """Return the plan with so few drives that a test may wait for them."""
    values = yaml.safe_load((ROOT / PLAN).read_text())
    values |= {'judged_tasks': 2, 'factorial_tasks': 0, 'derived': {}}
    values['tuned'] = {name: values['tuned'][name] for name in ('mpcc', 'frenet')}
    values['starts'] |= {'tasks': 1, 'count': 1}
    values['search'] |= {
        'first': {'points': 2, 'tasks': 1},
        'rounds': {'count': 1, 'points': 2, 'tasks': 1},
    }
    values['picture'] |= {'drives': 2, 'batch': 2, 'nearest': 1}
    return values


@pytest.mark.usefixtures('tasks_here')
def test_a_study_is_driven_goes_on_and_is_decided(plan, tmp_path, capsys):
    plans, out = tmp_path / 'plans', tmp_path / 'out'
    plans.mkdir()
    (plans / 'study.yaml').write_text(yaml.safe_dump(plan))
    run = ['study', 'run', str(plans), '--out', str(out), '--jobs', '1', '--replicates']
    assert cli.main([*run, '1']) == 0
    first = pd.read_parquet(out / 'drives.parquet')
    assert cli.main([*run, '2']) == 0
    drives = pd.read_parquet(out / 'drives.parquet')
    searched = drives[~drives['judged']].groupby(['replicate', 'arm']).size()
    assert set(searched) == {2 + 2}
    judged = drives[drives['judged'] & drives['start'].eq(0)]
    # both arms had the same tasks, which are those of no search
    tasks = judged.groupby(['replicate', 'arm'])['S'].apply(tuple).unstack('arm')
    assert (tasks['mpcc'] == tasks['frenet']).all()
    assert tasks['mpcc'].nunique() == 2
    assert (drives['error'] == '').all()
    pd.testing.assert_frame_equal(drives[drives['replicate'].eq(1)], first)
    assert not [*out.glob('replicate_*')]

    capsys.readouterr()
    assert cli.main(['study', 'decide', str(out)]) == 0
    shown = capsys.readouterr().out
    assert 'avoidance gap: ' in shown
    assert (out / 'figures' / 'avoidance_gap.png').stat().st_size > 10_000

    # rows of another plan are not mixed with these
    (plans / 'study.yaml').write_text(yaml.safe_dump(plan | {'judged_tasks': 3}))
    assert cli.main([*run, '2']) == 1
    assert 'origin.json: plan: differs from that of the rows' in capsys.readouterr().err


def test_an_exchange_of_equal_weights_leaves_the_plan_and_a_heading_cost_shifts_it(
    plan, tmp_path, capsys
):
    plan = {**plan, 'factors': {'heading': plan['factors']['heading']}}
    (tmp_path / 'study.yaml').write_text(yaml.safe_dump(plan))
    ranges = plan['search']['ranges']
    middle = {name: (low * high) ** 0.5 for name, (low, high) in ranges.items()}
    arms = ('mpcc', 'frenet')
    tuned = pd.DataFrame({'replicate': 1, 'arm': arm, **middle} for arm in arms)
    tuned.to_parquet(tmp_path / 'tuned.parquet')
    drives = pd.DataFrame(
        {
            'replicate': 1,
            'judged': True,
            'start': 0,
            'arm': arms * 2,
            'task': [0, 0, 1, 1],
            'avoided': [True, True, False, True],
        }
    )
    drives.to_parquet(tmp_path / 'drives.parquet')
    assert cli.main(['study', 'explain', str(tmp_path)]) == 0
    shown = capsys.readouterr().out
    assert 'replicate 1, task 1: frenet alone avoids' in shown
    lines = (line.rpartition(' ') for line in shown.splitlines())
    shift = {name.strip(): float(size) for name, _, size in lines if name.startswith('  ')}
    assert shift['weights'] < 1e-6
    assert shift['heading'] > 1e-3
    assert (tmp_path / 'figures' / 'exchange.png').stat().st_size > 10_000


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
    limits = {**synthetic.S50, **synthetic.OTHERS}
    drives = synthetic.judged(3, 30, limits, starts=1)
    tables = {
        'tuned': pd.DataFrame(tuned),
        'trials': synthetic.trials(replicates=3),
        'drives': synthetic.study(drives, synthetic.factorial({(0,): 0.2}, 3, 2)),
    }
    tables = {
        name: table.sort_values('replicate', kind='stable', ignore_index=True)
        for name, table in tables.items()
    }
    for name, table in tables.items():
        study.write(table, tmp_path, name)
    picture = tables['drives'].query('replicate == 1 and start == 0 and arm in @synthetic.S50')
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


def test_a_study_that_its_rule_ends_is_decided_and_drawn_by_any_code(driven, tmp_path, capsys):
    run = ['study', 'run', str(tmp_path), '--jobs', '1']
    decide = ['study', 'decide', str(tmp_path)]
    assert cli.main(run) == 0
    assert study.kept_replicates(tmp_path) == {1, 2, 3}
    assert cli.main(decide) == 0
    shown = capsys.readouterr().out
    assert 'over 3 replicates' in shown
    assert all(f'\n{name}\n' in shown for name in analysis.Results._fields[2:])
    widths = [Image.open(path).width for path in (tmp_path / 'figures').glob('*.png')]
    assert widths == 7 * [900]
    # the next ones would be driven by this code
    assert cli.main([*run, '--replicates', '4']) == 1
    assert 'origin.json: sources, ' in capsys.readouterr().err
    (tmp_path / 'picture.parquet').unlink()
    assert cli.main(decide) == 1
    assert 'writes it when the study has ended' in capsys.readouterr().err
