"""Each file of the ablation is mpcc_road without one part."""

from pathlib import Path

import pytest

from experiments import simulation
from node_runtime import parameters

FILES = sorted(Path(__file__).parents[3].glob('experiments/config/road_ablation/*.yaml'))


def values(controller):
    return parameters.flatten(simulation.prepare('straight', str(controller)).params)


@pytest.mark.parametrize('file', FILES, ids=lambda file: file.stem)
def test_a_file_leaves_something_out_that_mpcc_road_adds_to_mpcc(file):
    road, without, paper = values('mpcc_road'), values(file), values('mpcc')
    changed = {name for name in road if road[name] != without[name]}
    assert changed
    for name in changed:
        # as in the paper's controller, or switched off
        assert without[name] == paper[name] or without[name] in (1, False), name


def test_there_are_files():
    assert FILES
