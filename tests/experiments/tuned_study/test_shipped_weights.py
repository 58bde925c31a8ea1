"""The weights of the paper's controllers are those of the study; its arms keep theirs."""

from pathlib import Path

import pandas as pd
import pytest
import yaml

from experiments import drive_row
from experiments.tuned_study import arms, report
from msgs_yaml import share
from node_runtime import parameters

CONFIG = share.path('mpcc_controller', 'config')
STUDY = Path(__file__).parents[3] / 'paper/study'
PLAN = yaml.safe_load((STUDY / 'study.yaml').read_text())


def shipped(name):
    return parameters.read_file(CONFIG / f'{name}.yaml', CONFIG).values


@pytest.mark.parametrize('arm', ['mpcc', 'frenet'])
def test_a_controller_has_the_weights_of_the_typical_replicate_of_its_arm(arm):
    tables = map(pd.read_parquet, STUDY.rglob('tuned.parquet'))  # of replicates, or of all
    typical = report.typical(PLAN, pd.concat(tables).drop_duplicates(), arm)
    assert len(typical) == 7
    assert {name: shipped(arm)[name] for name in typical.index} == typical.to_dict()


def test_the_controllers_of_the_paper_differ_only_where_they_shall():
    mpcc, baseline = shipped('mpcc'), shipped('frenet')
    assert shipped('mpcc_no_ca') == mpcc | {'priorities.obstacle': 0.0, 'priorities.edge': 0.0}
    changed = {name.partition('.')[0] for name in mpcc if baseline[name] != mpcc[name]}
    assert changed == {'formulation', 'tolerances', 'priorities'}


@pytest.mark.parametrize(('arm', 'task'), [('mpcc_shipped', 0), ('frenet_shipped', 1)])
def test_an_arm_with_weights_set_by_hand_drives_as_in_the_study_whatever_ships(arm, task):
    kept = pd.read_parquet(STUDY / 'drives.parquet')
    kept = kept[(kept.replicate == 1) & kept.judged & (kept.arm == arm) & (kept.start == 0)]
    row = arms.row(PLAN, arm, arms.settings(PLAN, arm, {}), PLAN['seeds']['judged'] + 1, task)
    values = arms.measure(drive_row.prepare(row, any_car=True))
    then = kept[kept.task == task].iloc[0]
    assert values['avoided'] == then.avoided
    # of another processor, whose solver rounds differently
    assert values['peak_sideslip_deg'] == pytest.approx(then.peak_sideslip_deg, rel=0.02)
