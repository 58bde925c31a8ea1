"""Nodes that are killed in mid-run and started again, each over real Fast DDS.

On the wall clock they are killed one after the other in one drive, which the tests share.
"""

import signal
import time
from types import SimpleNamespace

import numpy as np
import pytest
from node_graph import ROLES, NodeGraph
from straight_road import LONG, write_straight
from wait_until import wait_until

from bags.storage import read, repair
from experiments.run import processes

pytestmark = pytest.mark.usefixtures('domain')
STATE, COMMAND, WHY = '/vehicle/odometry', '/controller/command', '/controller/why'
PATIENCE_S = 60.0
TICK_NS = 50_000_000
FAST_MPS = 35.0
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


def begin(graph):
    for role in ROLES:
        graph.start(role)
    graph.wait_for('controller', 'started from the actuators')
    graph.wait_for_messages(WHY, drives, PATIENCE_S)


def size(bag):
    return sum(file.stat().st_size for file in bag.glob('*.mcap'))


def restart(graph, role):
    graph.running[role].popen.send_signal(signal.SIGKILL)
    graph.wait(role)
    graph.start(role)


def whys(graph):
    """Wait until the car drives, end the nodes; return all messages of /controller/why."""
    graph.wait_for_messages(WHY, drives, PATIENCE_S)
    processes.stop([graph.running['controller']])  # first: it is not to miss the others
    processes.stop([graph.running[role] for role in ('plant', 'scenario')])
    return read.values(graph.stop_recording(), WHY)


def drives(found):
    """Tell whether somewhere in a row of answers all were solved, but one."""
    solved = [one.values['rung'] == 'solved' for one in found]
    rows = (solved[k : k + IN_A_ROW] for k in range(len(solved) - IN_A_ROW + 1))
    return any(sum(row) >= IN_A_ROW - 1 for row in rows)


@pytest.fixture
def whys_in_lockstep(highway, tmp_path, domain):
    """Return a function that starts `restarted` again, waits for `role` to say so, and drives."""

    def drive(restarted, role, message):
        with NodeGraph(tmp_path, domain, 'lockstep', highway, **HOLDS) as graph:
            begin(graph)
            restart(graph, restarted)
            graph.wait_for(role, message, PATIENCE_S)
            return whys(graph)

    return drive


@pytest.mark.smoke
def test_in_lockstep_a_controller_started_again_drives_on(whys_in_lockstep):
    found = whys_in_lockstep('controller', 'controller', 'started from the actuators')
    steps = np.diff([one.stamp_ns for one in found])
    # time waited; what was on its way when the old one died may be missing
    assert (steps > 0).all()
    assert set(steps % TICK_NS) == {0}
    assert np.count_nonzero(steps > TICK_NS) <= 1
    assert {one.values['rung'] for one in found} == {'solved'}


def test_in_lockstep_a_scenario_started_again_is_believed_again(whys_in_lockstep):
    found = whys_in_lockstep('scenario', 'plant', 'sending the present state again')
    assert not any(one.values['reason'] == 'obstacles_stale' for one in found)


@pytest.fixture(scope='module')
def realtime(highway, tmp_path_factory, domain, wall_clock):
    """Return what was recorded of one drive in which every node was started again."""
    folder = tmp_path_factory.mktemp('restarts')
    settings = wall_clock.with_priority(**HOLDS)
    with (
        wall_clock.own_drive(),
        NodeGraph(folder, domain, 'realtime', highway, **settings) as graph,
    ):
        begin(graph)
        restart(graph, 'controller')
        graph.wait_for('plant', 'no command comes, braking straight', PATIENCE_S)
        graph.wait_for('controller', 'started from the actuators', PATIENCE_S)
        graph.wait_for('plant', 'commands are back', PATIENCE_S)
        graph.wait_for_messages(WHY, drives, PATIENCE_S)
        first, node = graph.bag, graph.nodes['recorder']
        written = size(first)
        wait_until(lambda: size(first) > written, PATIENCE_S, 'the recorder closes no chunk')
        restart(graph, 'recorder')
        in_use = SimpleNamespace(exit_code=graph.wait('recorder'), log=graph.log('recorder'))
        graph.bag = folder / 'second'
        graph.nodes['recorder'] = node._replace(
            parameters=node.parameters | {'out': str(graph.bag)}
        )
        graph.start('recorder')
        graph.wait_for('recorder', WHY, PATIENCE_S)  # the nodes find each other one by one
        # without a controller it braked: it is to be fast again before it brakes once more
        graph.wait_for_messages(
            STATE, lambda found: bool(found) and found[-1].vx > FAST_MPS, PATIENCE_S
        )
        restarted_ns = time.time_ns()
        restart(graph, 'scenario')
        graph.wait_for('controller', 'every input is back', PATIENCE_S)
        graph.wait_for_messages(WHY, drives, PATIENCE_S)
        restart(graph, 'plant')
        graph.wait_for('plant', 'holding the car at its start', PATIENCE_S)
        second_whys = whys(graph)
        x_m = read.columns(read.load(graph.bag), [STATE])[STATE].x_m
    repair.repair_bag(first)
    first_whys = read.values(read.load(first), WHY)
    return SimpleNamespace(
        first_whys=first_whys,
        second_whys=second_whys,
        second_x_m=x_m,
        folder_in_use=in_use,
        scenario_restarted_ns=restarted_ns,
    )


def test_a_controller_started_again_drives_on(realtime):
    steps = np.diff([one.stamp_ns for one in realtime.first_whys])
    assert (steps > 0).all()
    new = int(steps.argmax()) + 1
    assert drives(realtime.first_whys[:new])
    assert drives(realtime.first_whys[new:])


def test_a_scenario_started_again_is_believed_again(realtime):
    after = [one for one in realtime.second_whys if one.stamp_ns > realtime.scenario_restarted_ns]
    # from the first time on: on a busy machine obstacles may be late once more, at the very end
    stale = [one.values['reason'] for one in after].index('obstacles_stale')
    assert drives(after[stale:])


def test_a_recorder_started_again_needs_a_new_folder_and_takes_up_the_run(realtime):
    assert realtime.folder_in_use.exit_code != 0
    assert 'out: ' in realtime.folder_in_use.log
    assert realtime.first_whys[-1].stamp_ns < realtime.second_whys[0].stamp_ns
    assert drives(realtime.second_whys)


def test_a_plant_started_again_is_a_new_run(realtime):
    x_m = realtime.second_x_m
    back = int(np.argmin(np.diff(x_m))) + 1
    assert x_m[back - 1] > 5.0
    # near its first place: the second recorder came when the first car was far away
    assert x_m[back] < 1.0
    assert x_m[-1] > x_m[back] + 5.0
