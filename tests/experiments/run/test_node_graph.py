"""A run ends well or badly, leaves no process, and never costs an older run.

The nodes are small shell programs where a test needs them to fail in a certain way.
"""

import json
import os
import time
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console
from shell_nodes import AWAIT_RECORDER, NODES, WAIT, left_over

from bags.errors import BagError
from experiments.configuration import node_config
from experiments.configuration.node_config import LoadedFacts
from experiments.progress import RunProgress
from experiments.run import node_graph
from experiments.run.interrupt import SIGNALS, Interrupt, Interrupted
from node_runtime import provenance

FACTS = node_config.ScenarioFacts(
    name='somewhere',
    text='schema: 1\n',
    source='somewhere',
    friction=0.8,
    start={'x_m': 1.0, 'y_m': 2.0, 'yaw_rad': 0.0, 'speed_mps': 20.0},
    stop={'x_m': 99.0, 'y_m': 0.0, 'yaw_rad': 0.0, 'armed_after_m': 9.0, 'time_s': 20.0},
    patches={'corners_m': (), 'friction': ()},
    path=np.array([[0.0, 0.0], [120.0, 0.0]]),
    length_m=99.0,
)


@pytest.fixture
def drive(tmp_path, prefix):
    """Return drive(): one run with the MPCC in tmp_path/runs."""

    def drive(time_limit_s=60.0, label='', overwrite=False, plant=()):
        settings = node_graph.RunSettings(
            'lockstep', tmp_path / 'runs', {}, 50, time_limit_s, overwrite=overwrite, plant=plant
        )
        (chosen,) = node_config.find_controllers(['mpcc'], [label] if label else [])
        with Interrupt() as interrupt, RunProgress(Console(quiet=True)) as progress:
            progress.begin('mpcc', FACTS.length_m)
            return node_graph.run_once(
                FACTS, chosen, LoadedFacts({}), settings, interrupt, progress
            )

    return drive


@pytest.fixture
def old_bag(tmp_path):
    bag = tmp_path / 'runs/mpcc'
    bag.mkdir(parents=True)
    (bag / 'metadata.yaml').write_text('old')
    return bag


# a recording that is not closed
RECORD_TORN = """out=$(sed -n 's/^ *out: //p' "$last"); mkdir "$out"; touch "$out/mpcc_0.mcap"\n"""


def hidden(folder):
    return [path.name for path in folder.iterdir() if path.name.startswith('.')]


def test_a_completed_run_is_kept_with_the_logs_of_the_nodes(tmp_path, drive, old_bag):
    outcome = drive()
    older = tmp_path / 'runs/mpcc@1'
    assert outcome == node_graph.RunOutcome('mpcc', True, 'finish line crossed', old_bag, older)
    assert (older / 'metadata.yaml').read_text() == 'old'
    assert (old_bag / 'metadata.yaml').read_text() == ''
    assert 'finish line crossed' in (old_bag / 'logs/plant_node.log').read_text()
    assert 'somewhere' in (old_bag / 'logs/run_info.json').read_text()
    assert hidden(tmp_path / 'runs') == []
    assert left_over(tmp_path) == []


@pytest.mark.parametrize('code', [2, 3])
def test_a_run_that_is_not_completed_is_kept_and_reported(drive, prefix, code):
    prefix('vehicle_plant/plant_node', f'echo the car stands still; sleep 0.2; exit {code}\n')
    outcome = drive()
    assert outcome.completed is False
    assert outcome.message == 'the car stands still'
    assert outcome.bag.is_dir()


@pytest.mark.parametrize('node', NODES)
def test_a_node_that_dies_is_named_with_its_last_output(tmp_path, drive, prefix, old_bag, node):
    prefix(node, 'echo getting ready; echo "cannot go on: no road" >&2; exit 9\n')
    outcome = drive()
    assert outcome.completed is False
    assert outcome.bag is None
    assert f'{Path(node).name} ended early with exit code 9' in outcome.message
    assert '| cannot go on: no road' in outcome.message
    assert (old_bag / 'metadata.yaml').read_text() == 'old'
    assert (tmp_path / 'runs/mpcc.failed/logs' / f'{Path(node).name}.log').is_file()
    for line in outcome.message.splitlines()[-2:]:
        if 'nothing was recorded' not in line:
            assert Path(line.partition(': ')[2]).is_dir(), line
    assert hidden(tmp_path / 'runs') == []
    assert left_over(tmp_path) == []


