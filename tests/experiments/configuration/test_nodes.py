"""What each node of a run gets as parameters, from which file, and what is recorded of it."""

import sys

import pytest
import yaml
from tyre_files import property_file

from bags.errors import BagError
from experiments.configuration import inputs, node_config, set_option
from experiments.run import launch_arguments
from msgs_yaml import share
from node_runtime import node_parameters, parameters, provenance
from node_runtime.parameters import ROAD_FRICTION, RUN_TIME, SPEED
from scenario_publisher import scenario
from scenario_publisher.scenario import Start

MPCC = share.path('mpcc_controller', 'config', 'mpcc.yaml')
OWN = '/**:\n  ros__parameters:\n    base: {}\n    safety: {{obstacle_m: 0.875}}\n'


def test_the_nodes_get_what_the_scenario_says_and_all_of_it_is_recorded(build, recorded, tmp_path):
    nodes = build()
    plant = nodes['plant'].parameters
    assert (plant['start.from'], plant['start.speed_mps']) == ('parameters', 20.8)
    assert plant['stop.x_m'] == pytest.approx(164.4, abs=0.1)
    assert not [name for name in plant if name.startswith('patches')]
    assert {node.parameters['mode'] for node in nodes.values()} == {'lockstep'}
    assert [node.parameters['recorders'] for node in nodes.values()] == [0, 1, 1, 1]
    noted = recorded(nodes)
    assert [*noted, 'estimator'] == [*node_config.ROLES]
    for role, name in (
        ('controller', 'tyre.front_friction'),
        ('controller', 'priorities.obstacle'),
        ('plant', 'car.body.mass_kg'),
        ('recorder', 'chunk_s'),
    ):
        assert noted[role][name] > 0.0
    written = node_config.write_parameter_file(nodes['plant'], tmp_path)
    assert yaml.safe_load(written.read_text()) == {'/**': {'ros__parameters': plant}}
    assert written == tmp_path / 'plant.yaml'


def test_a_setting_wins_over_scenario_and_file_is_read_as_ros_reads_it_and_recorded(
    build, recorded
):
    nodes = build(
        'plant.friction=7e-1',
        'plant.start.speed_mps=19',
        'controller.solver.mode=one_step',
        'recorder.realtime.priority=5',
    )
    noted = recorded(nodes)
    assert nodes['plant'].parameters['friction'] == noted['plant']['friction'] == 0.7
    assert noted['plant']['start.speed_mps'] == 19
    assert noted['controller']['solver.mode'] == 'one_step'
    assert noted['recorder']['realtime.priority'] == 5
    assert set_option.parse_overrides(["plant.tyre_set='1e-1'"]) == {'plant': {'tyre_set': '1e-1'}}


@pytest.mark.parametrize('base', ['mpcc.yaml', 'sub/other.yaml', 'other.yaml'])
def test_a_controller_file_holds_what_differs_from_its_base(build, recorded, tmp_path, base):
    (tmp_path / 'sub').mkdir()
    for other in ('sub/other.yaml', 'other.yaml'):
        (tmp_path / other).write_text(MPCC.read_text())
    own = tmp_path / 'mine.yaml'
    own.write_text(OWN.format(base))
    nodes = build(controller=own)
    expected = parameters.read_file(MPCC).values | {'safety.obstacle_m': 0.875}
    # ROS does not tell the node where its file is
    written = node_config.write_parameter_file(nodes['controller'], tmp_path).read_text()
    absolute = yaml.safe_load(written)['/**']['ros__parameters']['base']
    assert absolute == str(MPCC if base == 'mpcc.yaml' else tmp_path / base)
    noted = recorded(nodes)['controller']
    assert 'base' not in noted
    assert expected.items() <= noted.items()


def test_a_controller_file_without_a_base_has_the_defaults_of_the_node(build, recorded, tmp_path):
    own = tmp_path / 'brave.yaml'
    own.write_text('/**: {ros__parameters: {safety: {obstacle_m: 0.1}}}')
    nodes = build(controller=own)
    noted = recorded(nodes)['controller']
    assert (noted['safety.obstacle_m'], noted['safety.edge_m']) == (0.1, 0.5)
    written = node_config.write_parameter_file(nodes['controller'], tmp_path).read_text()
    assert 'base' not in written


