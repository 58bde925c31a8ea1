"""`experiments library` end to end: real drives, resumed; listed, written and refused."""

import importlib.util

import pytest
from pyarrow import parquet

from experiments import cli, code_version
from experiments.families import draw
from experiments.library import catalogue
from scenario_publisher import scenario


def test_draws_are_driven_once_and_judged(tmp_path, capsys):
    command = ['library', '--family', 'crossing_pedestrian', '--draws', '2', '--seed', '1']
    command += ['--controller', 'mpcc', '--out', str(tmp_path), '--jobs', '1']
    assert cli.main(command) == 0
    rows = parquet.read_table(tmp_path / 'results.parquet').to_pylist()
    assert [row['scenario'] for row in rows] == ['crossing_pedestrian:0', 'crossing_pedestrian:1']
    assert [row['draw'] for row in rows] == [0, 1]
    for row in rows:
        assert row['survived'] is (row['lost_by'] is None)
        assert row['code_version'] == code_version.digest()
    assert '2 drives: 0 were kept, 0 failed' in capsys.readouterr().out

    # other parameters: driven anew, and the table says with which
    assert cli.main([*command, '--set', 'controller.safety.obstacle_m=0.6']) == 0
    assert '2 drives: 0 were kept, 0 failed' in capsys.readouterr().out
    changed = parquet.read_table(tmp_path / 'results.parquet').to_pylist()
    assert 'controller.safety.obstacle_m' not in rows[0]
    assert {row['controller.safety.obstacle_m'] for row in changed} == {0.6}

    # more draws: the first ones are kept; no family can survive more than all of its draws
    command[4] = '3'
    assert cli.main([*command, '--at-least', '0']) == 0
    assert '3 drives: 2 were kept, 0 failed' in capsys.readouterr().out
    assert parquet.read_table(tmp_path / 'results.parquet').to_pylist()[:2] == rows


def test_the_list_has_every_family_and_entry(capsys):
    assert cli.main(['library', '--list']) == 0
    output = capsys.readouterr().out
    for name in (*draw.FAMILIES, *catalogue.entries_of_library()):
        assert f'\n{name} ' in output


@pytest.mark.parametrize('difficulty', draw.DIFFICULTIES)
def test_a_draw_is_written_as_a_scenario_file(tmp_path, difficulty):
    path = tmp_path / 'one.yaml'
    command = ['library', '--draw', 'slalom:3', '--seed', '7', '--difficulty', difficulty]
    assert cli.main([*command, '--out', str(path)]) == 0
    one = draw.draw('slalom', 7, 3, difficulty)
    written = scenario.load(path)
    assert written.text.endswith(one.text)
    for role, values in one.settings.items():
        for name, value in values.items():
            assert f'--set {role}.{name}={value}' in written.text.splitlines()[0]


@pytest.mark.parametrize(
    ('arguments', 'message'),
    [
        (['--draws', '1'], '--out is missing'),
        (['--family', 'slalon', '--out', 'x'], "no 'slalon'; there are pop_up"),
        (['--entries', '--entry', 'slalon', '--out', 'x'], "no 'slalon'; there are bend"),
        (['--entries', '--family', 'slalom', '--out', 'x'], '--entries drives no family'),
        (['--entry', 'slalom', '--out', 'x'], '--entry: goes with --entries'),
        (['--draw', 'slalom', '--out', 'x'], 'allowed FAMILY:INDEX'),
        (['--draw', 'slalom:-1', '--out', 'x'], 'allowed FAMILY:INDEX'),
        (['--family', 'slalom', '--controller', 'mpc', '--out', 'x'], "no controller 'mpc'"),
        (['--family', 'slalom', '--set', 'plant.nothing=1', '--out', 'x'], 'nothing'),
        (
            ['--family', 'slalom', '--set', 'recorder.x=1', '--out', 'x'],
            "--set: unknown name 'recorder.x'",
        ),
        (
            ['--family', 'slalom', '--set', 'scenario.speed_mps=20', '--out', 'x'],
            '--set scenario.speed_mps: families draw their own speeds',
        ),
    ],
)
def test_mistakes_are_one_line(arguments, message, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert cli.main(['library', *arguments]) == 1
    error = capsys.readouterr().err
    assert message in error
    assert error.count('\n') == 1


@pytest.mark.parametrize(
    'arguments', [['library', '--draws', '1'], ['batch', 'experiments/config/batch_example.yaml']]
)
def test_without_the_package_that_writes_the_table_nothing_is_driven(
    tmp_path, monkeypatch, capsys, arguments
):
    found = importlib.util.find_spec
    monkeypatch.setattr(
        importlib.util, 'find_spec', lambda name, *a: None if name == 'pyarrow' else found(name, *a)
    )
    assert cli.main([*arguments, '--out', str(tmp_path / 'table')]) == 1
    assert 'pip install pyarrow' in capsys.readouterr().err
    assert not (tmp_path / 'table').exists()