@pytest.fixture
def own_plant(tmp_path):
    """Return make(text): the command of a shell program that is a plant."""

    def make(text):
        path = tmp_path / 'my_car'
        path.write_text(f'#!/bin/sh\n{text}')
        path.chmod(0o755)
        return node_config.find_plant(str(path))

    return make


def test_a_plant_of_the_user_gets_the_parameters_and_is_recorded(drive, own_plant):
    recorded = 'until ls "${6%/*}"/recording; do sleep 0.05; done 2> /dev/null\n'
    outcome = drive(
        plant=own_plant(f'for last; do :; done; set - 1 2 3 4 5 "$last"; {recorded}cat "$6"')
    )
    assert outcome.completed
    info = json.loads((outcome.bag / 'logs/run_info.json').read_text())
    noted = json.loads(info['parameters'])['plant']
    assert noted['program'].endswith('my_car')
    assert (noted['friction'], noted['stop.x_m'], noted['car.outline.width_m']) == (0.8, 99.0, 1.85)
    assert not any(name.startswith(('car.tyre', 'car.actuators')) for name in noted)
    told = (outcome.bag / 'logs/my_car.log').read_text()
    assert 'start.speed_mps: 20.0' in told


def test_a_plant_of_the_user_that_ends_early_is_named_with_its_last_output(drive, own_plant):
    outcome = drive(plant=own_plant('echo "no car here" >&2; exit 7'))
    assert not outcome.completed
    assert 'my_car ended early with exit code 7:\n  | no car here' in outcome.message


def test_a_plant_that_sends_nothing_is_told_from_one_that_takes_long(drive, own_plant):
    outcome = drive(time_limit_s=1.0, plant=own_plant(f'echo thinking; {WAIT}'))
    assert not outcome.completed
    assert 'longer than 1 s of wall time, and no state of the car was recorded' in outcome.message
    assert 'a plant sends /vehicle/odometry, in lockstep /clock' in outcome.message
    assert 'my_car: thinking' in outcome.message


@pytest.mark.parametrize(
    ('path', 'said'),
    [('no_car.py', 'there is no such file'), ('notes.txt', 'neither a Python file nor a program')],
)
def test_what_is_no_plant_is_refused(tmp_path, monkeypatch, path, said):
    monkeypatch.chdir(tmp_path)
    (tmp_path / 'notes.txt').write_text('car')
    with pytest.raises(BagError, match=f'--plant {path}: .*{said}'):
        node_config.find_plant(path)


def commits(monkeypatch, text):
    monkeypatch.setattr(node_graph.node_config.provenance, 'commit', lambda: text)


def test_a_run_with_a_label_has_a_folder_of_its_own(tmp_path, drive, old_bag):
    outcome = drive(label='soft')
    assert (outcome.controller, outcome.bag) == ('mpcc@soft', tmp_path / 'runs/mpcc@soft')
    assert (old_bag / 'metadata.yaml').read_text() == 'old'
    info = json.loads((outcome.bag / 'logs/run_info.json').read_text())
    assert (info['controller'], provenance.run_name(info)) == ('mpcc', 'mpcc@soft')


@pytest.mark.parametrize(('commit', 'kept'), [('abc', False), ('abc-dirty', True), ('', True)])
def test_a_run_that_repeats_the_older_one_replaces_it(tmp_path, drive, monkeypatch, commit, kept):
    commits(monkeypatch, commit)
    drive()
    assert (drive().older is not None) == kept
    assert (tmp_path / 'runs/mpcc@1').exists() == kept


def test_a_run_of_another_commit_keeps_the_older_one(tmp_path, drive, monkeypatch):
    commits(monkeypatch, 'abc')
    drive()
    commits(monkeypatch, 'def')
    assert drive().older == tmp_path / 'runs/mpcc@1'
    assert drive(overwrite=True).older is None


def test_a_bag_that_is_not_closed_replaces_nothing(drive, prefix, old_bag):
    ready = 'touch "${last%/*}/recording"; while :; do sleep 0.05; done\n'
    prefix('bags/recorder_node', f'trap "echo disk full; exit 1" INT; {ready}')
    outcome = drive()
    assert outcome.bag is None
    assert 'the bag was not closed' in outcome.message
    assert 'disk full' in outcome.message
    assert (old_bag / 'metadata.yaml').read_text() == 'old'


