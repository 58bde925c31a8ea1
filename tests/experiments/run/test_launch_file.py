"""`ros2 launch experiments closed_loop.launch.py`: what it records, and how it ends.

Run with `launch` where ROS 2 is installed. No wheel of it exists: elsewhere `launch_stand_in`
stands for it, which starts, watches and ends real processes by the same rules.
"""

import json
import os
import re
import signal
import subprocess
import sys
from pathlib import Path

import launch_stand_in
import pytest
from shell_nodes import AWAIT_RECORDER, NODES, RECORD, WAIT, left_over
from wait_until import wait_until

from bags import cli
from bags.storage import read
from experiments.configuration import node_config
from experiments.run import node_graph, processes
from msgs_yaml import share

PLANT = 'vehicle_plant/plant_node'
NO_DOMAIN = 0  # of shell programs, which talk to nobody
PATIENCE_S = 240.0  # for what takes seconds on an idle machine
LAUNCH_FILE = share.path('experiments', 'launch', 'closed_loop.launch.py')
RUNNER = Path(__file__).with_name('run_launch_file.py')


@pytest.fixture
def launched(tmp_path, popen):
    """Return launched(number, name=value, ...): the started launch.

    The number is that of a ROS domain; it has no effect where shell programs stand for the nodes.
    """
    logs = tmp_path / 'log'
    logs.mkdir()

    def start(number=NO_DOMAIN, **arguments):
        given = {'scenario': 'straight', 'out': tmp_path / 'runs', **arguments}
        words = [f'{name}:={value}' for name, value in given.items()]
        own = {'ROS_DOMAIN_ID': str(number), 'ROS_LOG_DIR': str(logs)}
        return popen(
            *(sys.executable, RUNNER, LAUNCH_FILE, *words),
            env={'AMENT_PREFIX_PATH': sys.prefix, **os.environ, **own},
            stdout=(tmp_path / 'output').open('wb'),
            stderr=subprocess.STDOUT,
        )

    yield start
    for pid in running_nodes(tmp_path):
        os.kill(pid, signal.SIGKILL)


@pytest.fixture
def shell(tmp_path, prefix):
    """Return replace(node, script) for shell programs that launch finds, too."""
    index = tmp_path / 'prefix/share/ament_index/resource_index/packages'
    index.mkdir(parents=True)
    for node in NODES:
        (index / Path(node).parent).touch()
    return prefix


def output(folder):
    return (folder / 'output').read_text(errors='replace')


def running_nodes(folder):
    return left_over(folder, '--ros-args')


@pytest.fixture
def driving(tmp_path, shell, launched):
    """Return a launch whose plant has printed something and would never end."""
    shell(PLANT, f'trap "exit 0" INT\n{AWAIT_RECORDER}echo driving\n{WAIT}')
    launch = launched()

    def is_driving():
        assert launch.poll() is None, output(tmp_path)
        return 'driving' in output(tmp_path)

    wait_until(is_driving, PATIENCE_S, 'the plant was not started')
    return launch


@pytest.mark.timeout(600)
def test_a_drive_by_launch_ends_well_and_can_be_compared(tmp_path, launched, domain, capsys):
    assert launched(domain).wait(PATIENCE_S) == 0, output(tmp_path)
    bag = tmp_path / 'runs/straight/mpcc'
    noted = json.loads(read.load(bag).run_info['parameters'])
    assert sorted([*noted, 'estimator']) == sorted(node_config.ROLES)
    assert noted['plant']['car.body.mass_kg'] > 0.0
    assert noted['controller']['model.friction'] == noted['plant']['friction']
    assert cli.main(['compare', str(bag)]) == 0, capsys.readouterr().err
    runs = json.loads((tmp_path / 'runs/straight/comparison.json').read_text())['runs']
    assert runs['mpcc']['completed'] is True
    assert running_nodes(tmp_path) == {}


UNCLOSED = re.sub("trap '.*' INT", "trap 'exit 1' INT", RECORD)
STOPPED = f'{AWAIT_RECORDER}exit {node_graph.NOT_FINISHED}\n'


@pytest.mark.parametrize(
    ('node', 'script', 'plant', 'end'),
    [
        ('bags/recorder_node', 'kill -KILL $$\n', WAIT, 'by SIGKILL'),
        ('scenario_publisher/scenario_node', 'exit 0\n', WAIT, 'with exit code 0'),
        ('bags/recorder_node', UNCLOSED, NODES[PLANT], 'with exit code 1'),
        (PLANT, STOPPED, STOPPED, f'with exit code {node_graph.NOT_FINISHED}'),
    ],
)
def test_a_node_that_ends_badly_or_before_the_plant_is_an_error(
    tmp_path, shell, launched, node, script, plant, end
):
    shell(PLANT, plant)
    shell(node, script)
    assert launched().wait(PATIENCE_S) == 1
    assert f'{Path(node).name} ended {end}' in output(tmp_path)
    assert running_nodes(tmp_path) == {}
    if node == PLANT:
        assert (tmp_path / 'runs/straight/mpcc/metadata.yaml').is_file()


def test_an_interrupt_is_an_error_and_closes_the_bag(tmp_path, driving):
    os.killpg(driving.pid, signal.SIGINT)
    assert driving.wait(PATIENCE_S) == 1
    assert 'the drive was interrupted' in output(tmp_path)
    assert (tmp_path / 'runs/straight/mpcc/metadata.yaml').is_file()
    assert running_nodes(tmp_path) == {}


