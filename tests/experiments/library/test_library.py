"""`experiments library` end to end: real drives, resumed; listed, written and refused."""

import importlib.util

import pytest
from pyarrow import parquet

from bags.errors import BagError
from experiments import cli, code_version
from experiments.configuration import node_config
from experiments.library import library_drive, run_library
from experiments.library.library_drive import LibraryDrive
from scenario_publisher import scenario
from scenario_publisher.families import draw


def test_draws_are_driven_once_and_judged(tmp_path, capsys):
    command = ['library', '--family', 'crossing_pedestrian', '--draws', '2', '--seed', '1']
    command += ['--controller', 'mpcc', '--out', str(tmp_path), '--jobs', '1']
    assert cli.main(command) == 0
    rows = parquet.read_table(tmp_path / 'results.parquet').to_pylist()
    assert [row['drive'] for row in rows] == ['crossing_pedestrian:0', 'crossing_pedestrian:1']
    assert [row['index'] for row in rows] == [0, 1]
    for row in rows:
        assert row['survived'] is (row['lost_by'] is None)
        assert row['code_version'] == code_version.digest()
    assert '2 drives: 0 were kept, 0 failed' in capsys.readouterr().out

    # other parameters: driven anew, and the table says with which
    assert cli.main([*command, '--set', 'controller.safety.obstacle_m=0.6']) == 0
    assert '2 drives: 0 were kept, 0 failed' in capsys.readouterr().out
    changed = parquet.read_table(tmp_path / 'results.parquet').to_pylist()
    assert {row['settings'] for row in rows} == {'{}'}
    assert {row['settings'] for row in changed} == {'{"controller.safety.obstacle_m": 0.6}'}

    # more draws: the first ones are kept; no family can survive more than all of its draws
    command[4] = '3'
    assert cli.main([*command, '--at-least', '0']) == 0
    assert '3 drives: 2 were kept, 0 failed' in capsys.readouterr().out
    assert parquet.read_table(tmp_path / 'results.parquet').to_pylist()[:2] == rows


def test_the_list_has_every_family_and_entry(capsys):
    assert cli.main(['library', '--list']) == 0
    output = capsys.readouterr().out
    for name in (*draw.FAMILIES, *library_drive.entries()):
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
    ],
)
def test_mistakes_are_one_line(arguments, message, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert cli.main(['library', *arguments]) == 1
    error = capsys.readouterr().err
    assert message in error
    assert error.count('\n') == 1


def drive(**changes):
    base = LibraryDrive('pop_up', '', 1, 0, 'nominal', 'mpcc', ())
    return base._replace(**changes)


def test_what_decides_a_drive_is_in_its_key():
    keys = {
        library_drive.key(drive(**changes))
        for changes in (
            {},
            {'family': 'oncoming'},
            {'seed': 2},
            {'index': 1},
            {'difficulty': 'hard'},
            {'controller': 'frenet'},
            {'settings': (('controller', 'safety.obstacle_m', 0.6),)},
            {'name': 'slalom'},
        )
    }
    assert len(keys) == 8
    assert library_drive.key(drive()) in keys


def test_a_drive_whose_files_have_changed_since_its_key_is_not_driven(tmp_path):
    shipped = node_config.find_controller('mpcc').config
    own = tmp_path / 'own.yaml'
    own.write_text(shipped.read_text())
    one = drive(controller=str(own))
    wanted = library_drive.key(one)
    own.write_text(shipped.read_text().replace('path_search_m: 10', 'path_search_m: 11'))
    with pytest.raises(BagError, match='pop_up:0: a file of its inputs has changed since'):
        library_drive.run(one, wanted)


def test_controllers_of_the_package_are_sent_by_name(tmp_path):
    own = tmp_path / 'own.yaml'
    own.write_text(node_config.find_controller('mpcc').config.read_text())
    request = run_library.Request(
        ['pop_up'], [], 1, 0, 1, 'nominal', ['mpcc', str(own)], [], tmp_path, 1, 60.0, None
    )
    sent = [one.controller for one in run_library.plan_drives(request)]
    assert sent == ['mpcc', str(own)]


def test_a_file_that_is_called_like_a_controller_of_the_package_has_rows_of_its_own(tmp_path):
    paths = [tmp_path / f'{name}.yaml' for name in ('own', 'mpcc_road')]
    drives = [drive(controller=name) for name in ('mpcc_road', *map(str, paths))]
    keys = ['one', 'two', 'three']
    rows = run_library.build_rows(drives, keys, {}, dict.fromkeys(keys, 'lost'))
    assert [row['controller'] for row in rows] == ['mpcc_road', 'own', str(paths[1])]


def test_given_settings_win_over_those_of_a_hard_draw():
    hard = drive(difficulty='hard', settings=(('controller', 'model.friction', 0.7),))
    setup = library_drive.prepare(hard)
    assert setup.params.model.friction == 0.7
    assert setup.params.measurement_errors.position_noise_m == draw.HARD_NOISE['position_noise_m']
    assert setup.friction == scenario.parse(hard.draw.text, 'a.yaml').friction


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
