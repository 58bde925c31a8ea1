"""Nodes that are killed in mid-run and started again, each over real Fast DDS."""

import signal
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from bags.experiments import processes
from bags.storage import read, repair
from msgs_yaml import share

sys.path.insert(0, str(Path(__file__).parent))

from rings import ROLES, Ring

pytestmark = pytest.mark.ros
DOMAIN = 66
STATE, COMMAND, WHY = '/vehicle/odometry', '/controller/command', '/controller/why'
PATIENCE_S = 30.0
TICK_NS = 50_000_000
LATELY = 8  # commands, of which one may be late where this machine is busy
DRIVEN_S = 0.5  # before the kill, and after all are back
# fast, long and slippery: a car that brakes meanwhile takes 11 s until it is too slow to drive on
HIGHWAY = {
    'name: straight': 'name: straight\nsampling: {path_m: 5.0, edges_m: 5.0}',
    'length_m: 140.0': 'length_m: 4000.0',
    'length_m: 120.0': 'length_m: 3900.0',
    'constant_mps: 15.0': 'constant_mps: 40.0',
    'friction: 1.0': 'friction: 0.3',
    'progress_m: 60.0, time_s: 10.0': 'progress_m: 3800.0, time_s: 600.0',
}
HOLDS = {'plant': {'command_age_s': 1.0, 'lockstep_timeout_s': 16.0}}


@pytest.fixture
def highway(tmp_path):
    text = share.path('scenario_publisher', 'scenarios', 'straight.yaml').read_text()
    for old, new in HIGHWAY.items():
        assert old in text
        text = text.replace(old, new)
    file = tmp_path / 'straight.yaml'
    file.write_text(text)
    return str(file)


def begin(ring):
    for role in ROLES:
        ring.start(role)
    ring.wait_for('controller', 'started from the actuators')
    time.sleep(DRIVEN_S)


def restart(ring, role):
    ring.running[role].popen.send_signal(signal.SIGKILL)
    ring.wait(role)
    ring.start(role)


def whys(ring):
    """End the ring; return what the controllers said, in the order of their saying."""
    time.sleep(DRIVEN_S)
    processes.stop([ring.running['controller']])  # first: it is not to miss the others
    processes.stop([ring.running[role] for role in ('plant', 'scenario')])
    return read.values(ring.recorded(), WHY)


def solved(found):
    return 'solved' in {one.values['rung'] for one in found}


@pytest.mark.parametrize('mode', ['lockstep', 'realtime'])
def test_a_controller_started_again_drives_on(mode, highway, tmp_path):
    with Ring(tmp_path, DOMAIN, mode, highway, **HOLDS) as ring:
        begin(ring)
        restart(ring, 'controller')
        ring.wait_for('controller', 'started from the actuators', PATIENCE_S)
        found = whys(ring)
    assert solved(found[:LATELY])
    assert solved(found[-LATELY:])
    assert found[-1].stamp_ns > found[0].stamp_ns
    if mode == 'lockstep':  # time waited; what was on its way when the old one died may be missing
        steps = np.diff([one.stamp_ns for one in found])
        assert set(steps % TICK_NS) == {0}
        assert np.count_nonzero(steps > TICK_NS) <= 1
        assert {one.values['rung'] for one in found} == {'solved'}


@pytest.mark.parametrize('mode', ['lockstep', 'realtime'])
def test_a_scenario_started_again_is_believed_again(mode, highway, tmp_path):
    with Ring(tmp_path, DOMAIN, mode, highway, **HOLDS) as ring:
        begin(ring)
        restart(ring, 'scenario')
        if mode == 'realtime':
            ring.wait_for('controller', 'every input is back', PATIENCE_S)
        else:
            ring.wait_for('plant', 'sending the present state again', PATIENCE_S)
        found = whys(ring)
    assert solved(found[-LATELY:])
    stale = [one for one in found if one.values['reason'] == 'obstacles_stale']
    assert bool(stale) == (mode == 'realtime')


def test_a_plant_started_again_is_a_new_run(highway, tmp_path):
    with Ring(tmp_path, DOMAIN, 'realtime', highway, **HOLDS) as ring:
        begin(ring)
        restart(ring, 'plant')
        ring.wait_for('plant', 'holding the car at its start', PATIENCE_S)
        time.sleep(2 * DRIVEN_S)
        found = whys(ring)
        x_m = read.columns(read.load(ring.bag), [STATE])[STATE].x_m
    back = int(np.argmin(np.diff(x_m))) + 1
    assert x_m[back - 1] > 5.0
    assert x_m[back] == x_m[0]
    assert x_m[-1] > x_m[0] + 5.0
    assert solved(found[-LATELY:])


def test_a_recorder_started_again_needs_a_new_folder_and_takes_up_the_run(highway, tmp_path):
    with Ring(tmp_path, DOMAIN, 'realtime', highway, **HOLDS) as ring:
        begin(ring)
        first, node = ring.bag, ring.nodes['recorder']
        restart(ring, 'recorder')
        assert ring.wait('recorder') != 0
        assert 'out: ' in ring.said('recorder')
        ring.bag = tmp_path / 'second'
        ring.nodes['recorder'] = node._replace(parameters=node.parameters | {'out': str(ring.bag)})
        ring.start('recorder')
        ring.wait_for('recorder', WHY, PATIENCE_S)  # the nodes find each other one by one
        found = whys(ring)
    repair.repair(first)
    before = read.values(read.load(first), WHY)
    assert before[-1].stamp_ns < found[0].stamp_ns
    assert solved(before)
    assert solved(found)
