"""A problem of a car that is lost at 135 km/h, on which fatrop went on for ever."""

import subprocess
import sys
from pathlib import Path

HERE = Path(__file__).parent
LONGEST_S = 120.0  # compiler included


def test_fatrop_comes_back_from_its_restoration_phase():
    # in a process of its own: nothing in Python interrupts a solve
    command = [sys.executable, HERE / 'solve_again.py', HERE / 'restoration.npz']
    done = subprocess.run(command, capture_output=True, text=True, timeout=LONGEST_S)
    assert done.returncode == 0, done.stderr
    name, status, iterations = done.stdout.split()
    assert name == 'fatrop'
    assert status in ('solved', 'stopped_early', 'failed')
    assert int(iterations) > 0