def test_a_run_never_takes_longer_than_its_limit(tmp_path, drive, prefix):
    prefix('vehicle_plant/plant_node', 'echo waiting for a command\n' + WAIT)
    begin = time.monotonic()
    outcome = drive(time_limit_s=1.0)
    assert time.monotonic() - begin < 10.0
    assert outcome.completed is False
    assert 'longer than 1 s of wall time' in outcome.message
    assert 'plant_node: waiting for a command' in outcome.message
    assert left_over(tmp_path) == []


def test_a_node_that_dies_leaves_a_closed_recording(tmp_path, drive, prefix):
    # its own parameter file is the second one
    prefix('mpcc_controller/controller_node', f'shift 2\n{AWAIT_RECORDER}exit 9\n')
    prefix('vehicle_plant/plant_node', WAIT)
    outcome = drive()
    recording = tmp_path / 'runs/mpcc.failed/mpcc'
    assert f'recorded until then: {recording}\n' in outcome.message
    assert (recording / 'metadata.yaml').is_file()


def test_the_hint_of_a_full_disk_names_the_recording_where_it_is_at_the_end(
    tmp_path, drive, prefix
):
    hint = "No space left on device; 'bags repair $out' makes a complete bag of it"
    prefix('bags/recorder_node', f'{RECORD_TORN}echo "{hint}"\nexit 1\n')
    prefix('vehicle_plant/plant_node', WAIT)
    outcome = drive()
    recording = tmp_path / 'runs/mpcc.failed/mpcc'
    assert f"'bags repair {recording}' makes" in outcome.message
    assert f'not closed: `bags repair {recording}` completes it' in outcome.message
    assert (recording / 'mpcc_0.mcap').is_file()
    assert '/.mpcc.' not in outcome.message


def kept_as_failed(tmp_path, outcome, error):
    """Check that a run failed with an error and that its bag is whole; return its folder."""
    failed = tmp_path / 'runs/mpcc.failed'
    assert (outcome.completed, outcome.bag) == (False, None)
    assert outcome.message.startswith(error)
    assert f'recorded until then: {failed}/mpcc\n' in outcome.message
    assert (failed / 'mpcc/metadata.yaml').is_file()
    return failed


def fail_once_recording(reader):
    """Stand for an error that nobody expects while a run is watched."""
    if (reader.folder.parent / 'logs/recording').exists():
        raise ZeroDivisionError('no such speed')


def test_an_unexpected_error_is_the_outcome_of_its_run_and_keeps_the_recording(
    tmp_path, drive, prefix, monkeypatch
):
    prefix('vehicle_plant/plant_node', WAIT)
    monkeypatch.setattr(node_graph.PositionReader, 'poll', fail_once_recording)
    outcome = drive()
    failed = kept_as_failed(tmp_path, outcome, 'ZeroDivisionError: no such speed\n')
    assert 'fail_once_recording' in (failed / 'logs' / node_graph.TRACEBACK).read_text()
    assert left_over(tmp_path) == []


def full_disk(path, text, *how, **named):
    """Stand for Path.write_text on a disk that is full."""
    raise OSError(28, 'No space left on device', str(path))


def test_a_full_disk_is_the_outcome_of_its_run_and_leaves_nothing_hidden(
    tmp_path, drive, monkeypatch
):
    monkeypatch.setattr(Path, 'write_text', full_disk)
    outcome = drive()
    assert (outcome.completed, outcome.bag) == (False, None)
    assert 'No space left on device' in outcome.message
    assert f'logs: {tmp_path}/runs/mpcc.failed/logs' in outcome.message
    assert hidden(tmp_path / 'runs') == []


def test_a_run_that_cannot_replace_the_older_one_is_kept_as_failed(
    tmp_path, drive, old_bag, refuse_moves
):
    refuse_moves(lambda path: path.name == 'mpcc')
    outcome = drive()
    failed = kept_as_failed(tmp_path, outcome, 'PermissionError: ')
    assert 'finish line crossed' in (failed / 'logs/plant_node.log').read_text()
    assert (failed / 'logs' / node_graph.TRACEBACK).is_file()
    assert (old_bag / 'metadata.yaml').read_text() == 'old'


def test_a_run_that_cannot_be_moved_at_all_says_where_it_was_left(
    tmp_path, drive, old_bag, refuse_moves
):
    refuse_moves(lambda path: 'mpcc' in path.name)
    outcome = drive()
    (left,) = hidden(tmp_path / 'runs')
    folder = tmp_path / 'runs' / left
    assert f'left in {folder}: ' in outcome.message
    assert f'recorded until then: {folder}/mpcc\n' in outcome.message
    assert (folder / 'mpcc/metadata.yaml').is_file()
    assert (old_bag / 'metadata.yaml').read_text() == 'old'


