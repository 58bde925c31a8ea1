"""What `make setup` shows while pip installs: how far it is, and what it could not reach."""

import os
import pty
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
INSTALLS = """#!/bin/sh
for number in $(seq 45); do
  echo "Collecting package$number==1"
  echo "  Downloading package$number-1-py3-none-any.whl (2.0 MB)"
done
echo "Installing collected packages: package1, package2"
"""
REACHES_NOTHING = """#!/bin/sh
for left in 1 0; do
  echo "WARNING: Retrying (Retry(total=$left, connect=None)) after connection broken by
 'NewConnectionError('<HTTPSConnection object>: Failed: [Errno -3] Temporary failure in name
 resolution')': /simple/alembic/" | tr -d '\\n' >&2
  echo >&2
done
echo "ERROR: No matching distribution found for alembic==1" >&2
exit 1
"""
HAS_NO_SPACE = """#!/bin/sh
echo "Collecting package1==1"
echo "WARNING: Retrying (Retry(total=4)) after connection broken by 'ReadTimeoutError(...)'" >&2
echo "ERROR: Could not install packages due to an OSError: No space left on device" >&2
exit 1
"""
# one try too many for one package, which another server then had; the error is of another kind
HASH_DIFFERS = """#!/bin/sh
echo "WARNING: Retrying (Retry(total=0)) after connection broken by 'ReadTimeoutError(...)'" >&2
echo "ERROR: THESE PACKAGES DO NOT MATCH THE HASHES FROM THE REQUIREMENTS FILE" >&2
exit 1
"""
NO_FOLDERS = """#!/bin/sh
for name in alembic attrs bokeh; do
  echo "WARNING: Location 'file:///no/$name/' is ignored: it is neither a file nor a directory." >&2
done
"""
CONFLICTS = """#!/bin/sh
echo "ERROR: pip's dependency resolver does not take into account all that is installed" >&2
"""


@pytest.fixture
def make(tmp_path):
    """Return a command that installs the requirements with a pip that only says what it is told."""
    (tmp_path / '.ci').mkdir()
    for name in ('Makefile', 'requirements.txt', '.ci/pip_progress.py'):
        shutil.copy(ROOT / name, tmp_path / name)
    programs = tmp_path / '.venv/bin'
    programs.mkdir(parents=True)
    (programs / 'python').symlink_to(sys.executable)

    def command(pip):
        (programs / 'pip').write_text(pip)
        (programs / 'pip').chmod(0o755)
        return ['make', '-C', str(tmp_path), '--no-print-directory', '.venv/.requirements']

    return command


def run(command, **more):
    environment = {k: v for k, v in os.environ.items() if k != 'PIP_INDEX_URL'} | more
    return subprocess.run(command, capture_output=True, text=True, timeout=240, env=environment)


def test_without_a_terminal_progress_is_a_few_lines(make):
    done = run(make(INSTALLS))
    assert done.returncode == 0, done.stderr
    assert '\r' not in done.stdout
    lines = (ROOT / 'requirements.txt').read_text().splitlines()
    shown = [line.split() for line in done.stdout.splitlines()[1:]]
    assert [words[:2] for words in shown[:2]] == [['20', 'of'], ['40', 'of']]
    # some of the packages are for other versions of Python only
    total = int(shown[0][2])
    assert sum(';' not in line for line in lines) < total < len(lines)
    assert shown[1][3:] == ['package40', '78', 'MB']
    assert shown[2:] == [['unpacking', '2', 'packages']]


def test_on_a_terminal_progress_is_a_line_that_changes(make):
    ours, its = pty.openpty()
    done = subprocess.run(make(INSTALLS), stdout=its, stderr=its, timeout=240)
    os.close(its)
    text = b''
    try:
        while part := os.read(ours, 4096):
            text += part
    except OSError:  # Linux says so at the end of a terminal
        pass
    finally:
        os.close(ours)
    assert done.returncode == 0, text
    # each package is named, and again with what has been downloaded
    assert text.count(b'\r      ') >= 91
    assert b'package45  90 MB' in text


def test_a_server_that_cannot_be_reached_is_named_in_one_line(make):
    done = run(make(REACHES_NOTHING), PIP_INDEX_URL='https://me:secret@mirror.example:8/simple')
    assert done.returncode != 0
    lines = [line for line in done.stderr.splitlines() if not re.match(r'make(\[\d+\])?: ', line)]
    assert lines[0].strip() == (
        'no answer from mirror.example (Temporary failure in name resolution): trying again'
    )
    assert len(lines) == 2
    assert lines[1].startswith('error: could not reach mirror.example (Temporary failure in name')
    assert 'HTTPS_PROXY' in lines[1]
    assert 'secret' not in done.stderr + done.stdout


@pytest.mark.parametrize(
    ('pip', 'error'),
    [(HAS_NO_SPACE, 'No space left on device'), (HASH_DIFFERS, 'DO NOT MATCH THE HASHES')],
)
def test_any_other_error_of_pip_is_shown(make, pip, error):
    done = run(make(pip))
    assert done.returncode != 0
    assert error in done.stderr
    assert 'could not reach' not in done.stderr


def test_a_folder_that_is_missing_for_every_package_is_said_once(make):
    done = run(make(NO_FOLDERS))
    assert done.returncode == 0
    assert done.stderr.count('is ignored') == 1
    assert 'alembic' in done.stderr


def test_an_error_of_a_pip_that_succeeds_is_shown(make):
    done = run(make(CONFLICTS))
    assert done.returncode == 0
    assert "ERROR: pip's dependency resolver" in done.stderr
