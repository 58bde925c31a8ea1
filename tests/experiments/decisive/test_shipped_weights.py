"""The weights of the paper's controllers are those that the study has found."""

from pathlib import Path

import pandas as pd
import pytest
import yaml

from experiments.decisive import report
from msgs_yaml import share
from node_runtime import parameters

CONFIG = share.path('mpcc_controller', 'config')
STUDY = Path(__file__).parents[3] / 'paper/study'


def shipped(name):
    return parameters.read_file(CONFIG / f'{name}.yaml', CONFIG).values


@pytest.mark.parametrize('arm', ['mpcc', 'frenet'])
def test_a_controller_has_the_weights_of_the_typical_replicate_of_its_arm(arm):
    plan = yaml.safe_load((STUDY / 'study.yaml').read_text())
    tables = map(pd.read_parquet, STUDY.rglob('tuned.parquet'))  # of replicates, or of all
    typical = report.typical(plan, pd.concat(tables).drop_duplicates(), arm)
    assert len(typical) == 7
    assert {name: shipped(arm)[name] for name in typical.index} == typical.to_dict()


def test_the_controllers_of_the_paper_differ_only_where_they_shall():
    mpcc, baseline = shipped('mpcc'), shipped('frenet')
    assert shipped('mpcc_no_ca') == mpcc | {'priorities.obstacle': 0.0, 'priorities.edge': 0.0}
    changed = {name.partition('.')[0] for name in mpcc if baseline[name] != mpcc[name]}
    assert changed == {'formulation', 'tolerances', 'priorities'}
