"""Programs are found, started, watched and ended."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from wait_until import wait_until

from experiments.run import processes
from msgs_yaml import share

IGNORES_SIGINT = 'trap "" INT; echo ready; while :; do sleep 0.05; done'
ENDS_ON_SIGINT = 'trap "exit 0" INT; echo ready; while :; do sleep 0.05; done'


@pytest.fixture
def shell(tmp_path):
    """Return start(script): a shell that has written something, killed when the test ends."""
    started = []

    def start(script, **options):
        log = tmp_path / f'{len(started)}.log'
        process = processes.start('node', ['sh', '-c', script], log, os.environ, **options)
        started.append(process)
        wait_until(
            lambda: log.read_text() or process.code is not None, 30.0, 'the shell says nothing'
        )
        return process

    yield start
    for process in started:
        processes.kill(process)


def test_a_program_that_obeys_sigint_ends_with_its_own_code(shell):
    process = shell(ENDS_ON_SIGINT)
    processes.stop([process], patience_s=10.0)
    assert process.code == 0


def test_a_program_that_ignores_sigint_is_killed_after_the_patience(shell):
    process = shell(IGNORES_SIGINT)
    begin = time.monotonic()
    processes.stop([process], patience_s=0.3)
    assert process.code == -signal.SIGKILL
    assert 0.3 <= time.monotonic() - begin < 5.0


def test_patience_is_shared_not_added_up(shell):
    stubborn = [shell(IGNORES_SIGINT) for _ in range(4)]
    begin = time.monotonic()
    processes.stop(stubborn, patience_s=0.5)
    assert time.monotonic() - begin < 1.5


def test_a_kill_reaches_what_the_program_started(shell):
    process = shell('sleep 60 & echo $!; wait')
    child = int(processes.last_line(process.log))
    processes.kill(process)
    wait_until(lambda: not os.path.exists(f'/proc/{child}'), 30.0, 'the child goes on')


def test_an_early_end_is_an_error_with_the_last_output(shell):
    alive, dead = shell(ENDS_ON_SIGINT), shell('seq 40; echo no road >&2; exit 7')
    dead.popen.wait(60)
    processes.check_running([alive])
    with pytest.raises(processes.ProcessError) as caught:
        processes.check_running([alive, dead])
    text = str(caught.value)
    assert 'node ended early with exit code 7' in text
    assert '| no road' in text
    assert '| 40' in text
    assert '| 10\n' not in text


def test_a_crash_is_named_by_its_signal(shell):
    process = shell('kill -SEGV $$')
    process.popen.wait(60)
    assert 'by SIGSEGV without any output' in processes.exit_report(process)


def test_the_last_line_of_a_blocked_node_is_the_one_before_the_report(tmp_path):
    log = tmp_path / 'held.log'
    held = "import time\nfrom node_runtime import shutdown\nprint('over')\n"
    held += 'with shutdown.exit_after(0.5, 3):\n    time.sleep(60)'
    process = processes.start('node', [sys.executable, '-c', held], log, os.environ)
    assert process.popen.wait(60) == 3
    assert 'line 5 in <module>' in log.read_text()
    assert processes.last_line(log) == 'over'


def test_the_last_line_is_the_last_complete_one(tmp_path):
    log = tmp_path / 'log'
    for text, last in (('', ''), ('half', ''), ('a\nb\nhalf', 'b'), ('x' * 5000 + '\nb\n\n', 'b')):
        log.write_text(text)
        assert processes.last_line(log) == last


def test_cores_are_those_that_were_given(shell):
    core = max(os.sched_getaffinity(0))
    process = shell('grep Cpus_allowed_list /proc/self/status; sleep 60', cores={core})
    assert processes.last_line(process.log).split()[-1] == str(core)


def test_a_node_is_found_as_ros2_run_finds_it(tmp_path, monkeypatch):
    for prefix in ('first', 'second'):
        program = tmp_path / prefix / 'lib/pkg/node'
        program.parent.mkdir(parents=True)
        program.write_text('#!/bin/sh\n')
    monkeypatch.setenv('AMENT_PREFIX_PATH', f'{tmp_path}/first:{tmp_path}/second')
    # what is not executable is no node
    assert share.node_command('pkg', 'node') == [sys.executable, '-m', 'pkg.node']
    program.chmod(0o755)
    assert share.node_command('pkg', 'node') == [str(program)]


def test_an_ignored_sigint_is_not_inherited(tmp_path):
    script = (
        'import os, pathlib, signal, sys\n'
        'from experiments.run import processes\n'
        'log = pathlib.Path(sys.argv[1])\n'
        'child = [sys.executable, "-c", "import signal;'
        ' print(signal.getsignal(signal.SIGINT) is signal.SIG_IGN)"]\n'
        'processes.start("child", child, log, os.environ).popen.wait()\n'
    )
    log = tmp_path / 'log'
    subprocess.run(
        [sys.executable, '-c', script, log],
        check=True,
        timeout=240,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_IGN),
    )
    assert log.read_text() == 'False\n'


def test_a_program_is_interrupted_when_its_starter_is_killed_also_behind_a_script(tmp_path):
    script = (
        'import os, pathlib, signal, sys\n'
        'from experiments.run import processes\n'
        'command = ["sh", "-c", "exec sleep 60"]\n'
        'started = processes.start("child", command, pathlib.Path(sys.argv[1]), os.environ)\n'
        'while b"sleep" not in pathlib.Path(f"/proc/{started.popen.pid}/cmdline").read_bytes(): 0\n'
        'print(started.popen.pid, flush=True)\n'
        'os.kill(os.getpid(), signal.SIGKILL)\n'
    )
    done = subprocess.run(
        [sys.executable, '-c', script, tmp_path / 'log'], stdout=subprocess.PIPE, timeout=240
    )
    child = Path(f'/proc/{int(done.stdout)}/stat')

    def ended():
        try:
            return ') Z ' in child.read_text()  # nobody may be there to bury it
        except (FileNotFoundError, ProcessLookupError):
            return True

    wait_until(ended, 30.0, 'it is still running')
