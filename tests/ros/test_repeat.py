"""The script that repeats the tests over DDS."""

import os
import subprocess
from pathlib import Path

import pytest

SCRIPT = Path(__file__).parent / 'repeat.sh'
# stands for the interpreter: prints what it is to test, and fails in one series or in none
PYTEST = """#!/bin/sh
echo "$@"
case "$@" in *{failing}*) exit 1;; esac
"""


def repeat(folder, failing):
    program = folder / 'python'
    program.write_text(PYTEST.format(failing=failing))
    program.chmod(0o755)
    return subprocess.run(
        [SCRIPT, '2', '1'],
        env={**os.environ, 'PYTHON': str(program), 'TMPDIR': str(folder)},
        capture_output=True,
        text=True,
        timeout=240,
    )


def test_the_logs_of_every_failure_of_every_series_are_kept(tmp_path):
    result = repeat(tmp_path, failing='tests/ros')
    logs = {log.name: log.read_text() for log in tmp_path.glob('repeat.*/*.log')}
    assert sorted(logs) == ['node_graph.1.log', 'node_graph.2.log', 'others.1.log']
    assert '--ignore' in logs['others.1.log']
    assert all('--ignore' not in logs[name] for name in ('node_graph.1.log', 'node_graph.2.log'))
    assert '0 of 2 passed' in result.stdout
    assert str(next(tmp_path.glob('repeat.*'))) in result.stdout
    assert result.returncode == 1


@pytest.mark.parametrize(('failing', 'code', 'kept'), [('--ignore', 1, 1), ('nothing', 0, 0)])
def test_what_passed_leaves_nothing(tmp_path, failing, code, kept):
    result = repeat(tmp_path, failing)
    assert result.returncode == code
    assert '2 of 2 passed' in result.stdout
    assert len(list(tmp_path.glob('repeat.*/*'))) == kept
    assert len(list(tmp_path.glob('repeat.*'))) == kept
