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

IGNORES_SIGINT = 'trap "" INT; echo ready; while :; do sleep 0.05; done'
ENDS_ON_SIGINT = 'trap "exit 0" INT; echo ready; while :; do sleep 0.05; done'
STARTER = """
import os, pathlib, signal, sys
from experiments.run import processes
command = ["sh", "-c", "exec sleep 60"]
started = processes.start("child", command, pathlib.Path(sys.argv[1]), os.environ)
while b"sleep" not in pathlib.Path(f"/proc/{started.popen.pid}/cmdline").read_bytes(): 0
status = pathlib.Path(f"/proc/{started.popen.pid}/status").read_text()
ignored = int(status.partition("SigIgn:")[2].split()[0], 16)
print(started.popen.pid, ignored >> signal.SIGINT - 1 & 1, flush=True)
os.kill(os.getpid(), signal.SIGKILL)
"""


@pytest.fixture
def shell(tmp_path):
    """Return start(script): a shell that has written something, killed when the test ends."""
    started = []

    def start(script, **options):
        log = tmp_path / f'{len(started)}.log'
        process = processes.start('node', ['sh', '-c', script], log, os.environ, **options)
        started.append(process)
        wait_until(lambda: log.read_text() or process.code is not None, 30.0, 'it says nothing')
        return process

    yield start
    for process in started:
        processes.kill(process)


def test_programs_end_by_sigint_or_are_killed_after_a_patience_that_they_share(shell):
    obedient, *stubborn = [shell(ENDS_ON_SIGINT), *(shell(IGNORES_SIGINT) for _ in range(4))]
    begin = time.monotonic()
    processes.stop([obedient, *stubborn], patience_s=1.0)
    assert 1.0 <= time.monotonic() - begin < 3.9
    assert [one.code for one in (obedient, *stubborn)] == [0, *[-signal.SIGKILL] * 4]


def test_a_kill_reaches_what_the_program_started(shell):
    process = shell('sleep 60 & echo $!; wait')
    child = int(processes.last_line(process.log))
    processes.kill(process)
    wait_until(lambda: not os.path.exists(f'/proc/{child}'), 30.0, 'the child goes on')


def test_the_last_line_is_the_last_complete_one_before_a_report(tmp_path):
    log = tmp_path / 'log'
    for text, last in (('', ''), ('half', ''), ('a\nb\nhalf', 'b'), ('x' * 5000 + '\nb\n\n', 'b')):
        log.write_text(text)
        assert processes.last_line(log) == last
    held = "import time\nfrom node_runtime import shutdown\nprint('over')\n"
    held += 'with shutdown.exit_after(0.5, 3):\n    time.sleep(60)'
    process = processes.start('node', [sys.executable, '-c', held], log, os.environ)
    assert process.popen.wait(60) == 3
    assert 'line 5 in <module>' in log.read_text()
    assert processes.last_line(log) == 'over'


def test_a_program_has_the_cores_and_the_priority_that_were_given(shell):
    core = max(os.sched_getaffinity(0))
    script = 'grep Cpus_allowed_list /proc/self/status; nice; sleep 60'
    process = shell(script, cores={core}, nice=3)
    wait_until(lambda: process.log.read_text().count('\n') == 2, 30.0, 'it says too little')
    cores, nice = process.log.read_text().splitlines()
    assert cores.split()[-1] == str(core)
    assert int(nice) == min(os.nice(0) + 3, 19)


def test_a_program_is_interrupted_when_its_starter_is_killed_and_inherits_no_ignored_sigint(
    tmp_path,
):
    done = subprocess.run(
        [sys.executable, '-c', STARTER, tmp_path / 'log'],
        stdout=subprocess.PIPE,
        timeout=240,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_IGN),
    )
    pid, is_ignored = map(int, done.stdout.split())
    assert not is_ignored
    child = Path(f'/proc/{pid}/stat')

    def ended():
        try:
            return ') Z ' in child.read_text()  # nobody may be there to bury it
        except (FileNotFoundError, ProcessLookupError):
            return True

    wait_until(ended, 30.0, 'it is still running')
