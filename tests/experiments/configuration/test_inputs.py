"""The parameters of every node, and the inputs that are refused before any node starts."""

import os
import subprocess
import sys

import pytest
import yaml
from capabilities import ORDINARY_USER
from tyre_files import property_file

from bags.errors import BagError
from experiments import cli
from experiments.configuration import inputs, node_config, set_option
from msgs_yaml import share
from node_runtime import node_parameters, parameters

SLOW = ('casadi', 'matplotlib', 'bokeh', 'rclpy')  # to import


@pytest.fixture(scope='module')
def facts():
    return inputs.load_facts('double_lane_change')


@pytest.fixture
def nodes_of(facts, tmp_path):
    """Return nodes_of(settings): the nodes of the double lane change."""

    def nodes_of(*settings):
        overrides = set_option.parse_overrides(list(settings))
        chosen = node_config.find_controller('mpcc')
        places = (tmp_path / 'bag', tmp_path / 'notes')
        nodes = node_config.build_nodes(facts, chosen, 'realtime', *places, overrides)
        return {node.role: node for node in nodes}

    return nodes_of


def recorded_parameters(nodes):
    read = inputs.check_parameters(nodes)
    return node_config.collect_parameters(nodes, inputs.file_values(read))


def test_every_node_gets_the_mode(nodes_of):
    assert {node.parameters['mode'] for node in nodes_of().values()} == {'realtime'}


def test_the_plant_starts_and_stops_where_the_scenario_says(nodes_of, facts):
    values = nodes_of()['plant'].parameters
    assert values['start.from'] == 'parameters'
    assert values['start.speed_mps'] == 20.8
    assert not [name for name in values if name.startswith('patches')]
    assert values['stop.x_m'] == pytest.approx(164.4, abs=0.1)
    assert facts.length_m == pytest.approx(165.0, abs=0.5)


def test_a_setting_wins_and_is_recorded(nodes_of):
    nodes = nodes_of(
        'plant.friction=0.7', 'controller.solver.mode=one_step', 'plant.start.speed_mps=19'
    )
    assert nodes['plant'].parameters['friction'] == 0.7
    recorded = recorded_parameters(nodes.values())
    assert recorded['plant']['friction'] == 0.7
    assert recorded['plant']['start.speed_mps'] == 19
    assert recorded['controller']['solver.mode'] == 'one_step'


def test_every_parameter_of_every_node_and_named_file_is_recorded(nodes_of):
    recorded = recorded_parameters(nodes_of().values())
    assert list(recorded) == list(node_config.ROLES)
    assert recorded['controller']['tyre.front_friction'] > 0.0
    assert recorded['controller']['priorities.obstacle'] > 0.0
    assert recorded['plant']['car.body.mass_kg'] > 0.0
    assert recorded['recorder']['chunk_s'] > 0.0


def test_parameters_are_written_as_ros_reads_them(nodes_of, tmp_path):
    node = nodes_of()['plant']
    written = node_config.write_parameter_file(node, tmp_path)
    assert written == tmp_path / 'plant.yaml'
    read = yaml.safe_load(written.read_text())
    assert read == {'/**': {'ros__parameters': node.parameters}}


@pytest.mark.parametrize(
    ('text', 'expected'),
    [
        ('solver.mode=one_step', "did you mean 'controller.solver.mode'?"),
        ('solver.mdoe=one_step', "did you mean 'controller.solver.mode'?"),
        ('friction=1', "did you mean 'plant.friction'?"),
        ('contoller.solver.mode=one_step', "did you mean 'controller.solver.mode'?"),
        ('weights.lag=0', 'controller.tolerances'),
    ],
)
def test_a_refused_setting_suggests_the_closest_parameter(text, expected):
    with pytest.raises(BagError) as refused:
        set_option.parse_overrides([text])
    assert str(refused.value).startswith(f'--set {text}: ')
    assert expected in str(refused.value)


def test_common_parameters_can_be_set_on_every_node():
    assert set_option.parse_overrides(
        ['recorder.realtime.priority=5', 'scenario.mode=realtime']
    ) == {
        'recorder': {'realtime.priority': 5},
        'scenario': {'mode': 'realtime'},
    }


