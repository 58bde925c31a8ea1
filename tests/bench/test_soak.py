"""A short soak; the documented run is `python bench/soak.py`."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
import soak

BENCH = Path(__file__).parents[2] / 'bench'

LOOK = soak.Look(100.0, 20, 15, 4)


def test_what_stays_as_it_is_did_not_grow():
    assert soak.growth('plant', [LOOK] * 100).grew == []


def test_more_memory_files_threads_and_segments_in_the_end_are_growth():
    for change in ({'memory_mb': 104.0}, {'files': 21}, {'threads': 16}, {'segments': 5}):
        looks = [LOOK] * 60 + [LOOK._replace(**change)] * 40
        assert soak.growth('plant', looks).grew == list(change)


def test_what_grows_while_it_starts_is_none():
    looks = [LOOK._replace(memory_mb=5.0 * k) for k in range(20)] + [LOOK] * 80
    assert soak.growth('plant', looks).grew == []


@pytest.mark.ros
def test_a_short_drive_does_not_make_the_nodes_grow():
    done = subprocess.run(
        [sys.executable, BENCH / 'soak.py', '--minutes', '0.4'],
        env={**os.environ, 'ROS_DOMAIN_ID': '79'},
        capture_output=True,
        text=True,
        timeout=200,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert 'nothing grew' in done.stdout