def test_a_controller_is_a_name_a_file_or_a_program(build, recorded, tmp_path):
    files = {name: tmp_path / name for name in ('brave.yaml', 'steer.py', 'steer')}
    for file in files.values():
        file.write_text('#!/bin/sh\n' if file.name == 'steer' else '')
    files['steer'].chmod(0o755)
    brave = files['brave.yaml']
    assert node_config.find_controller(str(brave)) == ('brave', brave, (), '')
    (tmp_path / 'frenet_mine.yaml').write_text(OWN.format('frenet.yaml'))
    own_baseline = node_config.find_controller(str(tmp_path / 'frenet_mine.yaml'))
    assert (own_baseline.name, own_baseline.name_or_path) == ('frenet_mine', str(own_baseline[1]))
    mpcc = node_config.find_controller('mpcc')
    assert (mpcc.config.name, mpcc.name_or_path) == ('mpcc.yaml', 'mpcc')
    assert node_config.find_controllers(['mpcc', 'mpcc', str(mpcc.config)]) == [mpcc]
    labelled = node_config.find_controllers(['mpcc', 'mpcc', 'frenet'], ['a', 'b', 'a'])
    assert [one.run_name for one in labelled] == ['mpcc@a', 'mpcc@b', 'frenet@a']
    for name, command in (('steer.py', [sys.executable]), ('steer', [])):
        program = (*command, str(files[name]))
        nodes = build(controller=files[name])
        assert nodes['controller'].program == program
        noted = recorded(nodes)['controller']
        assert (noted['program'], noted['safety.obstacle_m']) == (' '.join(program), 0.5)
        assert noted['program_sha256'] == provenance.digest_file(files[name])
        assert not [key for key in noted if key.startswith(('solver', 'tolerances'))]


