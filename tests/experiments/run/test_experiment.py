"""Which parameters reach which node, and what is refused before anything starts."""

import os
import socket
import subprocess
import sys

import pytest
import yaml
from capabilities import ORDINARY_USER
from tyre_files import property_file

from bags.errors import BagError
from experiments import cli
from experiments.configuration import inputs, node_config, set_option
from experiments.run import domain, node_graph
from msgs_yaml import share
from node_runtime import node_parameters, parameters

SLOW = ('casadi', 'matplotlib', 'bokeh', 'rclpy')  # to import


@pytest.fixture(scope='module')
def facts():
    return inputs.load_facts('double_lane_change')


@pytest.fixture
def ring(facts, tmp_path):
    """Return ring(settings): the nodes of the double lane change."""

    def ring(*settings):
        overrides = set_option.parse_overrides(list(settings))
        chosen = node_config.find_controller('mpcc')
        places = (tmp_path / 'bag', tmp_path / 'notes')
        made = node_config.build_nodes(facts, chosen, 'realtime', *places, overrides)
        return {node.role: node for node in made}

    return ring


def noted(nodes):
    read = inputs.check_parameters(nodes)
    return node_config.collect_parameters(nodes, inputs.file_values(read))


def test_everybody_is_told_the_mode(ring):
    assert {node.parameters['mode'] for node in ring().values()} == {'realtime'}


def test_the_plant_starts_and_stops_where_the_scenario_says(ring, facts):
    told = ring()['plant'].parameters
    assert told['start.from'] == 'parameters'
    assert told['start.speed_mps'] == 20.8
    assert not [name for name in told if name.startswith('patches')]
    assert told['stop.x_m'] == pytest.approx(164.4, abs=0.1)
    assert facts.length_m == pytest.approx(165.0, abs=0.5)


def test_what_is_set_by_hand_wins_and_is_noted(ring):
    made = ring('plant.friction=0.7', 'controller.solver.name=ipopt', 'plant.start.speed_mps=19')
    assert made['plant'].parameters['friction'] == 0.7
    notes = noted(made.values())
    assert notes['plant']['friction'] == 0.7
    assert notes['plant']['start.speed_mps'] == 19
    assert notes['controller']['solver.name'] == 'ipopt'


def test_the_notes_hold_every_parameter_of_every_node_and_of_the_files_they_name(ring):
    notes = noted(ring().values())
    assert list(notes) == list(node_config.ROLES)
    assert notes['controller']['tyre.front_friction'] > 0.0
    assert notes['controller']['priorities.obstacle'] > 0.0
    assert notes['plant']['car.body.mass_kg'] > 0.0
    assert notes['recorder']['chunk_s'] > 0.0


def test_parameters_are_written_as_ros_reads_them(ring, tmp_path):
    node = ring()['plant']
    written = node_config.write_parameter_file(node, tmp_path)
    assert written == tmp_path / 'plant.yaml'
    read = yaml.safe_load(written.read_text())
    assert read == {'/**': {'ros__parameters': node.parameters}}


@pytest.mark.parametrize(
    ('text', 'said'),
    [
        ('solver.name=ipopt', "did you mean 'controller.solver.name'?"),
        ('solver.nmae=ipopt', "did you mean 'controller.solver.name'?"),
        ('friction=1', "did you mean 'plant.friction'?"),
        ('contoller.solver.name=ipopt', "did you mean 'controller.solver.name'?"),
        ('weights.lag=0', 'controller.tolerances'),
    ],
)
def test_a_setting_that_is_refused_says_what_may_be_meant(text, said):
    with pytest.raises(BagError) as refused:
        set_option.parse_overrides([text])
    assert str(refused.value).startswith(f'--set {text}: ')
    assert said in str(refused.value)


def test_what_every_node_has_may_be_set_of_every_node():
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
    assert node_config.find_controller(str(own)) == ('brave', own)
    assert node_config.find_controller('mpcc_no_ca').config.name == 'mpcc_no_ca.yaml'
    for wrong in ('timid', str(tmp_path / 'timid.yaml')):
        with pytest.raises(BagError, match='timid'):
            node_config.find_controller(wrong)


def test_a_name_that_is_no_controller_is_refused_with_those_that_are():
    known = 'frenet, frenet_tuned, mpcc, mpcc_no_ca, mpcc_no_ca_tuned, mpcc_tuned'
    for wrong in ('timid', 'car'):
        with pytest.raises(BagError, match=f"'{wrong}'; there are {known}"):
            node_config.find_controller(wrong)


def test_two_controllers_of_one_name_are_refused(tmp_path):
    own = tmp_path / 'mpcc.yaml'
    own.write_text('')
    with pytest.raises(BagError, match="called 'mpcc'"):
        node_config.find_controllers(['mpcc', str(own)])
    mpcc = node_config.find_controller('mpcc')
    assert node_config.find_controllers(['mpcc', 'mpcc', str(mpcc.config)]) == [mpcc]


