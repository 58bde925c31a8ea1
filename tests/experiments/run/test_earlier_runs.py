import os
from pathlib import Path

import pytest

from bags.errors import BagError
from experiments.configuration import inputs
from experiments.run import earlier_runs
from experiments.run.node_graph import RunOutcome

ROOT = Path(__file__).parents[3]
GOLDEN = ROOT / 'bags/reference/double_lane_change'


@pytest.fixture
def recorded():
    """The scenario as the golden recordings have it."""
    from bags.storage import read
    from scenario_publisher import scenario

    return scenario.parse(read.run_info(GOLDEN / 'mpcc')['scenario_text'], 'golden')


def test_a_run_is_found_by_its_name_and_by_its_path(recorded, monkeypatch):
    assert earlier_runs.find(['frenet'], GOLDEN, recorded) == [GOLDEN / 'frenet']
    monkeypatch.chdir(GOLDEN)
    assert earlier_runs.find(['./mpcc'], Path('elsewhere'), recorded) == [Path('./mpcc')]


def test_a_misspelt_run_is_refused_with_those_there_are(recorded):
    with pytest.raises(BagError, match=r'there are frenet, mpcc, mpcc_no_ca; did you mean .mpcc.'):
        earlier_runs.find(['mpc'], GOLDEN, recorded)


def test_a_run_of_another_scenario_is_refused(recorded):
    with pytest.raises(BagError, match='drove another scenario, double_lane_change'):
        earlier_runs.find(['mpcc'], GOLDEN, inputs.load_scenario('straight'))
    other = recorded._replace(text=recorded.text + '\n')
    with pytest.raises(BagError, match='drove another version of double_lane_change'):
        earlier_runs.find(['mpcc'], GOLDEN, other)


def test_a_run_of_another_plant_is_announced_with_what_differs(monkeypatch):
    paths = [GOLDEN / name for name in ('mpcc', 'mpcc_no_ca', 'frenet')]
    assert earlier_runs.describe_other_plants(paths) == []
    recorded = earlier_runs.read.run_info

    def on_ice(path):
        info = recorded(path)
        if path.name == 'frenet':
            info['parameters'] = info['parameters'].replace('"friction": 1.0', '"friction": 0.2')
        return info

    monkeypatch.setattr(earlier_runs.read, 'run_info', on_ice)
    (line,) = earlier_runs.describe_other_plants(paths)
    assert line.startswith('frenet drove another plant than mpcc: friction 1.0 and 0.2; ')
    assert 'drive frenet once more with the plant of the others' in line
    assert '--any-car' in line


def test_a_run_that_got_a_number_is_compared_under_it(tmp_path):
    new, older, other = (tmp_path / name for name in ('mpcc', 'mpcc@1', 'frenet'))
    moved = RunOutcome('mpcc', True, '', new, older)
    assert earlier_runs.with_new_runs([new, other], [moved]) == [new, older, other]


def test_a_run_that_was_repeated_is_compared_once(tmp_path):
    new = tmp_path / 'mpcc'
    repeated = RunOutcome('mpcc', True, '', new)
    relative = Path(os.path.relpath(new))
    assert earlier_runs.with_new_runs([relative], [repeated]) == [new]


def test_a_run_that_failed_is_not_compared(tmp_path):
    assert earlier_runs.with_new_runs([tmp_path], [RunOutcome('mpcc', False, '', None)]) == [
        tmp_path
    ]
