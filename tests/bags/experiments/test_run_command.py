"""`bags run` as a person uses it: interrupted, killed, with a node that fails."""

import os
import signal
import subprocess
import sys
import time

import pytest
from shell_ring import WAIT, left_over

from bags.experiments import folders


@pytest.fixture
def command(tmp_path, prefix):
    """Return the started `bags run` of a ring that would never end."""
    prefix('vehicle_plant/plant_node', 'echo driving\n' + WAIT)
    process = subprocess.Popen(
        [sys.executable, '-m', 'bags.cli', 'run', 'straight', '--out', tmp_path / 'runs'],
        env={**os.environ, 'ROS_DOMAIN_ID': '51'},
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    deadline = time.monotonic() + 60.0
    while not list(tmp_path.glob('runs/straight/.mpcc.*/logs/plant_node.log')):
        assert process.poll() is None, process.stderr.read()
        assert time.monotonic() < deadline
        time.sleep(0.05)
    yield process
    process.kill()
    process.communicate()


def test_ctrl_c_at_the_command_leaves_no_process_and_no_run(tmp_path, command):
    assert len(left_over(tmp_path)) >= 4
    command.send_signal(signal.SIGINT)
    # the impatient press twice
    time.sleep(0.1)
    command.send_signal(signal.SIGINT)
    _, said = command.communicate(timeout=30)
    assert command.returncode == 130
    assert said == 'interrupted: every node was stopped; kept: nothing\n'
    assert left_over(tmp_path) == []
    assert list((tmp_path / 'runs/straight').iterdir()) == []


def test_an_interrupt_says_which_earlier_run_was_kept(tmp_path, prefix):
    # the first plant ends at once, the second one never
    flag = tmp_path / 'flag'
    prefix('vehicle_plant/plant_node', f'[ -e {flag} ] || {{ touch {flag}; exit 0; }}\n{WAIT}')
    command = [sys.executable, '-m', 'bags.cli', 'run', 'straight', '--out', 'runs']
    process = subprocess.Popen(
        [*command, '--controller', 'mpcc', '--controller', 'mpcc_no_ca'],
        cwd=tmp_path,
        env={**os.environ, 'ROS_DOMAIN_ID': '54'},
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    try:
        deadline = time.monotonic() + 60.0
        while not list(tmp_path.glob('runs/straight/.mpcc_no_ca.*/logs/plant_node.log')):
            assert time.monotonic() < deadline
            time.sleep(0.05)
        process.send_signal(signal.SIGINT)
        _, said = process.communicate(timeout=30)
    finally:
        process.kill()
    assert said == 'interrupted: every node was stopped; kept: runs/straight/mpcc\n'
    assert left_over(tmp_path) == []


def test_a_killed_command_takes_its_nodes_with_it_and_the_next_one_names_what_it_left(
    tmp_path, command
):
    assert len(left_over(tmp_path)) >= 4
    command.kill()
    command.communicate(timeout=10)
    deadline = time.monotonic() + 10.0
    while left_over(tmp_path) and time.monotonic() < deadline:
        time.sleep(0.05)
    assert left_over(tmp_path) == []
    (left,) = (tmp_path / 'runs/straight').iterdir()
    (said,) = folders.recover(tmp_path / 'runs/straight')
    assert str(left / 'mpcc') in said


def test_a_failed_node_makes_the_command_fail(tmp_path, prefix):
    prefix('mpcc_controller/mpcc_node', 'echo no solver; exit 4\n')
    done = subprocess.run(
        [sys.executable, '-m', 'bags.cli', 'run', 'straight', '--out', tmp_path / 'runs'],
        env={**os.environ, 'ROS_DOMAIN_ID': '52'},
        capture_output=True,
        text=True,
        timeout=60,
    )
    assert done.returncode == 1
    assert 'mpcc: mpcc_node ended early with exit code 4' in done.stderr
    assert '| no solver' in done.stderr
    assert left_over(tmp_path) == []


def test_without_a_compiler_one_warning_says_what_is_lost(tmp_path, prefix):
    prefix('mpcc_controller/mpcc_node', 'exit 4\n')
    done = subprocess.run(
        [sys.executable, '-m', 'bags.cli', 'run', 'straight', '--out', tmp_path / 'runs'],
        env={**os.environ, 'ROS_DOMAIN_ID': '53', 'PATH': str(tmp_path)},
        capture_output=True,
        text=True,
        timeout=60,
    )
    assert done.stdout.count('no C compiler found') == 1
    assert 'slower' in done.stdout
