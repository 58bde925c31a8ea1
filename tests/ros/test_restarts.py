"""Nodes that are killed in mid-run and started again hear all others, and are heard. Real Fast DDS.

What the car does meanwhile is in tests/faults.
"""

import numpy as np
import pytest
from node_graph import OF_PROCESSES, ROLES, Manager, NodeGraph
from straight_road import LONG, write_straight
from wait_until import wait_until

from bags.storage import read, repair
from experiments.run import processes

pytestmark = OF_PROCESSES
STATE, WHY = '/vehicle/odometry', '/controller/why'
TICK_NS = 50_000_000
FAST_MPS = 35.0
LOST_NS = 2_000_000_000
IN_A_ROW = 8  # answers that make a drive; on the wall clock one of them may be late
# fast, long and slippery: a car that brakes meanwhile takes 11 s until it is too slow to drive on
HIGHWAY = {
    'name: straight': 'name: straight\nsampling: {path_m: 5.0, edges_m: 5.0}',
    'constant_mps: 15.0': 'constant_mps: 40.0',
    'friction: 1.0': 'friction: 0.3',
    **LONG,
}
HOLDS = {'plant': {'command_age_s': 1.0, 'lockstep_timeout_s': 30.0}}


@pytest.fixture(scope='module')
def highway(tmp_path_factory):
    return write_straight(tmp_path_factory.mktemp('highway'), HIGHWAY)


def drives(whys):
    """Tell whether somewhere in a row of answers all were solved, but one."""
    solved = [why.values['rung'] == 'solved' for why in whys]
    rows = (solved[k : k + IN_A_ROW] for k in range(len(solved) - IN_A_ROW + 1))
    return any(sum(row) >= IN_A_ROW - 1 for row in rows)


def restart_recorder(graph, number):
    """Kill the recorder; another one needs a folder of its own.

    Return the path of the bag so far.
    """
    before = graph.bag
    wait_until(lambda: any(before.glob('*.mcap')), 60.0, 'there is no bag')
    graph.restart('recorder')
    assert graph.wait('recorder') != 0
    assert 'out: ' in graph.log('recorder')
    graph.bag = graph.folder / f'bag_{number}'
    node = graph.nodes['recorder']
    graph.nodes['recorder'] = node._replace(parameters=node.parameters | {'out': str(graph.bag)})
    graph.start('recorder')
    graph.wait_for('recorder', WHY)  # the nodes find each other one by one
    return before


def stop(graph):
    """End the nodes; return the bag."""
    processes.stop([graph.running['controller']])  # first: it is not to miss the others
    processes.stop([graph.running[role] for role in ('plant', 'scenario')])
    return graph.stop_recording()


def test_in_lockstep_nodes_started_again_drive_on(highway, tmp_path, domain):
    with NodeGraph(tmp_path, domain, 'lockstep', highway, **HOLDS) as graph, Manager(domain) as ear:
        graph.start(*ROLES)
        ear.wait_for_messages(WHY, drives)
        graph.restart('controller', 'scenario')
        graph.wait_for('plant', 'sending the present state again')
        graph.wait_for('controller', 'started from the actuators')
        ear.wait_for_messages(WHY, drives)
        first = restart_recorder(graph, 2)
        ear.wait_for_messages(WHY, drives)
        second = read.values(stop(graph), WHY)
    repair.repair_bag(first)
    whys = read.values(read.load(first), WHY)
    steps = np.diff([why.stamp_ns for why in whys])
    # time waited; what was on its way when the nodes died may be missing
    assert (steps > 0).all()
    assert set(steps % TICK_NS) == {0}
    assert np.count_nonzero(steps > TICK_NS) <= 1
    assert {why.values['rung'] for why in whys + second} == {'solved'}
    assert whys[-1].stamp_ns < second[0].stamp_ns


@pytest.mark.nightly
def test_on_the_wall_clock_nodes_started_again_drive_on(highway, tmp_path, domain, wall_clock):
    settings = wall_clock.with_priority(**HOLDS)
    with (
        wall_clock.own_drive(),
        NodeGraph(tmp_path, domain, 'realtime', highway, **settings) as graph,
        Manager(domain, 'realtime') as ear,
    ):
        graph.start(*ROLES)
        ear.wait_for_messages(WHY, drives)
        # a controller may start within the age that the plant allows its last command
        processes.kill(graph.running['controller'])
        graph.wait_for('plant', 'no command comes, stopping along the last plan')
        graph.start('controller')
        graph.wait_for('controller', 'started from the actuators')
        graph.wait_for('plant', 'commands are back')
        # a recorder that is killed loses its last second
        ear.wait_for_messages(
            WHY, lambda whys: drives([w for w in whys if w.stamp_ns < whys[-1].stamp_ns - LOST_NS])
        )
        first = restart_recorder(graph, 2)
        # without a controller it braked: it is to be fast again before it brakes once more
        ear.wait_for_messages(STATE, lambda states: states and states[-1].vx > FAST_MPS)
        graph.restart('scenario')
        graph.wait_for('controller', 'every input is back')
        ear.wait_for_messages(WHY, drives)
        graph.restart('plant')
        graph.wait_for('plant', 'holding the car at its start')
        ear.wait_for_messages(WHY, drives)
        second = stop(graph)
    repair.repair_bag(first)
    whys = read.values(read.load(first), WHY)
    steps = np.diff([why.stamp_ns for why in whys])
    assert (steps > 0).all()
    new = int(steps.argmax()) + 1
    assert drives(whys[:new])
    assert drives(whys[new:])
    assert drives(read.values(second, WHY))
    # the plant that was started again is near its first place, and drives
    x_m = read.columns(second, [STATE])[STATE].x_m
    back = int(np.argmin(np.diff(x_m))) + 1
    assert x_m[back - 1] > 5.0
    assert x_m[back] < 1.0
    assert x_m[-1] > x_m[back] + 5.0
