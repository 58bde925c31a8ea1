"""The controller node as its own process over Fast DDS; this test is the rest of the ring."""

import math
import os
import signal
import subprocess
import sys
import time

import pytest
import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node

from msgs_yaml import decode, encode, overrides, ros, spin_node
from msgs_yaml.types import Actuators, VehicleState

pytestmark = pytest.mark.ros
DOMAIN = 30
START, TICK, MS = 1_000_000_000, 50_000_000, 1_000_000
PATIENCE_S = 30.0
LOCAL = {'ROS_DOMAIN_ID': str(DOMAIN), 'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST'}


class Ring(Node):
    """Publishes what the controller hears and keeps what it says."""

    def __init__(self, context):
        super().__init__('ring', context=context)
        self.declare_parameter(overrides.MODE, 'lockstep')
        self.pubs = {
            name: ros.publisher(self, name)
            for name in (
                '/scenario/reference',
                '/scenario/road_edges',
                '/scenario/obstacles',
                '/vehicle/odometry',
                '/vehicle/actuators',
            )
        }
        self.heard = {name: [] for name in ('/controller/command', '/controller/why')}
        self.heard |= {'/controller/prediction': [], '/diagnostics': []}
        for name, messages in self.heard.items():
            ros.subscribe(self, name, messages.append)
        self.executor_ = SingleThreadedExecutor(context=context)
        self.executor_.add_node(self)

    def wait_for(self, done, repeat=lambda: None):
        """Wait; call `repeat` once per second, as the plant does with its first state."""
        start = time.monotonic()
        repeated = 0
        while not done():
            waited = time.monotonic() - start
            assert waited < PATIENCE_S, 'the node did not answer'
            if waited > repeated + 1:
                repeated += 1
                repeat()
            self.executor_.spin_once(timeout_sec=0.05)

    def linger(self, seconds):
        until = time.monotonic() + seconds
        while time.monotonic() < until:
            self.executor_.spin_once(timeout_sec=0.05)

    def state(self, stamp, X=0.0, vx=20.0):
        message = encode.odometry(VehicleState(stamp, X, 0.0, 0.0, 20.0, 0.0, 0.0))
        message.twist.twist.linear.x = vx
        self.pubs['/vehicle/odometry'].publish(message)

    def actuators(self, stamp, delta=0.02):
        self.pubs['/vehicle/actuators'].publish(
            encode.actuators(Actuators(stamp, delta, 0.0, -600.0, -400.0, (0.0,) * 4))
        )

    def obstacles(self, situation, stamp):
        self.pubs['/scenario/obstacles'].publish(
            encode.obstacles(situation.obstacles._replace(stamp_ns=stamp))
        )


@pytest.fixture(scope='module')
def ring():
    old = {name: os.environ.get(name) for name in LOCAL}
    os.environ.update(LOCAL)
    context = rclpy.context.Context()
    rclpy.init(context=context, domain_id=DOMAIN)
    node = Ring(context)
    yield node
    spin_node.leave(node, context=context)
    for name, value in old.items():
        if value is None:
            del os.environ[name]
        else:
            os.environ[name] = value


def set_to(parameters):
    """Return the arguments that give `name:=value` parameters to a node."""
    pairs = [word for one in parameters for word in ('-p', one)]
    return ['--ros-args', *pairs] if pairs else []


@pytest.fixture
def process(ring, tmp_path, request):
    """Start the node, with indirect parameters; wait for all connections; stop it as a user."""
    given = getattr(request, 'param', ())
    log = (tmp_path / 'log').open('w+')
    started = subprocess.Popen(
        [sys.executable, '-m', 'mpcc_controller.mpcc_node', *set_to(given)],
        env=os.environ | LOCAL,
        stdout=log,
        stderr=subprocess.STDOUT,
    )
    started.text = lambda: (tmp_path / 'log').read_text()
    try:
        ring.wait_for(lambda: all(p.get_subscription_count() for p in ring.pubs.values()))
        ring.wait_for(lambda: ring.count_publishers('/controller/command'))
        yield started
    finally:
        started.send_signal(signal.SIGTERM)
        code = started.wait(10)
        print(started.text())  # shown by pytest when something fails
        assert code == 0
        log.close()


