"""A run ends well or badly, leaves no process, and never costs an older run.

The nodes are small shell programs, which fail in the way that a test needs.
"""

import json
import os
import time
from pathlib import Path

import pytest
from rich.console import Console
from shell_nodes import AWAIT_RECORDER, NODES, RECORD, WAIT, left_over

from experiments.configuration import inputs, node_config
from experiments.configuration.node_config import LoadedFacts
from experiments.progress import RunProgress
from experiments.run import node_graph
from experiments.run.processes import Interrupt, Interrupted
from node_runtime import provenance
from scenario_publisher import scenario

STRAIGHT = scenario.load('straight')
START = STRAIGHT.start._replace(speed=20.0)
SCN = STRAIGHT._replace(name='somewhere', friction=0.8, start=START)
PLANT, CONTROLLER = 'vehicle_plant/plant_node', 'mpcc_controller/controller_node'
RECORDER = 'bags/recorder_node'
# a recording that is not closed
RECORD_TORN = """out=$(sed -n 's/^ *out: //p' "$last"); mkdir "$out"; touch "$out/mpcc_0.mcap"\n"""
FULL = OSError(28, 'No space left on device')
ENVIRONMENT = {
    *('ROS_DOMAIN_ID=50', 'ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST', 'OPENBLAS_NUM_THREADS=1')
}


@pytest.fixture
def runs(tmp_path):
    """Return the folder of the runs, with one of before in it."""
    bag = tmp_path / 'runs/mpcc'
    bag.mkdir(parents=True)
    (bag / 'metadata.yaml').write_text('old')
    return tmp_path / 'runs'


@pytest.fixture
def drive(tmp_path, prefix, runs):
    """Return drive(): one run with the MPCC, after which no process is left."""

    def drive(time_limit_s=60.0, label='', overwrite=False, plant=()):
        settings = node_graph.RunSettings(
            SCN, 'lockstep', runs, time_limit_s, 50, overwrite=overwrite
        )
        (chosen,) = node_config.find_controllers(['mpcc'], [label] if label else [])
        nodes = inputs.build_nodes(SCN, 'straight', chosen, plant_program=plant)
        run = chosen, nodes, LoadedFacts({})
        try:
            with Interrupt() as interrupt, RunProgress(Console(quiet=True)) as progress:
                progress.begin('mpcc', 60.0)
                return node_graph.run_once(settings, *run, interrupt, progress)
        finally:
            assert left_over(tmp_path) == {}

    return drive


def hidden(folder):
    return [path.name for path in folder.iterdir() if path.name.startswith('.')]


def raise_full(*how, **named):
    raise FULL


def is_unchanged(runs):
    return (runs / 'mpcc/metadata.yaml').read_text() == 'old'


def test_a_completed_run_is_kept_with_logs_and_the_older_one_under_a_number(runs, drive, prefix):
    prefix(PLANT, f'env; cat "$3"\n{NODES[PLANT]}')
    prefix(CONTROLLER, f'cat "$3" "$5"\n{WAIT}')
    outcome = drive()
    bag, older = runs / 'mpcc', runs / 'mpcc@1'
    assert outcome == node_graph.RunOutcome('mpcc', True, 'finish line crossed', bag, older)
    assert (older / 'metadata.yaml').read_text() == 'old'
    assert (bag / 'metadata.yaml').read_text() == ''
    assert hidden(runs) == []
    # each node had the domain and the parameters of the scenario
    for name, lines in (
        ('plant_node.log', ENVIRONMENT | {'friction: 0.8', 'stop.x_m: 60.0', 'mode: lockstep'}),
        ('controller_node.log', {'circle_radius_m', 'model.friction: 0.8'}),
        ('run_info.json', {'somewhere'}),
    ):
        text = (bag / 'logs' / name).read_text()
        assert {line for line in lines if line not in text} == set()


@pytest.mark.parametrize('code', [2, 3])
def test_a_run_that_is_not_completed_is_kept_and_reported(drive, prefix, code):
    prefix(PLANT, f'echo the car stands still; sleep 0.2; exit {code}\n')
    outcome = drive()
    assert (outcome.completed, outcome.message) == (False, 'the car stands still')
    assert outcome.bag.is_dir()


