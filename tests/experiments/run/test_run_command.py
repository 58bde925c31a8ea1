"""`experiments run` as a person uses it: interrupted, killed, with a node that fails."""

import io
import signal
import sys
import time
from subprocess import PIPE

import pytest
from rich.console import Console
from shell_nodes import AWAIT_RECORDER, WAIT, left_over
from wait_until import wait_until

from experiments.run import run_and_compare, staging

EXPERIMENTS = (sys.executable, '-m', 'experiments.cli')
PLANT = 'vehicle_plant/plant_node'


@pytest.fixture
def start(tmp_path, popen):
    """Return start(word, ...): `experiments run` as a process."""
    command = (*EXPERIMENTS, 'run', '--out', 'runs')
    return lambda *words, **more: popen(*command, *words, cwd=tmp_path, stderr=PIPE, **more)


@pytest.fixture
def command(tmp_path, prefix, start):
    """Return the started `experiments run` of nodes that would never end."""
    prefix(PLANT, f'{AWAIT_RECORDER}echo driving\n{WAIT}')
    process = start('straight')

    def is_driving():
        assert process.poll() is None, process.stderr.read()
        logs = tmp_path.glob('runs/straight/.mpcc.*/logs/plant_node.log')
        return any(log.read_text() for log in logs)

    wait_until(is_driving, 60.0, 'the plant was not started')
    return process


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
    assert stderr == 'interrupted: every node was stopped; kept: runs/straight/mpcc.interrupted\n'
    assert (kept / 'metadata.yaml').is_file()
    assert left_over(tmp_path) == {}
    assert list((tmp_path / 'runs/straight').iterdir()) == [kept]


def test_under_nohup_a_hangup_does_not_end_the_run(tmp_path, prefix, start):
    prefix(PLANT, f'{AWAIT_RECORDER}kill -HUP $PPID\nsleep 0.5\nexit 0\n')
    process = start('straight', preexec_fn=lambda: signal.signal(signal.SIGHUP, signal.SIG_IGN))
    process.communicate(timeout=240)
    # the comparison fails: these nodes record nothing
    assert process.returncode == 1
    assert (tmp_path / 'runs/straight/mpcc/metadata.yaml').is_file()
    assert not (tmp_path / 'runs/straight/mpcc.interrupted').exists()


def test_an_interrupt_before_anything_was_recorded_leaves_no_folder(tmp_path, prefix, start):
    prefix(PLANT, WAIT)
    prefix('bags/recorder_node', f'kill -INT $PPID\n{WAIT}')
    process = start('straight')
    _, stderr = process.communicate(timeout=240)
    assert process.returncode == 130
    assert stderr == 'interrupted: every node was stopped; kept: nothing\n'
    assert not (tmp_path / 'runs').exists()


def test_an_interrupt_says_which_earlier_run_was_kept(tmp_path, prefix, start):
    # the first plant ends at once, the second one interrupts the command
    flag = tmp_path / 'flag'
    once = f'[ -e {flag} ] || {{ touch {flag}; exit 0; }}\nkill -INT $PPID\n'
    prefix(PLANT, AWAIT_RECORDER + once + WAIT)
    process = start('straight', '--controller', 'mpcc', '--controller', 'mpcc_no_ca')
    _, stderr = process.communicate(timeout=240)
    kept = 'runs/straight/mpcc, runs/straight/mpcc_no_ca.interrupted'
    assert stderr == f'interrupted: every node was stopped; kept: {kept}\n'
    assert left_over(tmp_path) == {}


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


def test_another_car_that_is_driven_all_the_same_is_told_with_all_that_differs(
    tmp_path, monkeypatch
):
    monkeypatch.setattr(run_and_compare, '_run_each', lambda *_: [])
    request = run_and_compare.Request(
        'straight', ['mpcc'], 'lockstep', tmp_path, ['plant.plant_params=vw_gti.yaml'], 60.0
    )
    console = Console(file=io.StringIO(), width=400)
    run_and_compare.run_controllers(request._replace(any_car=True), console)
    said = ' '.join(console.file.getvalue().split())
    assert 'warning, mpcc: car_file car.yaml does not fit the plant: wheelbase 2.89 m' in said
    assert 'load of the rear axle' in said
