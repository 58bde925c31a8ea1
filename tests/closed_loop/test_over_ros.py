"""The ring in process against the ring of nodes over Fast DDS."""

import os
import subprocess
import sys

import numpy as np
import pytest

from bags import read, recorded
from bags.columns import Values

SCENARIO = 'double_lane_change'
# recorded with a new stamp each time they are repeated, told once in process
REPEATED = ('/scenario/reference', '/scenario/road_edges')


@pytest.fixture(scope='module')
def bag(tmp_path_factory):
    """Drive the double lane change through the nodes."""
    out = tmp_path_factory.mktemp('over_ros')
    done = subprocess.run(
        [sys.executable, '-m', 'bags.cli', 'run', SCENARIO, '--out', out],
        env={**os.environ, 'ROS_DOMAIN_ID': '58'},
        capture_output=True,
        text=True,
        timeout=240,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return read.load(out / SCENARIO / 'mpcc')


@pytest.mark.ros
def test_over_ros_and_in_process_the_ring_computes_the_same_bits(ring, bag):
    made, _ = ring.drive(SCENARIO, 'mpcc')
    recorded_ = read.columns(bag)
    for topic in made.keys() - set(REPEATED):
        for name, one in made[topic]._asdict().items():
            if not (isinstance(made[topic], Values) and name == 'values'):
                other = getattr(recorded_[topic], name)
                assert np.array_equal(one, other), f'{topic}: {name}'
    assert made['/scenario/obstacles'].values == recorded_['/scenario/obstacles'].values


@pytest.mark.ros
def test_over_ros_and_in_process_the_judge_is_told_the_same_facts(ring, bag):
    _, driven = ring.drive(SCENARIO, 'mpcc')
    assert recorded.of_bag(bag).facts == driven.facts
