"""Weights of a controller are searched with real drives, and written as a controller file."""

import re
from pathlib import Path

import pandas as pd
import pytest
import yaml

from experiments import cli, tuning
from msgs_yaml import share
from node_runtime import parameters

CONFIG = share.path('mpcc_controller', 'config')
BASE = CONFIG / 'mpcc.yaml'
PLAN = Path(__file__).parents[2] / 'paper/study/study.yaml'


@pytest.mark.usefixtures('tasks_here')
def test_a_controller_is_tuned_its_other_parameters_stay_and_nothing_is_driven_again(
    tmp_path, capsys
):
    plan = yaml.safe_load(PLAN.read_text()) | {'judged_tasks': 2}
    plan['search'] |= {
        'first': {'points': 2, 'tasks': 1},
        'rounds': {'count': 1, 'points': 2, 'tasks': 1},
    }
    (tmp_path / 'study.yaml').write_text(yaml.safe_dump(plan))
    arguments = ['tune', 'frenet', '--plan', str(tmp_path), '--out', str(tmp_path), '--jobs', '1']
    assert cli.main(arguments) == 0
    shown = capsys.readouterr().out
    assert 'fresh tasks avoided' in shown
    folder = tmp_path / 'frenet'
    trials = pd.read_csv(folder / tuning.HISTORY)
    assert (~trials['is_recommended']).sum() == 2 + 2
    names = set(plan['search']['ranges']) - {'tolerances.lag_m'}
    weights = trials.iloc[-1][[name for name in trials if name in names]].to_dict()
    assert set(weights) == names
    tuned = parameters.read_file(folder / 'frenet_tuned.yaml', CONFIG).values
    assert tuned == parameters.read_file(CONFIG / 'frenet.yaml', CONFIG).values | weights

    size = (folder / 'drives.jsonl').stat().st_size
    assert cli.main(arguments) == 0
    assert (folder / 'drives.jsonl').stat().st_size == size
    assert shown.splitlines()[-11:] == capsys.readouterr().out.splitlines()[-11:]


@pytest.mark.parametrize('value', [1e-07, 1.0, 123456.0, 2.5e22, 0.349])
def test_a_tuned_file_holds_the_tuned_weights_over_its_base(value, tmp_path):
    changed = {'tolerances.lag_m': value, 'priorities.obstacle': 54321.0}
    text = tuning.controller_text(BASE, changed, ['From a test.', 'word ' * 60])
    path = tmp_path / 'tuned.yaml'
    path.write_text(text)
    known = parameters.read_file(BASE, CONFIG).values
    assert parameters.read_file(path, CONFIG).values == known | changed
    header = [line for line in text.splitlines() if line.startswith('#')]
    assert (header[0], len(header)) == ('# From a test.', 5)
    assert all(len(line) <= tuning.WIDTH for line in header)
    with pytest.raises(KeyError, match=r'tolerances\.lug_m'):
        tuning.controller_text(BASE, {'tolerances.lug_m': value}, [])


def test_a_base_outside_of_the_config_folder_is_named_by_its_path(tmp_path):
    own, tuned = tmp_path / 'mine.yaml', tmp_path / 'sub/tuned.yaml'
    own.write_text(re.sub(r'lag_m: \S+', 'lag_m: 0.6', BASE.read_text()))
    tuned.parent.mkdir()
    tuned.write_text(tuning.controller_text(own, {'priorities.edge': 2.0}, []))
    values = parameters.read_file(tuned, CONFIG).values
    assert (values['tolerances.lag_m'], values['priorities.edge']) == (0.6, 2.0)