@pytest.mark.parametrize('text', ['plant.friction', 'friction=1', 'wheel.size=1', 'plant.x=[1'])
def test_a_setting_in_another_form_is_refused(text):
    with pytest.raises(BagError, match='--set'):
        set_option.parse_overrides([text])


def test_a_controller_may_be_a_file_of_its_own(tmp_path):
    own = tmp_path / 'brave.yaml'
    own.write_text('')
    assert node_config.find_controller(str(own)) == ('brave', own, (), '')
    assert node_config.find_controller('mpcc_no_ca').config.name == 'mpcc_no_ca.yaml'
    for wrong in ('timid', str(tmp_path / 'timid.yaml')):
        with pytest.raises(BagError, match='timid'):
            node_config.find_controller(wrong)


def test_a_controller_of_experiments_run_may_be_a_program(tmp_path, facts):
    python, shell = tmp_path / 'steer.py', tmp_path / 'steer'
    python.write_text('')
    shell.write_text('#!/bin/sh\n')
    shell.chmod(0o755)
    for program, command in ((python, (sys.executable, str(python))), (shell, (str(shell),))):
        with pytest.raises(BagError, match='only `experiments run` drives it'):
            node_config.find_controller(str(program))
        found = node_config.find_controller(str(program), programs=True)
        assert (found.name, found.program) == ('steer', command)
    places = (tmp_path / 'bag', tmp_path / 'notes')
    nodes = node_config.build_nodes(facts, found, 'lockstep', *places, {})
    (node,) = (node for node in nodes if node.role == 'controller')
    assert node.program == (str(shell),)
    recorded = recorded_parameters(nodes)['controller']
    assert recorded['program'] == str(shell)
    assert recorded['safety.obstacle_m'] == 0.5
    assert not [name for name in recorded if name.startswith(('solver', 'tolerances'))]
    with pytest.raises(BagError, match=r'--set controller.x: the controller steer is a program'):
        node_config.build_nodes(facts, found, 'lockstep', *places, {'controller': {'x': 1}})


@pytest.mark.parametrize('wrong', ['steer', 'sub/steer', './steer.py'])
def test_a_program_that_does_not_exist_or_may_not_run_is_refused(wrong, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / 'sub').mkdir()
    (tmp_path / 'sub/steer').touch()  # nobody may execute it
    with pytest.raises(BagError, match='no controller'):
        node_config.find_controller(wrong, programs=True)


def test_a_name_that_is_no_controller_is_refused_with_those_that_are():
    known = 'frenet, frenet_tuned, mpcc, mpcc_comfort, mpcc_no_ca, mpcc_no_ca_tuned'
    known += ', mpcc_road, mpcc_tuned'
    for wrong in ('timid', 'car'):
        with pytest.raises(BagError, match=f"'{wrong}'; there are {known}, tracking"):
            node_config.find_controller(wrong)
    with pytest.raises(BagError, match=r'once for each: --controller mpcc --controller frenet$'):
        node_config.find_controller('mpcc,frenet')