def test_a_run_without_a_folder_is_an_outcome_too(drive, monkeypatch):
    def full(*how, **named):
        raise OSError(28, 'No space left on device')

    monkeypatch.setattr(node_graph.StagingDirectory, '__init__', full)
    outcome = drive()
    assert (outcome.completed, outcome.bag) == (False, None)
    assert outcome.message == 'no folder for the run: [Errno 28] No space left on device'


def test_a_signal_ends_a_run_whose_recording_cannot_be_moved(tmp_path, drive, prefix, refuse_moves):
    prefix('vehicle_plant/plant_node', f'{AWAIT_RECORDER}kill -INT $PPID\n{WAIT}')
    refuse_moves(lambda path: path.name == 'mpcc')
    with pytest.raises(Interrupted) as interrupted:
        drive()
    (left,) = hidden(tmp_path / 'runs')
    assert interrupted.value.kept == tmp_path / 'runs' / left
    assert (interrupted.value.kept / 'mpcc/metadata.yaml').is_file()


@pytest.mark.parametrize('number', SIGNALS)
def test_a_signal_ends_every_node_and_keeps_the_recording(tmp_path, drive, prefix, old_bag, number):
    # from a node: by then somebody listens for signals, however slow the machine is
    prefix('vehicle_plant/plant_node', f'{AWAIT_RECORDER}kill -{number:d} $PPID\n{WAIT}')
    with pytest.raises(Interrupted) as interrupted:
        drive()
    assert interrupted.value.exit_code == 128 + number
    kept = tmp_path / 'runs/mpcc.interrupted'
    assert interrupted.value.kept == kept
    assert (kept / 'metadata.yaml').is_file()
    assert (kept / 'logs/plant_node.log').is_file()
    assert (old_bag / 'metadata.yaml').read_text() == 'old'
    assert sorted(path.name for path in (tmp_path / 'runs').iterdir()) == ['mpcc', kept.name]
    assert left_over(tmp_path) == []


def test_a_signal_keeps_a_recording_that_was_not_closed_as_failed(tmp_path, drive, prefix):
    prefix('bags/recorder_node', f'{RECORD_TORN}touch "${{last%/*}}/recording"\n{WAIT}')
    prefix('vehicle_plant/plant_node', f'{AWAIT_RECORDER}kill -INT $PPID\n{WAIT}')
    with pytest.raises(Interrupted) as interrupted:
        drive()
    assert interrupted.value.kept == tmp_path / 'runs/mpcc.failed/mpcc'
    assert (interrupted.value.kept / 'mpcc_0.mcap').is_file()


def test_a_signal_before_anything_was_recorded_leaves_nothing(tmp_path, drive, prefix):
    prefix('bags/recorder_node', f'kill -INT $PPID\n{WAIT}')
    prefix('vehicle_plant/plant_node', WAIT)
    with pytest.raises(Interrupted) as interrupted:
        drive()
    assert interrupted.value.kept is None
    assert list((tmp_path / 'runs').iterdir()) == []


def test_each_node_gets_the_domain_and_the_parameters_of_the_scenario(drive, prefix):
    prefix('vehicle_plant/plant_node', 'env; cat "$3"; exit 0\n')
    prefix('mpcc_controller/controller_node', 'cat "$3" "$5"\n' + WAIT)
    bag = drive().bag
    plant = (bag / 'logs/plant_node.log').read_text()
    for line in (
        'ROS_DOMAIN_ID=50',
        'ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST',
        'OPENBLAS_NUM_THREADS=1',
        'friction: 0.8',
        'start.speed_mps: 20.0',
        'stop.x_m: 99.0',
        'recorders: 1',
        'mode: lockstep',
    ):
        assert line in plant
    controller = (bag / 'logs/controller_node.log').read_text()
    assert 'circle_radius_m' in controller
    assert 'model.friction: 0.8' in controller


def test_on_the_wall_clock_plant_and_controller_have_a_core_each(monkeypatch):
    monkeypatch.setattr(os, 'sched_getaffinity', lambda pid: {3, 5, 7})
    assert node_graph._cores('realtime') == {'plant': {3}, 'controller': {5}}
    assert node_graph._cores('lockstep') == {}
    monkeypatch.setattr(os, 'sched_getaffinity', lambda pid: {3})
    assert node_graph._cores('realtime') == {}
