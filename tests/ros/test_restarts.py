"""Nodes that are killed in mid-run and started again hear all others, and are heard. Real Fast DDS.

What the car does meanwhile is in tests/faults.
"""

import numpy as np
from node_graph import OF_PROCESSES, ROLES, Manager, NodeGraph
from straight_road import LONG, write_straight
from wait_until import wait_until

from bags.storage import read, repair
from experiments.run import processes

pytestmark = OF_PROCESSES
WHY = '/controller/why'
TICK_NS = 50_000_000
ROAD = {'name: straight': 'name: straight\nsampling: {path_m: 5.0, edges_m: 5.0}', **LONG}
HOLDS = {'plant': {'command_age_s': 1.0, 'lockstep_timeout_s': 30.0}}


def drives(whys):
    """Tell whether the last eight answers were solved."""
    return len(whys) >= 8 and all(why.values['rung'] == 'solved' for why in whys[-8:])


def restart_recorder(graph):
    """Kill the recorder, which needs another folder then; return the path of the bag so far."""
    before = graph.bag
    wait_until(lambda: any(before.glob('*.mcap')), 60.0, 'there is no bag')
    graph.restart('recorder')
    assert graph.wait('recorder') != 0
    assert 'out: ' in graph.log('recorder')
    graph.bag = graph.folder / 'second'
    node = graph.nodes['recorder']
    graph.nodes['recorder'] = node._replace(parameters=node.parameters | {'out': str(graph.bag)})
    graph.start('recorder')
    graph.wait_for('recorder', WHY)  # the nodes find each other one by one
    return before


def test_in_lockstep_nodes_started_again_drive_on(tmp_path, domain):
    road = write_straight(tmp_path, ROAD)
    with NodeGraph(tmp_path, domain, road=road, **HOLDS) as graph, Manager(domain) as ear:
        graph.start(*ROLES)
        ear.wait_for_messages(WHY, drives)
        graph.restart('controller', 'scenario')
        graph.wait_for('plant', 'sending the present state again')
        graph.wait_for('controller', 'started from the actuators')
        ear.wait_for_messages(WHY, drives)
        first = restart_recorder(graph)
        ear.wait_for_messages(WHY, drives)
        processes.stop([graph.running['controller']])  # first: it is not to miss the others
        processes.stop([graph.running[role] for role in ('plant', 'scenario')])
        second = read.values(graph.stop_recording(), WHY)
    repair.repair_bag(first)
    whys = read.values(read.load(first), WHY)
    steps = np.diff([why.stamp_ns for why in whys])
    # time waited; what was on its way when the nodes died may be missing
    assert (steps > 0).all()
    assert set(steps % TICK_NS) == {0}
    assert np.count_nonzero(steps > TICK_NS) <= 1
    assert {why.values['rung'] for why in whys + second} == {'solved'}
    assert whys[-1].stamp_ns < second[0].stamp_ns
