"""`experiments run` as a person uses it: interrupted, killed, with a node that fails."""

import contextlib
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from shell_nodes import AWAIT_RECORDER, WAIT, left_over
from wait_until import wait_until

from bags.storage import read
from experiments.run import staging

RUN = (sys.executable, '-m', 'experiments.cli', 'run', 'straight')


def started(folder, process):
    """Tell whether the plant of the first run has been started and writes to its log."""
    assert process.poll() is None, process.stderr.read()
    logs = folder.glob('runs/straight/.mpcc.*/logs/plant_node.log')
    return any(log.read_text() for log in logs)


@pytest.fixture
def command(tmp_path, prefix):
    """Return the started `experiments run` of nodes that would never end."""
    prefix('vehicle_plant/plant_node', f'{AWAIT_RECORDER}echo driving\n{WAIT}')
    process = subprocess.Popen(
        [*RUN, '--out', tmp_path / 'runs'],
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    wait_until(lambda: started(tmp_path, process), 60.0, 'the plant was not started')
    yield process
    process.kill()
    process.communicate()


@pytest.mark.parametrize(
    ('number', 'code'), [(signal.SIGINT, 130), (signal.SIGTERM, 143), (signal.SIGHUP, 129)]
)
def test_a_signal_at_the_command_leaves_no_process_and_keeps_the_recording(
    tmp_path, command, number, code
):
    command.send_signal(number)
    # the impatient press twice
    time.sleep(0.1)
    command.send_signal(number)
    _, stderr = command.communicate(timeout=240)
    assert command.returncode == code
    kept = tmp_path / 'runs/straight/mpcc.interrupted'
    assert stderr == f'interrupted: every node was stopped; kept: {os.path.relpath(kept)}\n'
    assert (kept / 'metadata.yaml').is_file()
    assert left_over(tmp_path) == []
    assert list((tmp_path / 'runs/straight').iterdir()) == [kept]


def test_a_hang_up_that_is_ignored_does_not_end_a_run_under_nohup(tmp_path, prefix):
    release = tmp_path / 'release'
    wait = f'until [ -e {release} ]; do sleep 0.05; done\n'
    prefix('vehicle_plant/plant_node', f'{AWAIT_RECORDER}echo driving\n{wait}exit 2\n')
    command = ['nohup', *RUN]
    process = subprocess.Popen(
        [*command, '--out', tmp_path / 'runs'],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    try:
        wait_until(lambda: started(tmp_path, process), 60.0, 'the plant was not started')
        process.send_signal(signal.SIGHUP)
        release.touch()
        process.communicate(timeout=240)
    finally:
        process.kill()
        process.communicate()
    # the comparison fails: these nodes record nothing
    assert process.returncode == 1
    assert (tmp_path / 'runs/straight/mpcc/metadata.yaml').is_file()
    assert not (tmp_path / 'runs/straight/mpcc.interrupted').exists()


def test_an_interrupt_before_anything_was_recorded_leaves_no_folder(tmp_path, prefix):
    prefix('vehicle_plant/plant_node', WAIT)
    prefix('bags/recorder_node', f'kill -INT $PPID\n{WAIT}')
    done = subprocess.run(
        [
            *RUN,
            '--out',
            tmp_path / 'new/runs',
        ],
        capture_output=True,
        text=True,
        timeout=240,
    )
    assert done.returncode == 130
    assert done.stderr == 'interrupted: every node was stopped; kept: nothing\n'
    assert not (tmp_path / 'new').exists()


def test_an_interrupt_says_which_earlier_run_was_kept(tmp_path, prefix):
    # the first plant ends at once, the second one never
    flag = tmp_path / 'flag'
    once = f'[ -e {flag} ] || {{ touch {flag}; exit 0; }}\n'
    prefix('vehicle_plant/plant_node', AWAIT_RECORDER + once + WAIT)
    command = [*RUN, '--out', 'runs']
    process = subprocess.Popen(
        [*command, '--controller', 'mpcc', '--controller', 'mpcc_no_ca'],
        cwd=tmp_path,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    try:
        recording = 'runs/straight/.mpcc_no_ca.*/logs/recording'
        wait_until(lambda: list(tmp_path.glob(recording)), 60.0, 'the second run records nothing')
        process.send_signal(signal.SIGINT)
        _, stderr = process.communicate(timeout=240)
    finally:
        process.kill()
    kept = 'runs/straight/mpcc, runs/straight/mpcc_no_ca.interrupted'
    assert stderr == f'interrupted: every node was stopped; kept: {kept}\n'
    assert left_over(tmp_path) == []


def test_a_killed_command_takes_its_nodes_with_it_and_the_next_one_names_the_remains(
    tmp_path, command
):
    wait_until(lambda: len(left_over(tmp_path)) >= 4, 60.0, 'not every node was started')
    command.kill()
    command.communicate(timeout=240)
    wait_until(lambda: not left_over(tmp_path), 30.0, lambda: f'left: {left_over(tmp_path)}')
    (left,) = (tmp_path / 'runs/straight').iterdir()
    (line,) = staging.recover(tmp_path / 'runs/straight')
    assert str(left / 'mpcc') in line


def test_a_failed_node_makes_the_command_fail(tmp_path, prefix):
    prefix('mpcc_controller/controller_node', 'echo no solver; exit 4\n')
    done = subprocess.run(
        [*RUN, '--out', tmp_path / 'runs'],
        capture_output=True,
        text=True,
        timeout=240,
    )
    assert done.returncode == 1
    assert 'mpcc: controller_node ended early with exit code 4' in done.stderr
    assert '| no solver' in done.stderr
    assert left_over(tmp_path) == []


def recorded_bytes(folder):
    return sum(file.stat().st_size for file in folder.glob('.mpcc.*/mpcc/*.mcap'))


def kill_the_controller(command):
    """End the controller that this command has started."""
    for process in Path('/proc').glob('[0-9]*'):
        with contextlib.suppress(OSError):
            parent = (process / 'stat').read_text().rpartition(')')[2].split()[1]
            if (
                int(parent) == command.pid
                and b'controller_node' in (process / 'cmdline').read_bytes()
            ):
                os.kill(int(process.name), signal.SIGKILL)


def terminate(command):
    command.send_signal(signal.SIGTERM)


@pytest.mark.usefixtures('dds')
@pytest.mark.parametrize(
    ('end', 'code', 'kept'),
    [(kill_the_controller, 1, 'mpcc.failed/mpcc'), (terminate, 143, 'mpcc.interrupted')],
)
def test_a_real_run_that_is_ended_leaves_a_closed_bag_with_its_recording(tmp_path, end, code, kept):
    folder = tmp_path / 'double_lane_change'
    command = subprocess.Popen(
        [sys.executable, '-m', 'experiments.cli', 'run', 'double_lane_change', '--out', tmp_path],
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    try:
        # what is there before the first message does not count
        while recorded_bytes(folder) < 100_000:
            assert command.poll() is None, command.stderr.read()
            time.sleep(0.05)
        end(command)
        _, stderr = command.communicate(timeout=240)
    finally:
        command.kill()
    assert command.returncode == code, stderr
    assert kept in stderr
    bag = read.load(folder / kept)
    assert (folder / kept / 'metadata.yaml').is_file()
    assert bag.damage is None
    assert bag.recordings['/controller/command'].payloads
    assert not list(folder.glob('.mpcc.*'))
