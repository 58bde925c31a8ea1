"""A pool that is left, and a task that crashes, leave no process behind."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from dask_cluster import Cluster
from wait_until import wait_until

TIMEOUT_S = 60.0
# a process that starts another, as a drive starts a compiler, says so and never ends
STARTS_ANOTHER = """
import os, pathlib, signal, subprocess, sys
other = subprocess.Popen([sys.executable, '-c', 'import signal; signal.pause()'])
pathlib.Path({file!r}).write_text(f'{{os.getpid()}} {{other.pid}}.')
{then}
"""
ASKS = 'import sys; from experiments.pool import Pool\nwith Pool(1, {address!r}) as pool:\n{body}'


def lives(pid):
    """Return whether a process is there and no zombie."""
    try:
        return Path(f'/proc/{pid}/stat').read_text().rpartition(')')[2].split()[0] != 'Z'
    except FileNotFoundError:
        return False


def started(file):
    """Return the processes of a task, when both are there."""
    wait_until(lambda: file.exists() and file.read_text().endswith('.'), TIMEOUT_S, 'no task began')
    return [int(word) for word in file.read_text().rstrip('.').split()]


def ask(file, then, address=''):
    """Start a program that gives the task to a pool."""
    body = f'    pool.run(exec, [({STARTS_ANOTHER.format(file=str(file), then=then)!r},)])'
    script = ASKS.format(address=address, body=body)
    return subprocess.Popen(
        [sys.executable, '-c', script], stderr=subprocess.DEVNULL, start_new_session=True
    )


def wait_for_the_end_of(pids):
    wait_until(lambda: not any(map(lives, pids)), TIMEOUT_S, f'of {pids} one was left behind')


def test_what_a_crashed_task_has_started_ends_with_it(tmp_path):
    with ask(tmp_path / 'pids', 'os._exit(3)') as program:
        wait_for_the_end_of(started(tmp_path / 'pids'))
        assert program.wait(TIMEOUT_S) == 1


@pytest.mark.slow
def test_a_task_on_a_cluster_ends_with_the_command_that_gave_it(tmp_path):
    with Cluster(tmp_path / 'cluster') as cluster:
        worker = cluster.start_worker()
        with ask(tmp_path / 'pids', 'signal.pause()', cluster.address) as program:
            pids = started(tmp_path / 'pids')
            os.kill(program.pid, signal.SIGINT)
            program.wait(TIMEOUT_S)
            wait_for_the_end_of(pids)
        assert worker.poll() is None
