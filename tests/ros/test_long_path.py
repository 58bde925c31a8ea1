"""A path as long as the contract allows, driven on the wall clock: obstacles are not delayed."""

import numpy as np
import pytest
from node_graph import ROLES, NodeGraph
from straight_road import write_straight
from wait_until import processor_s

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


@pytest.mark.nightly
def test_obstacles_come_at_their_rate_beside_a_path_of_the_greatest_length(
    tmp_path, domain, wall_clock
):
    scenario, settings = write_straight(tmp_path, LONG), wall_clock.with_priority(plant=DRIVEN)
    with (
        wall_clock.own_drive(),
        NodeGraph(tmp_path, domain, 'realtime', scenario, **settings) as graph,
    ):
        graph.start(*ROLES)
        graph.wait_for('controller', 'started from the actuators')
        before_s = processor_s(graph.running['scenario'].popen.pid)
        assert graph.wait('plant') == 0, graph.log('plant')
        used_s = processor_s(graph.running['scenario'].popen.pid) - before_s
        bag = graph.stop_recording()
    most = contract.load().topics[REFERENCE].sizes['poses'].high
    recorded = read.recording(bag, REFERENCE)
    # the first: to decode the path of every second takes longer than the drive
    path = cdr.decode(recorded.payloads[0], recorded.topic.schema, recorded.topic.type)
    assert 0.95 * most < len(path.poses) <= most
    whys = read.values(bag, '/controller/why')
    driven = [
        obstacles.stamp_ns
        for obstacles in read.values(bag, OBSTACLES)
        if obstacles.stamp_ns >= whys[0].stamp_ns
    ]
    assert RATE_HZ[0] < 1e9 / np.mean(np.diff(driven)) < RATE_HZ[1]
    # where other processes take the machine; else it is none
    assert sum(why.values['reason'].endswith('_stale') for why in whys) < 0.2 * len(whys)
    assert used_s / ((whys[-1].stamp_ns - whys[0].stamp_ns) / 1e9) < SCENARIO_USE
