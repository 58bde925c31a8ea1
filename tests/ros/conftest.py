"""The ring over real Fast DDS: each run is made once and looked at by several tests."""

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

import pytest

BAGS = Path(sys.prefix, 'bin/bags')
SECONDS = 240  # of wall time for one call; a run takes a few


class Rings(NamedTuple):
    """What one call of `bags run` left behind."""

    out: Path
    comparison: dict
    printed: str

    def bag(self, controller):
        return self.out / 'double_lane_change' / controller


def drive(out, domain, *arguments):
    """Call `bags run` as a user would, on its own DDS domain; return its exit code and text."""
    done = subprocess.run(
        [BAGS, 'run', *arguments, '--out', out],
        env={**os.environ, 'ROS_DOMAIN_ID': str(domain)},
        capture_output=True,
        text=True,
        timeout=SECONDS,
    )
    return done.returncode, done.stdout + done.stderr


@pytest.fixture(scope='session')
def rings(tmp_path_factory):
    """Drive the double lane change with both controllers through the node graph."""
    out = tmp_path_factory.mktemp('rings')
    controllers = ('--controller', 'mpcc', '--controller', 'mpcc_no_ca')
    code, printed = drive(out, 60, 'double_lane_change', *controllers)
    assert code == 0, printed
    comparison = json.loads((out / 'double_lane_change' / 'comparison.json').read_text())
    return Rings(out, comparison, printed)


@pytest.fixture(scope='session')
def again(tmp_path_factory):
    """Drive the same with the MPCC once more."""
    out = tmp_path_factory.mktemp('again')
    code, printed = drive(out, 61, 'double_lane_change', '--controller', 'mpcc')
    assert code == 0, printed
    comparison = json.loads((out / 'double_lane_change' / 'comparison.json').read_text())
    return Rings(out, comparison, printed)