DIES = 'echo getting ready; echo "cannot go on: no road" >&2; exit 9\n'
NOT_CLOSED = RECORD.replace('mkdir -p "$out"; touch "$out/metadata.yaml"; exit 0', 'exit 1')
HINT = "No space left on device; 'bags repair $out' makes a complete bag of it"
TORN = f'{RECORD_TORN}echo "{HINT}"\nexit 1\n'


@pytest.mark.parametrize(
    ('node', 'script', 'plant', 'said'),
    [
        (PLANT, DIES, DIES, ('plant_node ended early with exit code 9', '| cannot go on: no road')),
        (CONTROLLER, DIES, WAIT, ('controller_node ended early with exit code 9', '| cannot go')),
        (RECORDER, NOT_CLOSED, NODES[PLANT], ('the bag was not closed: ',)),
        (RECORDER, TORN, WAIT, ("'bags repair {}/mpcc' makes", 'closed: `bags repair {}/mpcc`')),
    ],
    ids=['the plant dies', 'a node dies', 'the bag is not closed', 'the disk is full'],
)
def test_a_run_that_fails_says_why_and_keeps_its_files_and_the_older_run(
    runs, drive, prefix, node, script, plant, said
):
    prefix(PLANT, plant)
    prefix(node, script)
    outcome, failed = drive(), runs / 'mpcc.failed'
    assert (outcome.completed, outcome.bag) == (False, None)
    for part in (*said, 'logs: {}/logs'):
        assert part.format(failed) in outcome.message
    assert (failed / f'logs/{Path(node).name}.log').is_file()
    assert (failed / 'mpcc/mpcc_0.mcap').exists() == (script is TORN)
    assert is_unchanged(runs)
    assert hidden(runs) == []


@pytest.fixture
def own_plant(tmp_path):
    """Return make(text): the command of a shell program that is a plant."""

    def make(text):
        path = tmp_path / 'my_car'
        path.write_text(f'#!/bin/sh\nfor last; do :; done\n{text}')
        path.chmod(0o755)
        return node_config.find_plant(str(path))

    return make


def test_a_plant_of_the_user_gets_the_parameters_and_is_recorded(drive, own_plant):
    outcome = drive(plant=own_plant(f'{AWAIT_RECORDER}cat "$last"'))
    assert outcome.completed
    info = json.loads((outcome.bag / 'logs/run_info.json').read_text())
    noted = json.loads(info['parameters'])['plant']
    assert noted['program'].endswith('my_car')
    assert (noted['friction'], noted['stop.x_m'], noted['car.outline.width_m']) == (0.8, 60.0, 1.85)
    assert not any(name.startswith(('car.tyre', 'car.actuators')) for name in noted)
    assert 'start.speed_mps: 20.0' in (outcome.bag / 'logs/my_car.log').read_text()


def test_a_run_ends_at_its_limit_and_says_what_a_plant_of_the_user_has_to_send(drive, own_plant):
    begin = time.monotonic()
    outcome = drive(time_limit_s=1.0, plant=own_plant(f'echo thinking; {WAIT}'))
    assert 1.0 <= time.monotonic() - begin < 30.0
    assert outcome.completed is False
    for part in (
        'longer than 1 s of wall time, and no state of the car was recorded',
        'a plant sends /vehicle/odometry, in lockstep /clock',
        'my_car: thinking',
    ):
        assert part in outcome.message


def test_a_run_with_a_label_has_a_folder_of_its_own(runs, drive):
    outcome = drive(label='soft')
    assert (outcome.controller, outcome.bag) == ('mpcc@soft', runs / 'mpcc@soft')
    assert is_unchanged(runs)
    info = json.loads((outcome.bag / 'logs/run_info.json').read_text())
    assert (info['controller'], provenance.run_name(info)) == ('mpcc', 'mpcc@soft')


