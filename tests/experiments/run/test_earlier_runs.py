"""Which earlier runs a new one is compared with, and what is said of them."""

import os
from pathlib import Path

import pytest

from bags.errors import BagError
from bags.storage import read
from experiments.configuration import inputs
from experiments.run import run_and_compare
from experiments.run.node_graph import RunOutcome
from scenario_publisher import scenario

GOLDEN = Path(__file__).parents[3] / 'bags/reference/double_lane_change'


@pytest.fixture
def recorded():
    """The scenario as the golden recordings have it."""
    return scenario.parse(read.run_info(GOLDEN / 'mpcc')['scenario_text'], 'golden')


def test_a_run_is_found_by_its_name_or_path_if_it_drove_the_scenario(recorded, monkeypatch):
    assert run_and_compare.find_earlier(['frenet'], GOLDEN, recorded) == [GOLDEN / 'frenet']
    other = recorded._replace(text=recorded.text + '\n')
    for name, scn, message in (
        ('mpc', recorded, r'there are frenet, mpcc, mpcc_no_ca; did you mean .mpcc.'),
        ('mpcc', inputs.load_scenario('straight'), 'another scenario, double_lane_change'),
        ('mpcc', other, 'another version of double_lane_change'),
    ):
        with pytest.raises(BagError, match=message):
            run_and_compare.find_earlier([name], GOLDEN, scn)
    monkeypatch.chdir(GOLDEN)
    assert run_and_compare.find_earlier(['./mpcc'], Path('elsewhere'), recorded) == [Path('./mpcc')]


def test_a_run_of_another_plant_is_announced_with_what_differs(monkeypatch):
    paths = [GOLDEN / name for name in ('mpcc', 'mpcc_no_ca', 'frenet')]
    assert run_and_compare.describe_other_plants(paths) == []
    run_info = run_and_compare.read.run_info

    def on_ice(path):
        info = run_info(path)
        if path.name == 'frenet':
            info['parameters'] = info['parameters'].replace('"friction": 1.0', '"friction": 0.2')
        return info

    monkeypatch.setattr(run_and_compare.read, 'run_info', on_ice)
    (line,) = run_and_compare.describe_other_plants(paths)
    assert line.startswith('frenet drove another plant than mpcc: friction 1.0 and 0.2; ')
    assert 'drive frenet once more with the plant of the others' in line
    assert '--any-car' in line


def test_new_runs_take_the_place_of_those_that_they_repeat_or_move(tmp_path):
    new, older, other = (tmp_path / name for name in ('mpcc', 'mpcc@1', 'frenet'))
    moved, repeated = RunOutcome('mpcc', True, '', new, older), RunOutcome('mpcc', True, '', new)
    failed = RunOutcome('mpcc', False, '', None)
    relative = Path(os.path.relpath(new))
    assert run_and_compare.with_new_runs([new, other], [moved]) == [new, older, other]
    assert run_and_compare.with_new_runs([relative], [repeated]) == [new]
    assert run_and_compare.with_new_runs([other], [failed]) == [other]
