"""Recorded problems on which fatrop used to run without end."""

import subprocess
import sys
from pathlib import Path

import pytest

HERE = Path(__file__).parent
LONGEST_S = 120.0  # compiler included


@pytest.mark.parametrize(
    ('problem', 'distance'),
    [
        ('restoration', 'path'),  # at 135 km/h, in the restoration phase
        ('growth', 'cartesian'),  # plan of 2.5 s with sensitivities beyond double precision
        ('barrier', 'cartesian'),  # a Jacobian of moderate growth with the weights of the barrier
        ('rounding', 'cartesian'),  # growth so large that the guard's own recursion loses pivots
    ],
)
def test_fatrop_returns(problem, distance):
    # in a separate process: nothing in Python interrupts a solve
    command = [sys.executable, HERE / 'solve_again.py', HERE / f'{problem}.npz', distance]
    completed = subprocess.run(command, capture_output=True, text=True, timeout=LONGEST_S)
    assert completed.returncode == 0, completed.stderr
    name, status, iterations = completed.stdout.split()
    assert name == 'fatrop'
    assert status in ('solved', 'stopped_early', 'failed')
    assert int(iterations) > 0