@pytest.mark.parametrize('folder', ['.', 'sub/..', '{here}'])
def test_files_of_the_working_directory_are_named_by_a_path(
    build, recorded, folder, tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    (tmp_path / 'sub').mkdir()
    settings = []
    for package, shipped, parameter in (
        ('mpcc_controller', 'car.yaml', 'controller.car_file'),
        ('vehicle_plant', 'bmw_545i.yaml', 'plant.plant_params'),
    ):
        text = share.path(package, 'config', shipped).read_text()
        (tmp_path / f'my_{shipped}').write_text(text.replace('mass_kg: 1850.0', 'mass_kg: 1234.0'))
        settings.append(f'{parameter}={folder.format(here=tmp_path)}/my_{shipped}')
    noted = recorded(build(*settings))
    assert noted['controller']['car.mass_kg'] == noted['plant']['car.body.mass_kg'] == 1234.0


@pytest.mark.parametrize('suffix', ['.tir', '.TIR'])
def test_a_tyre_property_file_is_recorded_as_the_tyre_that_the_plant_reads(
    build, recorded, suffix, tmp_path
):
    own = tmp_path / f'own{suffix}'
    own.write_text(property_file('tyre_book.yaml'))
    noted = recorded(build(f'plant.tyre_set={own}'))['plant']
    shipped = node_parameters.find_config('vehicle_plant', 'tyre_book.yaml')
    assert parameters.read_file(shipped).values.items() <= noted.items()
    assert noted['tyre_set'] == str(own)


@pytest.mark.parametrize(
    ('friction', 'speed_mps', 'time_s'),
    [
        (ROAD_FRICTION.low, SPEED.low, RUN_TIME.low),
        (ROAD_FRICTION.high, SPEED.high, RUN_TIME.high),
    ],
)
def test_the_ends_of_a_range_of_a_scenario_are_taken_by_controller_and_plant(
    build, friction, speed_mps, time_s, tmp_path
):
    patch = {'from_m': 0, 'to_m': 9, 'from_offset_m': 0, 'to_offset_m': 2, 'friction': friction}
    changes = {
        'friction': friction,
        'friction_patches': [patch],
        'speed': {'constant_mps': speed_mps},
        'stop': {'progress_m': 60.0, 'time_s': time_s},
    }
    source = tmp_path / 'own.yaml'
    source.write_text(yaml.safe_dump(yaml.safe_load(scenario.load('straight').text) | changes))
    scn = inputs.load_scenario(str(source))
    for controller in ('mpcc', 'frenet'):
        read = inputs.check_parameters(build(scenario=source, controller=controller).values())
        params, plant = read['controller'][0], read['plant'][0]
        assert params.model.friction == scn.friction == plant.friction
        assert plant.start.speed_mps == scn.start.speed
        assert plant.stop.time_s == scn.stop.time
        assert [*plant.patches.friction] == [friction]


@pytest.mark.parametrize(
    ('changes', 'role', 'error'),
    [
        ({'friction': 0.01}, 'controller', r'friction: model\.friction: .* 0.05 to 1.5'),
        ({'friction': 0.01}, 'plant', 'friction: friction: .* 0.05 to 1.5'),
        ({'start': Start(1e9, 0.0, 0.0, 20.0)}, 'plant', r'start: start\.x_m: '),
    ],
)
def test_a_value_of_the_scenario_that_a_node_refuses_is_cited_with_file_and_key(
    build, changes, role, error
):
    scn = inputs.load_scenario('double_lane_change')._replace(**changes)
    node = build(scenario='ice.yaml', scn=scn)[role]
    with pytest.raises(BagError, match=rf'scenario ice\.yaml: {error}'):
        inputs.check_parameters([node])


FILE = """/**: {ros__parameters: {mode: realtime}}
plant:
  ros__parameters:
    friction: 0.5
    start: {speed_mps: 10.0}
/car1/controller: {ros__parameters: {tolerances.lag_m: 1e-1}}
/**/recorder: {ros__parameters: {poll_s: 0.01}}
"""


@pytest.fixture
def file(tmp_path):
    path = tmp_path / 'several.yaml'
    path.write_text(FILE)
    return path


def test_sections_of_parameter_files_are_for_their_nodes_and_the_last_file_counts(file, tmp_path):
    values, sources = launch_arguments.read_files([str(file)], 'car1')
    assert values == {
        'recorder': {'mode': 'realtime', 'poll_s': 0.01},
        'scenario': {'mode': 'realtime'},
        'controller': {'mode': 'realtime', 'tolerances.lag_m': 0.1},
        'plant': {'mode': 'realtime', 'friction': 0.5, 'start.speed_mps': 10.0},
        'estimator': {'mode': 'realtime'},
    }
    assert sources['plant']['start.speed_mps'] == f'{file}:5'
    later = tmp_path / 'later.yaml'
    later.write_text('/plant: {ros__parameters: {friction: 0.4}}\n')
    values, sources = launch_arguments.read_files([str(file), str(later)], '/car1')
    assert (values['plant']['friction'], values['plant']['start.speed_mps']) == (0.4, 10.0)
    assert sources['plant']['friction'] == f'{later}:1'
    assert launch_arguments.read_files([]) == ({}, {})


@pytest.mark.parametrize(
    ('text', 'error'),
    [
        ('plnat: {ros__parameters: {friction: 0.5}}', "yaml:1: plnat: .*did you mean 'plant'"),
        ('/car2/plant: {ros__parameters: {friction: 0.5}}', 'no node of this run'),
        ('[', 'several.yaml'),
        ('plant: {ros__parameters: {friction: 50.0}}', 'several.yaml:1: friction: .* allowed 0.05'),
        ('controller: {ros__parameters: {tolerances: {lag_m: }}}', 'lag_m: has no value; allowed'),
    ],
)
def test_a_mistake_in_a_parameter_file_is_located(build, file, text, error):
    file.write_text(text)
    with pytest.raises(BagError, match=error):
        inputs.check_parameters(
            build(given=launch_arguments.read_files([str(file)], 'car1')).values()
        )


def test_a_car_with_sensors_has_an_estimator_before_it_whose_odometry_the_controller_takes(
    build, recorded, tmp_path
):
    sensors, chosen = 'plant.sensors=sensors_survey.yaml', 'estimator.misfit=50.0'
    nodes = build(sensors, chosen)
    assert [*nodes] == ['recorder', 'scenario', 'controller', 'estimator', 'plant']
    assert nodes['controller'].remappings == ('vehicle/odometry:=estimator/odometry',)
    assert not any(node.remappings for role, node in nodes.items() if role != 'controller')
    written = node_config.write_parameter_file(nodes['controller'], tmp_path)
    assert '-r vehicle/odometry:=' in ' '.join(
        node_config.ros_arguments(nodes['controller'], written)
    )
    noted = recorded(nodes)['estimator']
    assert (noted['mode'], noted['recorders'], noted['misfit']) == ('lockstep', 1, 50.0)
    assert (noted['imu_s'], noted['position_drift_m'], noted['car.mass_kg']) == (0.005, 0.01, 1850)
    # what the file says of the car is what follows from car and plant
    file = parameters.read_file(node_config.defaults_file(nodes['estimator'])).values
    derived = {name: value for name, value in noted.items() if name.startswith('car.')}
    assert derived == pytest.approx({name: file[name] for name in derived}, rel=1e-4)


@pytest.mark.parametrize(
    ('settings', 'error'),
    [
        (['estimator.misfit=50.0'], 'estimator.misfit has no effect without plant.sensors'),
        (['estimator.misfit=0.0'], 'the estimator would not start: --set estimator.misfit: .*1 to'),
        (['estimator.mist=1'], "estimator.mist: .* no such parameter; did you mean 'misfit'"),
        (['plant.sensors={file}'], 'imu.period_ms is 4; allowed 1, 2, 5 or 10 ms'),
    ],
)
def test_an_estimator_that_could_not_run_is_refused(build, tmp_path, settings, error):
    file = tmp_path / 'sensors.yaml'
    known = share.path('vehicle_plant', 'config', 'sensors_survey.yaml').read_text()
    file.write_text(known.replace('period_ms: 5 ', 'period_ms: 4 '))
    given = [setting.format(file=file) for setting in settings]
    if 'without' not in error and 'file' not in settings[0]:
        given.append('plant.sensors=sensors_survey.yaml')
    with pytest.raises(BagError, match=error):
        inputs.check_parameters(build(*given).values())
