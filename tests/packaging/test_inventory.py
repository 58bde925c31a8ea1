"""The list of the names that users rely on has every kind of them."""

import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
SAMPLES = (
    'command experiments run --controller',
    'command experiments run --mode lockstep',
    'command identify --out',
    'node controller_node',
    'parameter controller limits.brake_n',
    'parameter player rate',
    'config bmw_545i.yaml',
    'controller mpcc_road',
    'scenario double_lane_change',
    'key friction_patches',
    'family pop_up',
    'topic /vehicle/odometry nav_msgs/msg/Odometry',
    'column /vehicle/odometry vx_mps',
    'metric min_v2o_m',
    'figure figures/trajectories.png',
    'launch use_sim_time',
    'make demo',
    'python experiments.drive',
    'python bags.Run frame',
)


@pytest.mark.slow
def test_every_kind_of_name_is_listed():
    command = [sys.executable, ROOT / '.ci/inventory.py']
    done = subprocess.run(command, capture_output=True, text=True, timeout=240)
    lines = done.stdout.splitlines()
    missing = [name for name in SAMPLES if name not in lines]
    assert (done.returncode, missing) == (0, []), done.stderr
    kinds = list(dict.fromkeys(line.split()[0] for line in lines))
    assert kinds == list(dict.fromkeys(name.split()[0] for name in SAMPLES))