def test_a_number_is_read_as_ros_reads_it(ring):
    assert ring('plant.friction=1e-1')['plant'].parameters['friction'] == 0.1
    assert ring("plant.tyre_set='1e-1'")['plant'].parameters['tyre_set'] == '1e-1'


def test_a_controller_file_with_few_keys_is_noted_with_the_defaults_of_the_node(facts, tmp_path):
    own = tmp_path / 'brave.yaml'
    own.write_text('/**:\n  ros__parameters:\n    safety:\n      obstacle_m: 0.1\n')
    places = (tmp_path / 'bag', tmp_path / 'notes')
    chosen = node_config.find_controller(str(own))
    made = node_config.build_nodes(facts, chosen, 'lockstep', *places, {})
    notes = noted(made)['controller']
    assert notes['safety.obstacle_m'] == 0.1
    assert notes['safety.edge_m'] == 0.5
    assert notes['tyre.front_friction'] > 0.0
    inputs.check_parameters(made)


def test_a_value_of_the_scenario_that_a_node_refuses_is_cited_with_file_and_key(facts, tmp_path):
    mpcc = node_config.find_controller('mpcc')
    odd = facts._replace(friction=0.01, source='ice.yaml')
    made = node_config.build_nodes(odd, mpcc, 'lockstep', tmp_path, tmp_path, {})
    for node, name in ((made[2], r'model\.friction'), (made[3], 'friction')):
        with pytest.raises(
            BagError, match=rf'scenario ice\.yaml: friction: {name}: .* 0.05 to 1.5'
        ):
            inputs.check_parameters([node])
    far = facts._replace(start={**facts.start, 'x_m': 1e9}, source='ice.yaml')
    made = node_config.build_nodes(far, mpcc, 'lockstep', tmp_path, tmp_path, {})
    with pytest.raises(BagError, match=r'scenario ice\.yaml: start: start\.x_m: '):
        inputs.check_parameters(made)


def test_what_is_set_or_written_in_a_controller_file_is_cited_as_such(facts, tmp_path):
    own = tmp_path / 'own.yaml'
    own.write_text('/**:\n  ros__parameters:\n    safety:\n      obstacle_m: -1.0\n')
    for chosen, settings, said in (
        (str(own), {}, r'own\.yaml:4: safety\.obstacle_m: '),
        ('mpcc', {'controller': {'model.friction': 9.0}}, r'--set controller\.model\.friction: '),
    ):
        made = node_config.build_nodes(
            facts, node_config.find_controller(chosen), 'lockstep', tmp_path, tmp_path, settings
        )
        with pytest.raises(BagError, match=said):
            inputs.check_parameters(made)


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
    made = node_config.build_nodes(
        facts, node_config.find_controller('mpcc'), 'lockstep', tmp_path, tmp_path, settings
    )
    read = inputs.check_parameters(made)
    assert read['controller'][1].car.mass_kg == read['plant'][1].car.body.mass_kg == 1234.0
    notes = noted(made)
    assert notes['controller']['car.mass_kg'] == notes['plant']['car.body.mass_kg'] == 1234.0


@pytest.mark.parametrize(
    ('setting', 'known'),
    [
        ('plant.tyre_set', 'tyre_205_60r15.yaml, tyre_245_40r18.yaml, tyre_book.yaml'),
        ('plant.plant_params', 'bmw_330i.yaml, bmw_545i.yaml, vw_gti.yaml'),
        ('controller.car_file', 'car.yaml'),
    ],
)
def test_a_file_that_is_not_there_is_refused_with_its_parameter_and_those_there_are(
    ring, setting, known
):
    made = ring(f'{setting}=nosuch.yaml').values()
    name = setting.partition('.')[2]
    said = rf'--set {setting}: {name}: .* config/nosuch\.yaml; it has {known}; '
    with pytest.raises(BagError, match=said):
        inputs.check_parameters(made)


@pytest.mark.parametrize('suffix', ['.tir', '.TIR'])
def test_a_tyre_property_file_is_noted_as_the_tyre_that_the_plant_reads(ring, suffix, tmp_path):
    own = tmp_path / f'own{suffix}'
    own.write_text(property_file('tyre_book.yaml'))
    made = ring(f'plant.tyre_set={own}').values()
    notes = noted(made)['plant']
    assert notes['tyre_set'] == str(own)
    tyre = parameters.read_file(
        node_parameters.find_config('vehicle_plant', 'tyre_book.yaml')
    ).values
    assert {name: notes[name] for name in tyre} == tyre
    assert notes['car.body.mass_kg'] > 0.0


