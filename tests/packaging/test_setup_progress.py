"""What `make setup` shows while pip installs: a log gets lines, a terminal one that changes."""

import os
import pty
import shutil
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PIP = """#!/bin/sh
for number in $(seq 45); do echo "Collecting package$number==1"; done
echo "Installing collected packages: package1"
"""


@pytest.fixture
def make(tmp_path):
    """Return the command that installs the requirements with a pip that only says so."""
    for name in ('Makefile', 'requirements.txt'):
        shutil.copy(ROOT / name, tmp_path)
    programs = tmp_path / '.venv/bin'
    programs.mkdir(parents=True)
    for name, text in {'pip': PIP, 'python': '#!/bin/sh\n'}.items():
        (programs / name).write_text(text)
        (programs / name).chmod(0o755)
    return ['make', '-C', str(tmp_path), '--no-print-directory', '.venv/.requirements']


def test_without_a_terminal_progress_is_a_few_lines(make):
    done = subprocess.run(make, capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr
    assert '\r' not in done.stdout
    total = len((ROOT / 'requirements.txt').read_text().splitlines())
    shown = [line.split() for line in done.stdout.splitlines()[1:]]
    assert shown == [['20', 'of', str(total)], ['40', 'of', str(total)], ['unpacking']]


def test_on_a_terminal_progress_is_a_line_that_changes(make):
    ours, its = pty.openpty()
    done = subprocess.run(make, stdout=its, stderr=its, timeout=60)
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
    assert text.count(b'\r      ') == 46