@pytest.mark.parametrize(
    ('commits', 'overwrite', 'older'),
    [
        (('abc', 'abc'), False, None),
        (('abc-dirty', 'abc-dirty'), False, 'mpcc@2'),
        (('', ''), False, 'mpcc@2'),
        (('abc', 'def'), False, 'mpcc@2'),
        (('abc', 'def'), True, None),
    ],
)
def test_a_run_that_repeats_the_older_one_replaces_it(
    runs, drive, monkeypatch, commits, overwrite, older
):
    outcomes = []
    for commit in commits:
        monkeypatch.setattr(node_graph.node_config.provenance, 'commit', lambda c=commit: c)
        outcomes.append(drive(overwrite=overwrite and bool(outcomes)))
    assert outcomes[0].older == runs / 'mpcc@1'
    assert outcomes[1].older == (runs / older if older else None)
    assert (runs / 'mpcc@2').exists() == bool(older)
    assert outcomes[1].has_replaced == (older is None)


def test_an_unexpected_error_is_the_outcome_of_its_run_and_keeps_the_recording(
    runs, drive, prefix, monkeypatch
):
    def fail_once_recording(reader):
        if (reader.folder.parent / 'logs/recording').exists():
            raise ZeroDivisionError('no such speed')

    prefix(PLANT, WAIT)
    monkeypatch.setattr(node_graph.PositionReader, 'poll', fail_once_recording)
    outcome, failed = drive(), runs / 'mpcc.failed'
    assert (outcome.completed, outcome.bag) == (False, None)
    assert outcome.message.startswith('ZeroDivisionError: no such speed\n')
    assert f'recorded until then: {failed}/mpcc\n' in outcome.message
    assert (failed / 'mpcc/metadata.yaml').is_file()
    assert 'fail_once_recording' in (failed / 'logs' / node_graph.TRACEBACK).read_text()


def test_a_full_disk_is_the_outcome_of_its_run_and_leaves_nothing_hidden(runs, drive, monkeypatch):
    monkeypatch.setattr(Path, 'write_text', raise_full)
    outcome = drive()
    assert (outcome.completed, outcome.bag) == (False, None)
    assert 'No space left on device' in outcome.message
    assert f'logs: {runs}/mpcc.failed/logs' in outcome.message
    assert hidden(runs) == []
    monkeypatch.setattr(node_graph.StagingDirectory, '__init__', raise_full)
    outcome = drive()
    assert (outcome.completed, outcome.bag) == (False, None)
    assert outcome.message == 'no folder for the run: [Errno 28] No space left on device'


def test_a_run_that_cannot_be_moved_at_all_says_where_it_was_left(runs, drive, refuse_moves):
    refuse_moves(lambda path: 'mpcc' in path.name)
    outcome = drive()
    (left,) = hidden(runs)
    assert f'left in {runs / left}: ' in outcome.message
    assert f'recorded until then: {runs / left}/mpcc\n' in outcome.message
    assert (runs / left / 'mpcc/metadata.yaml').is_file()
    assert is_unchanged(runs)


@pytest.mark.parametrize(
    ('recorder', 'may_move', 'kept', 'file'),
    [
        pytest.param(NODES[RECORDER], False, '.mpcc.*', 'mpcc/metadata.yaml', id='cannot move'),
        pytest.param(
            f'{RECORD_TORN}touch "${{last%/*}}/recording"\n{WAIT}',
            True,
            'mpcc.failed/mpcc',
            'mpcc_0.mcap',
            id='not closed',
        ),
    ],
)
def test_a_signal_keeps_what_there_is(
    runs, drive, prefix, refuse_moves, recorder, may_move, kept, file
):
    """A bag that is closed, and nothing at all: test_run_command.py."""
    prefix(RECORDER, recorder)
    prefix(PLANT, f'{AWAIT_RECORDER}kill -INT $PPID\n{WAIT}')
    refuse_moves(lambda path: path.name == 'mpcc' and not may_move)
    with pytest.raises(Interrupted) as interrupted:
        drive()
    assert [interrupted.value.kept] == [*runs.glob(kept)]
    assert is_unchanged(runs)
    assert (interrupted.value.kept / file).is_file()


def test_on_the_wall_clock_plant_and_controller_have_a_core_each(monkeypatch):
    monkeypatch.setattr(os, 'sched_getaffinity', lambda pid: {3, 5, 7})
    assert node_graph._cores('realtime') == {'plant': {3}, 'controller': {5}}
    assert node_graph._cores('lockstep') == {}
    monkeypatch.setattr(os, 'sched_getaffinity', lambda pid: {3})
    assert node_graph._cores('realtime') == {}