def test_a_controller_file_is_named_where_its_name_or_its_neighbours_is_given(
    tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    (tmp_path / 'timid.yaml').touch()
    with pytest.raises(BagError, match=r"'timid' .* give its path, \./timid\.yaml$"):
        node_config.find_controller('timid')
    with pytest.raises(BagError, match=r"holds timid\.yaml; did you mean 'timid\.yaml'\?$"):
        node_config.find_controller('./timd.yaml')
    with pytest.raises(BagError, match=r'there is no Python file in this folder$'):
        node_config.find_controller('./timid.py', programs=True)


def test_a_file_that_is_the_baseline_by_its_name_only_is_refused(tmp_path):
    own = tmp_path / 'frenet_mine.yaml'
    own.write_text('/**:\n  ros__parameters:\n    safety: {obstacle_m: 0.4}\n')
    with pytest.raises(BagError, match=r'frenet_mine\.yaml: .* add `base: frenet.yaml`'):
        node_config.find_controller(str(own))
    own.write_text('/**:\n  ros__parameters:\n    base: frenet.yaml\n')
    assert node_config.find_controller(str(own)).name == 'frenet_mine'


def test_two_controllers_of_one_name_are_refused(tmp_path):
    own = tmp_path / 'mpcc.yaml'
    own.write_text('')
    with pytest.raises(BagError, match="called 'mpcc'"):
        node_config.find_controllers(['mpcc', str(own)])
    mpcc = node_config.find_controller('mpcc')
    assert node_config.find_controllers(['mpcc', 'mpcc', str(mpcc.config)]) == [mpcc]


def test_a_number_is_read_as_ros_reads_it(nodes_of):
    assert nodes_of('plant.friction=1e-1')['plant'].parameters['friction'] == 0.1
    assert nodes_of("plant.tyre_set='1e-1'")['plant'].parameters['tyre_set'] == '1e-1'


def test_a_controller_file_with_few_keys_is_recorded_with_the_defaults_of_the_node(facts, tmp_path):
    own = tmp_path / 'brave.yaml'
    own.write_text('/**:\n  ros__parameters:\n    safety:\n      obstacle_m: 0.1\n')
    places = (tmp_path / 'bag', tmp_path / 'notes')
    chosen = node_config.find_controller(str(own))
    nodes = node_config.build_nodes(facts, chosen, 'lockstep', *places, {})
    recorded = recorded_parameters(nodes)['controller']
    assert recorded['safety.obstacle_m'] == 0.1
    assert recorded['safety.edge_m'] == 0.5
    assert recorded['tyre.front_friction'] > 0.0
    inputs.check_parameters(nodes)


def test_a_value_of_the_scenario_that_a_node_refuses_is_cited_with_file_and_key(facts, tmp_path):
    mpcc = node_config.find_controller('mpcc')
    odd = facts._replace(friction=0.01, source='ice.yaml')
    nodes = node_config.build_nodes(odd, mpcc, 'lockstep', tmp_path, tmp_path, {})
    for node, name in ((nodes[2], r'model\.friction'), (nodes[3], 'friction')):
        with pytest.raises(
            BagError, match=rf'scenario ice\.yaml: friction: {name}: .* 0.05 to 1.5'
        ):
            inputs.check_parameters([node])
    far = facts._replace(start={**facts.start, 'x_m': 1e9}, source='ice.yaml')
    nodes = node_config.build_nodes(far, mpcc, 'lockstep', tmp_path, tmp_path, {})
    with pytest.raises(BagError, match=r'scenario ice\.yaml: start: start\.x_m: '):
        inputs.check_parameters(nodes)


def test_the_source_of_a_refused_value_is_cited(facts, tmp_path):
    own = tmp_path / 'own.yaml'
    own.write_text('/**:\n  ros__parameters:\n    safety:\n      obstacle_m: -1.0\n')
    for chosen, settings, expected in (
        (str(own), {}, r'own\.yaml:4: safety\.obstacle_m: '),
        ('mpcc', {'controller': {'model.friction': 9.0}}, r'--set controller\.model\.friction: '),
    ):
        nodes = node_config.build_nodes(
            facts, node_config.find_controller(chosen), 'lockstep', tmp_path, tmp_path, settings
        )
        with pytest.raises(BagError, match=expected):
            inputs.check_parameters(nodes)


@pytest.mark.parametrize('folder', ['.', 'sub/..', '{here}'])
def test_files_of_the_working_directory_are_named_by_a_path(facts, folder, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / 'sub').mkdir()
    settings = {}
    for role, package, shipped, parameter in (
        ('controller', 'mpcc_controller', 'car.yaml', 'car_file'),
        ('plant', 'vehicle_plant', 'bmw_545i.yaml', 'plant_params'),
    ):
        text = share.path(package, 'config', shipped).read_text()
        name = f'my_{role}.yaml'
        (tmp_path / name).write_text(text.replace('mass_kg: 1850.0', 'mass_kg: 1234.0'))
        settings[role] = {parameter: f'{folder.format(here=tmp_path)}/{name}'}
    nodes = node_config.build_nodes(
        facts, node_config.find_controller('mpcc'), 'lockstep', tmp_path, tmp_path, settings
    )
    read = inputs.check_parameters(nodes)
    assert read['controller'][1].car.mass_kg == read['plant'][1].car.body.mass_kg == 1234.0
    recorded = recorded_parameters(nodes)
    assert recorded['controller']['car.mass_kg'] == recorded['plant']['car.body.mass_kg'] == 1234.0


@pytest.mark.parametrize(
    ('setting', 'known'),
    [
        ('plant.tyre_set', 'tyre_205_60r15.yaml, tyre_245_40r18.yaml, tyre_320i.yaml'),
        ('plant.plant_params', 'bmw_320i.yaml, bmw_330i.yaml, bmw_545i.yaml, commonroad_320i.yaml'),
        ('controller.car_file', 'car.yaml, car_commonroad_320i.yaml'),
    ],
)
def test_a_missing_file_is_refused_with_its_parameter_and_the_known_files(nodes_of, setting, known):
    nodes = nodes_of(f'{setting}=nosuch.yaml').values()
    name = setting.partition('.')[2]
    expected = rf'--set {setting}: {name}: .* config/nosuch\.yaml; it has {known}'
    with pytest.raises(BagError, match=expected):
        inputs.check_parameters(nodes)


@pytest.mark.parametrize('suffix', ['.tir', '.TIR'])
def test_a_tyre_property_file_is_recorded_as_the_tyre_that_the_plant_reads(
    nodes_of, suffix, tmp_path
):
    own = tmp_path / f'own{suffix}'
    own.write_text(property_file('tyre_book.yaml'))
    nodes = nodes_of(f'plant.tyre_set={own}').values()
    recorded = recorded_parameters(nodes)['plant']
    assert recorded['tyre_set'] == str(own)
    tyre = parameters.read_file(
        node_parameters.find_config('vehicle_plant', 'tyre_book.yaml')
    ).values
    assert {name: recorded[name] for name in tyre} == tyre
    assert recorded['car.body.mass_kg'] > 0.0


REFUSED_SETTINGS = [
    ('plant.friction=1e-1x', 'friction: must be a number'),
    ('plant.friction=', 'plant.friction: friction: has no value; allowed 0.05 to 1.5'),
    (
        'controller.tolerances.lag_m=',
        'controller.tolerances.lag_m: tolerances.lag_m: has no value; allowed 0.001 to 1000 m',
    ),
    ('controller.tolerances=1', 'tolerances: is a group, not a parameter; allowed tolerances.'),
    ('plant.frictoin=1', "did you mean 'friction'"),
    ('plant.tyre_set=nosuch.yaml', 'nosuch.yaml'),
    ('plant.plant_params=1', 'plant_params: must be a text'),
    ('plant.start.from=foo', 'start.from: '),
    ('plant.start.from=1', 'allowed reference or parameters'),
    ('recorder.chnk_s=0.1', 'recorder.chnk_s: chnk_s: this node has no such param'),
    ('recorder.chnk_s=0.1', "did you mean 'chunk_s'?"),
    ('recorder.split_mb=abc', 'split_mb: must be a number'),
    ('recorder.split_mb=-1', 'is -1; allowed 0 to 1e+06 MB'),
    ('recorder.realtime.priority=high', 'realtime.priority: '),
    ('scenario.speed=24', 'speed: this node has no such parameter'),
    ('scenario.mode=fast', 'mode: '),
    ('controller.car_file=nosuch.yaml', 'nosuch.yaml'),
    (
        'controller.car_file=~nosuchuser/car.yaml',
        'car_file: there is no file ~nosuchuser/car.yaml',
    ),
    (
        'controller.limits.steer_rate_radps=0.9',
        '--set controller.limits.steer_rate_radps: limits.steer_rate_radps: is 0.9; allowed up '
        'to 0.8, which the car can do (actuators.steer_rate_radps)',
    ),
    (
        'controller.limits.brake_n=0',
        '--set controller.limits.brake_n: limits.brake_n: is 0; allowed from 14000, 0.5 of what '
        'the car can do (actuators.brake_n)',
    ),
    (
        'controller.formulation.name=trackin',
        "formulation.name: is 'trackin'; did you mean 'tracking'?; allowed mpcc or frenet or ",
    ),
]


@pytest.mark.parametrize(
    ('settings', 'expected'),
    [
        *((['--set', setting], expected) for setting, expected in REFUSED_SETTINGS),
        (['--controller', 'car'], 'there are frenet, frenet_tuned, mpcc'),
        (['--controller', 'broken.yaml'], 'broken.yaml'),
        (['--out', '/dev/null'], '--out /dev/null: cannot create the folder'),
        (['--out', 'broken.yaml/runs'], '--out broken.yaml/runs: cannot create the folder'),
        (['--out', 'broken.yaml/runs'], 'broken.yaml is not a folder'),
        (['--out', '/proc/runs'], '--out /proc/runs: cannot create the folder'),
    ],
)
def test_an_input_that_a_node_would_refuse_is_one_line_before_any_node_starts(
    settings, expected, tmp_path, monkeypatch, capsys
):
    monkeypatch.chdir(tmp_path)
    (tmp_path / 'broken.yaml').write_text('/**: [1')
    assert cli.main(['run', 'straight', *settings]) == 1
    shown = capsys.readouterr()
    assert shown.out == ''
    assert [path.name for path in tmp_path.iterdir()] == ['broken.yaml']
    assert 'Errno' not in shown.err
    assert shown.err.startswith('error: ')
    assert shown.err.count('\n') == 1
    assert expected in shown.err


def test_a_folder_without_permission_to_write_is_refused(tmp_path, monkeypatch, capsys):
    # root may write everywhere, so the system is asked through this call
    monkeypatch.setattr(os, 'access', lambda path, mode: mode != os.W_OK | os.X_OK)
    assert cli.main(['run', 'straight', '--out', str(tmp_path / 'runs')]) == 1
    assert f'--out {tmp_path}/runs: no permission to write' in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


@pytest.mark.needs('ordinary_user')
def test_a_folder_below_one_that_may_not_be_entered_is_refused_with_its_option(tmp_path):
    locked = tmp_path / 'locked'
    locked.mkdir(mode=0o600)
    out = locked / 'runs'
    command = [sys.executable, '-m', 'experiments.cli', 'run', 'straight', '--out', str(out)]
    done = subprocess.run(
        [*ORDINARY_USER, *command], capture_output=True, text=True, timeout=240, cwd=tmp_path
    )
    assert done.returncode == 1
    expected = f'error: --out {out}: cannot create the folder {out}/straight: Permission denied\n'
    assert done.stderr == expected


@pytest.mark.parametrize(
    ('mistake', 'slow'),
    [
        (['nonsense'], (*SLOW, 'scipy.interpolate')),
        (
            ['straight', '--controller', 'nonsense'],
            (*SLOW, 'scipy.interpolate'),
        ),
        (['straight', '--set', 'plant.nonsense=1'], SLOW),
    ],
)
def test_a_mistake_is_reported_without_slow_imports(mistake, slow):
    script = (
        'import sys\n'
        'from experiments import cli\n'
        f'assert cli.main({["run", *mistake]!r}) == 1\n'
        f'print([name for name in {slow!r} if name in sys.modules])\n'
    )
    done = subprocess.run(
        [sys.executable, '-c', script], capture_output=True, text=True, timeout=240
    )
    assert done.stdout == '[]\n', done.stdout + done.stderr


@pytest.mark.parametrize('limit', ['0', '-1', 'nan', 'inf', 'soon'])
def test_a_time_limit_is_a_time(limit, capsys):
    with pytest.raises(SystemExit):
        cli.main(['run', 'straight', '--time-limit', limit])
    assert '--time-limit' in capsys.readouterr().err


def test_a_scenario_that_does_not_exist_is_refused_with_those_that_do():
    with pytest.raises(BagError, match='double_lane_change'):
        inputs.load_facts('double_lane')
