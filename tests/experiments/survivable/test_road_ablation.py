"""Each file of the ablation is mpcc_road without one part."""

from pathlib import Path

from experiments import simulation
from node_runtime import parameters

FILES = sorted(Path(__file__).parents[3].glob('experiments/config/road_ablation/*.yaml'))


def values(controller):
    return parameters.flatten(simulation.prepare('straight', str(controller)).params)


def test_a_file_leaves_something_out_that_mpcc_road_adds_to_mpcc():
    assert FILES
    road, paper = values('mpcc_road'), values('mpcc')
    for file in FILES:
        without = values(file)
        changed = {name for name in road if road[name] != without[name]}
        assert changed, file
        for name in changed:
            # as in the paper's controller, or switched off
            assert without[name] == paper[name] or without[name] in (1, False), (file, name)
