"""A function runs beside this process where that is possible, and its errors are raised here."""

import os
import signal
import subprocess
import sys
import threading

import pytest

from bags import second_process


def write_process_id(file):
    file.write_text(str(os.getpid()))


def process_id(file):
    with second_process.concurrently(write_process_id, file):
        pass
    return int(file.read_text())


@pytest.fixture
def two_cores(monkeypatch):
    monkeypatch.setattr(os, 'sched_getaffinity', lambda _: {0, 1})
    monkeypatch.setattr(threading, 'active_count', lambda: 1)


def test_the_function_runs_in_a_process_of_its_own(two_cores, tmp_path):
    assert process_id(tmp_path / 'id') != os.getpid()


@pytest.mark.parametrize(
    ('module', 'name', 'value'),
    [(os, 'sched_getaffinity', {0}), (threading, 'active_count', 2)],
    ids=['one core', 'another thread'],
)
def test_otherwise_it_runs_in_this_process(two_cores, tmp_path, monkeypatch, module, name, value):
    monkeypatch.setattr(module, name, lambda *_: value)
    assert process_id(tmp_path / 'id') == os.getpid()


def test_an_error_of_the_function_is_raised_here(two_cores, tmp_path, capfd):
    with pytest.raises(FileNotFoundError):
        process_id(tmp_path / 'nowhere' / 'id')
    assert capfd.readouterr() == ('', '')


def test_an_error_of_the_block_ends_the_process(two_cores):
    with pytest.raises(KeyboardInterrupt), second_process.concurrently(threading.Event().wait):
        raise KeyboardInterrupt


def test_the_process_ends_with_a_killed_first_one():
    """Fails by the time limit: the pipe is open until both processes have ended."""
    script = (
        'import os, signal, threading\n'
        'from bags import second_process\n'
        'os.sched_getaffinity = lambda _: {0, 1}\n'
        'with second_process.concurrently(threading.Event().wait):\n'
        '    os.kill(os.getpid(), signal.SIGKILL)\n'
    )
    command = [sys.executable, '-c', script]
    assert subprocess.run(command, capture_output=True, timeout=240).returncode == -signal.SIGKILL