def test_one_state_in_one_command_out_with_the_same_stamp(ring, process, world):
    situation = world.lane_change()
    assert 'waiting for path, road, obstacles, vehicle state' in process.text()

    def begin():
        ring.state(START)
        ring.actuators(START)
        ring.obstacles(situation, START)

    begin()
    ring.linger(0.5)
    assert not ring.heard['/controller/command'], 'there is no path yet'

    ring.pubs['/scenario/reference'].publish(
        encode.reference(situation.reference._replace(stamp_ns=START))
    )
    ring.pubs['/scenario/road_edges'].publish(
        encode.road_edges(situation.edges._replace(stamp_ns=START))
    )
    ring.wait_for(lambda: all(ring.heard.values()), begin)
    first = decode.command(ring.heard['/controller/command'][0])
    why = decode.why(ring.heard['/controller/why'][0])
    assert first.stamp_ns == why.stamp_ns == START
    assert why.values['set_point.delta'] == pytest.approx(0.02)
    assert why.values['set_point.Fx'] == pytest.approx(-1000.0)
    assert why.values['rung'] == 'solved'
    prediction = decode.prediction(ring.heard['/controller/prediction'][0])
    assert len(prediction.X) == 51
    assert decode.health(ring.heard['/diagnostics'][0]).name == 'controller'

    # the plant sends its first state again until it has an answer
    answered = len(ring.heard['/controller/command'])
    ring.state(START)
    ring.wait_for(lambda: len(ring.heard['/controller/command']) > answered)
    assert decode.command(ring.heard['/controller/command'][-1]) == first
    answered = len(ring.heard['/controller/command'])

    # between ticks nothing is answered; on the next one obstacles of the same instant are needed
    for k in range(1, 51):
        ring.state(START + k * MS, X=0.02 * k)
    ring.linger(0.5)
    assert len(ring.heard['/controller/command']) == answered
    ring.obstacles(situation, START + TICK)
    ring.wait_for(lambda: len(ring.heard['/controller/why']) == 2)
    assert decode.command(ring.heard['/controller/command'][-1]).stamp_ns == START + TICK
    assert len(ring.heard['/controller/command']) == answered + 1

    # a state that breaks the contract is answered, too: by the plan before, moved on
    unreadable = START + 2 * TICK
    ring.state(unreadable, vx=math.nan)
    ring.obstacles(situation, unreadable)
    ring.wait_for(lambda: len(ring.heard['/controller/why']) == 3)
    why = decode.why(ring.heard['/controller/why'][-1])
    assert (why.stamp_ns, why.values['reason']) == (unreadable, 'state_not_finite')
    assert why.values['rung'] == 'shifted'
    assert why.values['time.publish_ms'] > 0
    assert decode.command(ring.heard['/controller/command'][-1]).stamp_ns == unreadable
    assert 'odometry turned down' in process.text()


@pytest.mark.parametrize(
    'process', [('solver.mode:=one_step', 'solver.prepare:=true')], indirect=True
)
def test_actuators_that_are_not_finite_are_refused_and_valid_ones_waited_for(ring, process, world):
    for messages in ring.heard.values():  # of the test before
        messages.clear()
    situation = world.lane_change()
    ring.pubs['/scenario/reference'].publish(
        encode.reference(situation.reference._replace(stamp_ns=START))
    )
    ring.pubs['/scenario/road_edges'].publish(
        encode.road_edges(situation.edges._replace(stamp_ns=START))
    )

    def begin(delta=math.nan):
        ring.state(START)
        ring.actuators(START, delta)
        ring.obstacles(situation, START)

    ring.wait_for(lambda: 'actuators turned down' in process.text(), begin)
    assert 'waiting for valid ones' in process.text()
    assert process.poll() is None
    assert not ring.heard['/controller/command']
    begin(delta=0.02)
    ring.wait_for(lambda: ring.heard['/controller/why'], lambda: begin(0.02))
    why = decode.why(ring.heard['/controller/why'][0])
    assert why.values['set_point.delta'] == pytest.approx(0.02)

    # the mode was set over ROS: the next tick was prepared
    ring.state(START + TICK, X=1.0)
    ring.obstacles(situation, START + TICK)
    ring.wait_for(lambda: decode.why(ring.heard['/controller/why'][-1]).stamp_ns > START)
    why = decode.why(ring.heard['/controller/why'][-1])
    assert why.values['reason'] == 'one_step'
    assert why.values['time.ahead_ms'] > 0


def test_a_mode_that_the_solver_has_not_stops_the_node_with_its_name():
    names = ('solver.mode:=one_step', 'solver.name:=fatrop')
    done = subprocess.run(
        [sys.executable, '-m', 'mpcc_controller.mpcc_node', *set_to(names)],
        env=os.environ | LOCAL,
        capture_output=True,
        text=True,
        timeout=PATIENCE_S,
    )
    assert done.returncode != 0
    assert 'solver.mode: one_step needs solver.name riccati' in done.stdout + done.stderr
    assert 'Traceback' not in done.stdout + done.stderr


def test_a_misspelt_parameter_stops_the_node_with_its_name():
    done = subprocess.run(
        [sys.executable, '-m', 'mpcc_controller.mpcc_node', '--ros-args', '-p', 'model.horizn:=9'],
        env=os.environ | LOCAL,
        capture_output=True,
        text=True,
        timeout=PATIENCE_S,
    )
    assert done.returncode != 0
    assert 'model.horizn' in done.stdout + done.stderr
    assert 'Traceback' not in done.stdout + done.stderr
