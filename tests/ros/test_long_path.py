"""A path as long as the contract allows, driven on the wall clock: obstacles are not delayed."""

import os
from pathlib import Path

import numpy as np
import pytest
from node_graph import ROLES, NodeGraph
from straight_road import write_straight

from bags.storage import cdr, read
from msgs_yaml import contract

REFERENCE, OBSTACLES = '/scenario/reference', '/scenario/obstacles'
# a decimetre between poses, of which there are 39,801
LONG = {
    'name: straight': 'name: straight\nsampling: {path_m: 0.1, edges_m: 0.1}',
    'length_m: 140.0': 'length_m: 3990.0',
    'length_m: 120.0': 'length_m: 3980.0',
}
DRIVEN = {'stop.x_m': 60.0, 'stop.armed_after_m': 1.0}  # 4 s
RATE_HZ = (19.0, 21.0)  # of the obstacles over the drive; 20 by the contract
SCENARIO_USE = 0.2  # of processor time per second; with a message made anew it is 0.5 at least


def processor_s(process):
    """Return user and system time of a process and its threads so far [s]."""
    fields = Path(f'/proc/{process.popen.pid}/stat').read_text().rpartition(')')[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf('SC_CLK_TCK')


@pytest.fixture(scope='module')
def drive(domain, tmp_path_factory, wall_clock):
    """Drive a few seconds; return the bag, and the scenario's use of the processor meanwhile."""
    folder = tmp_path_factory.mktemp('long')
    scenario = write_straight(folder, LONG)
    settings = wall_clock.with_priority(plant=DRIVEN)
    with (
        wall_clock.own_drive(),
        NodeGraph(folder, domain, 'realtime', scenario, **settings) as graph,
    ):
        for role in ROLES:
            graph.start(role)
        graph.wait_for('controller', 'started from the actuators')
        before_s = processor_s(graph.running['scenario'])
        assert graph.wait('plant') == 0, graph.log('plant')
        used_s = processor_s(graph.running['scenario']) - before_s
        return graph.stop_recording(), used_s


def test_the_path_is_about_as_long_as_the_contract_allows(drive):
    bag, _ = drive
    most = contract.load().topics[REFERENCE].sizes['poses'].high
    recorded = read.recording(bag, REFERENCE)
    # one: to decode the path of every second takes longer than the drive
    path = cdr.decode(recorded.payloads[0], recorded.topic.schema, recorded.topic.type)
    assert 0.95 * most < len(path.poses) <= most


def test_obstacles_come_at_20_hz_beside_a_long_path(drive):
    stamps_ns = [one.stamp_ns for one in read.values(drive[0], OBSTACLES)]
    moving_ns = read.columns(drive[0], ['/controller/command'])['/controller/command'].stamp_ns[0]
    driven = [stamp_ns for stamp_ns in stamps_ns if stamp_ns >= moving_ns]
    assert RATE_HZ[0] < 1e9 / np.mean(np.diff(driven)) < RATE_HZ[1]


def test_hardly_anything_grows_stale_beside_a_long_path(drive):
    reasons = [one.values['reason'] for one in read.values(drive[0], '/controller/why')]
    stale = sum(reason.endswith('_stale') for reason in reasons)
    assert stale < 0.2 * len(reasons)  # where other processes take the machine; else it is none


def test_repeating_a_long_path_takes_the_scenario_little_time(drive):
    bag, used_s = drive
    stamps_ns = [one.stamp_ns for one in read.values(bag, '/controller/why')]
    assert used_s / (np.ptp(stamps_ns) / 1e9) < SCENARIO_USE