def test_no_node_goes_on_without_the_launch(tmp_path, driving):
    """Launch passes on SIGINT only: cars would be driven on by nodes that nobody watches."""
    driving.kill()
    wait_until(lambda: not running_nodes(tmp_path), PATIENCE_S, 'a node goes on')
    assert (tmp_path / 'runs/straight/mpcc/metadata.yaml').is_file()


@pytest.fixture
def refused(tmp_path, monkeypatch, capsys):
    """Return refused(name=value, ...): what a launch in this process says before it ends with 1."""
    (tmp_path / 'runs/straight/frenet').mkdir(parents=True)
    for name in (*processes.DEFAULT_ENVIRONMENT, *processes.FIXED_ENVIRONMENT):
        monkeypatch.setenv(name, os.environ.get(name, ''))
    before = dict(sys.modules)

    def launch(**arguments):
        given = {'scenario': 'straight', 'out': str(tmp_path / 'runs'), **arguments}
        assert launch_stand_in.run(LAUNCH_FILE, given) == 1
        return ''.join(capsys.readouterr())

    yield launch
    for name in [name for name in sys.modules if name.split('.')[0].startswith('launch')]:
        if name not in before:
            del sys.modules[name]
    assert [*(tmp_path / 'runs/straight').rglob('*')] == [tmp_path / 'runs/straight/frenet']


@pytest.mark.parametrize(
    ('wrong', 'text'),
    [
        ({'mode': 'realtime', 'use_sim_time': 'true'}, 'nobody publishes /clock with mode:=real'),
        ({'mode': 'fast'}, '"mode" provided value "fast" is not valid.*lockstep.*realtime'),
        ({'out': '/proc/runs'}, 'out:=/proc/runs: cannot create the folder'),
        ({'controller': 'frenet'}, 'runs/straight/frenet exists already'),
        ({'set': 'friction=0.6'}, 'set:=friction=0.6: must be NODE.parameter=value'),
        ({'set': 'plant.plant_params=vw_gti.yaml'}, 'does not fit the plant: .*any_car:=true'),
        ({'params_file': '/nowhere.yaml'}, '/nowhere.yaml'),
    ],
)
def test_an_argument_that_cannot_be_used_is_an_error_that_names_it(refused, wrong, text):
    said = refused(**wrong)
    assert re.search(text, said), said


def test_the_arguments_reach_the_nodes_what_is_recorded_and_the_warnings(tmp_path, shell, launched):
    file = tmp_path / 'mine.yaml'
    file.write_text(
        'plant: {ros__parameters: {friction: 0.8, start: {speed_mps: 12.0}}}\n'
        '/car1/controller: {ros__parameters: {tolerances: {lag_m: 0.7}}}\n'
    )
    own = tmp_path / 'brave.yaml'
    own.write_text('/**:\n  ros__parameters:\n    safety:\n      obstacle_m: 0.1\n')
    shell('bags/markers_node', WAIT)
    show = f'env\necho "$0" "$@"\n{AWAIT_RECORDER}cat "${{last%/*}}/run_info.json" "$last"\n'
    shell(PLANT, show)
    given = {
        'namespace': 'car1',
        'params_file': file,
        'set': 'plant.friction=0.6 recorder.chunk_s=0.25 plant.plant_params=vw_gti.yaml',
        'any_car': 'true',
        'log_level': 'warn',
        'use_sim_time': 'true',
        'autostart': 'false',
        'controller': own,
        'markers': 'true',
    }
    assert launched(**given).wait(PATIENCE_S) == 0, output(tmp_path)
    text = output(tmp_path)
    (command,) = [line for line in text.splitlines() if 'plant_node --ros-args' in line]
    for words in (
        '--log-level warn',
        '__ns:=/car1',
        'use_sim_time:=true -r /clock:=clock',
        'autostart:=false',
    ):
        assert words in command
    noted = json.loads(json.loads(text[text.index('{\n') : text.rindex('}') + 1])['parameters'])
    assert noted['plant']['friction'] == 0.6
    assert noted['plant']['start.speed_mps'] == 12.0
    assert noted['controller']['tolerances.lag_m'] == 0.7
    assert noted['controller']['safety.obstacle_m'] == 0.1
    assert 'OPENBLAS_NUM_THREADS=1' in text
    assert 'ROS_AUTOMATIC_DISCOVERY_RANGE=' in text
    assert (tmp_path / 'runs/straight/brave/metadata.yaml').is_file()
    assert noted['recorder']['chunk_s'] == 0.25
    assert not [name for values in noted.values() for name in values if name == 'use_sim_time']
    assert 'warning, brave: the controller believes that 0% of the drive' in text


def test_without_a_recording_there_is_no_recorder_and_no_node_waits_for_one(
    tmp_path, shell, launched
):
    shell('bags/recorder_node', 'echo recording\n')
    shell(PLANT, 'cat "$last"\n')
    assert launched(record='false').wait(PATIENCE_S) == 0, output(tmp_path)
    assert 'recorders: 0' in output(tmp_path)
    assert 'recording' not in output(tmp_path)
    assert not (tmp_path / 'runs').exists()
