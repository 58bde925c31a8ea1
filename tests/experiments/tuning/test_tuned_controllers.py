"""The tuned controllers in config/ are those that the tracked searches found."""

import json
from pathlib import Path

import pytest

from experiments.configuration import node_config
from mpcc_controller.problem import formulation
from node_runtime import parameters

SEARCHES = Path(__file__).parents[3] / 'paper/tuning'


def numbers(name):
    return parameters.read_file(node_config.find_controller(name).config).values


def found(name):
    return json.loads((SEARCHES / name / 'tuning.json').read_text())


@pytest.mark.parametrize('name', ['mpcc', 'frenet'])
def test_a_tuned_controller_differs_in_the_weights_that_were_found_only(name):
    search = found(name)
    weights = search['best']['weights']
    assert set(weights) == set(formulation.find(name).tuned_weights)
    assert numbers(f'{name}_tuned') == numbers(name) | weights
    assert search['best']['safe']
    assert search['best']['cost'] < search['untuned']['cost']


def test_without_collision_avoidance_the_tuned_mpcc_has_no_priorities():
    zero = {'priorities.obstacle': 0.0, 'priorities.edge': 0.0}
    assert numbers('mpcc_no_ca_tuned') == numbers('mpcc_tuned') | zero


def test_both_controllers_were_tuned_alike():
    mpcc, frenet = found('mpcc')['plan'], found('frenet')['plan']
    assert mpcc | {'controller': None} == frenet | {'controller': None}