@pytest.mark.parametrize(
    ('settings', 'said'),
    [
        (['--set', 'plant.friction=1e-1x'], 'friction: must be a number'),
        (['--set', 'plant.frictoin=1'], "did you mean 'friction'"),
        (['--set', 'plant.tyre_set=nosuch.yaml'], 'nosuch.yaml'),
        (['--set', 'plant.plant_params=1'], 'plant_params: must be a text'),
        (
            ['--set', 'plant.start.from=foo'],
            'start.from: ',
        ),
        (['--set', 'plant.start.from=1'], 'allowed reference or parameters'),
        (['--set', 'recorder.chnk_s=0.1'], 'recorder.chnk_s: chnk_s: this node has no such param'),
        (['--set', 'recorder.chnk_s=0.1'], "did you mean 'chunk_s'?"),
        (['--set', 'recorder.split_mb=abc'], 'split_mb: must be a number'),
        (
            ['--set', 'recorder.split_mb=-1'],
            'with -1; allowed 0 to 1e+06 MB',
        ),
        (['--set', 'recorder.realtime.priority=high'], 'realtime.priority: '),
        (['--set', 'scenario.speed=24'], 'speed: this node has no such parameter'),
        (['--set', 'scenario.mode=fast'], 'mode: '),
        (['--set', 'controller.car_file=nosuch.yaml'], 'nosuch.yaml'),
        (
            ['--set', 'controller.car_file=~nosuchuser/car.yaml'],
            'car_file: there is no file ~nosuchuser/car.yaml',
        ),
        (
            ['--set', 'controller.limits.steer_rate_radps=0.9'],
            '--set controller.limits.steer_rate_radps: limits.steer_rate_radps: is 0.9; allowed up '
            'to 0.8, which the car can do (actuators.steer_rate_radps)',
        ),
        (['--controller', 'car'], 'there are frenet, frenet_tuned, mpcc'),
        (['--controller', 'broken.yaml'], 'broken.yaml'),
        (['--out', '/dev/null'], '--out /dev/null: cannot create the folder'),
        (['--out', 'broken.yaml/runs'], '--out broken.yaml/runs: cannot create the folder'),
        (['--out', 'broken.yaml/runs'], 'broken.yaml is not a folder'),
        (['--out', '/proc/runs'], '--out /proc/runs: cannot create the folder'),
    ],
)
def test_what_no_node_would_start_with_is_one_line_before_anything_starts(
    settings, said, tmp_path, monkeypatch, capsys
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
    assert said in shown.err


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
        [*ORDINARY_USER, *command], capture_output=True, text=True, timeout=60, cwd=tmp_path
    )
    assert done.returncode == 1
    said = f'error: --out {out}: cannot create the folder {out}/straight: Permission denied\n'
    assert done.stderr == said


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
def test_a_mistake_is_answered_without_loading_what_takes_seconds(mistake, slow):
    script = (
        'import sys\n'
        'from experiments import cli\n'
        f'assert cli.main({["run", *mistake]!r}) == 1\n'
        f'print([name for name in {slow!r} if name in sys.modules])\n'
    )
    done = subprocess.run(
        [sys.executable, '-c', script], capture_output=True, text=True, timeout=60
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


def test_two_runs_never_share_a_domain():
    with domain.reserved({}) as one, domain.reserved({}) as other:
        assert one != other
        assert {one, other} <= set(range(1, domain.LAST + 1))


def test_a_domain_that_somebody_listens_in_is_not_taken(monkeypatch):
    with domain.reserved({}) as free:
        monkeypatch.setattr(os, 'getpid', lambda: free - 1)  # where the search begins
    with domain.reserved({}) as number:
        assert number == free
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as listener:
        listener.bind(('', 7400 + 250 * free + 10))
        with domain.reserved({}) as number:
            assert number != free


def test_a_domain_that_is_given_is_kept():
    with domain.reserved({'ROS_DOMAIN_ID': '157'}) as number:
        assert number == 157


def test_in_a_given_domain_somebody_may_look_on():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as viewer:
        viewer.bind(('', 7400 + 250 * 157 + 10))
        with domain.reserved({'ROS_DOMAIN_ID': '157'}) as number:
            assert number == 157


def test_a_given_domain_in_which_another_run_is_is_refused():
    given = {'ROS_DOMAIN_ID': '157'}
    with (
        domain.reserved(given),
        pytest.raises(BagError, match='ROS_DOMAIN_ID=157'),
        domain.reserved(given),
    ):
        pass


@pytest.mark.parametrize('given', ['abc', '-1', '233', '1.5'])
def test_a_domain_is_a_number_that_has_ports(given):
    wanted = 'from 0 to 232'
    with pytest.raises(BagError, match=wanted), domain.reserved({'ROS_DOMAIN_ID': given}):
        pass


def test_on_the_wall_clock_plant_and_controller_have_a_core_each(monkeypatch):
    monkeypatch.setattr(os, 'sched_getaffinity', lambda pid: {3, 5, 7})
    assert node_graph._cores('realtime') == {'plant': {3}, 'controller': {5}}
    assert node_graph._cores('lockstep') == {}
    monkeypatch.setattr(os, 'sched_getaffinity', lambda pid: {3})
    assert node_graph._cores('realtime') == {}
