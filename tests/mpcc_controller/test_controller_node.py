"""The controller node as its own process over Fast DDS; this test is the rest of the ring."""

import itertools
import math
import signal
import subprocess
import sys
import time
from types import SimpleNamespace

import pytest
import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from wait_until import wait_until

from mpcc_controller.controller_inputs_node import ControllerInputs
from mpcc_controller.driving import trigger, watchdog
from mpcc_controller.driving.watchdog import HealthMonitor
from mpcc_controller.parameters import ControllerParams
from msgs_yaml import decode, encode
from msgs_yaml.types import Actuators, VehicleState
from node_runtime import node_parameters, ros, spin_node
from node_runtime.clocks import SteadyClock
from node_runtime.parameters import leaves

pytestmark = pytest.mark.usefixtures('domain')
START, TICK, MS = 1_000_000_000, 50_000_000, 1_000_000
PATIENCE_S = 60.0

NODE = (sys.executable, '-m', 'mpcc_controller.controller_node')


class Ring(Node):
    """Publishes what the controller hears and keeps what it says."""

    def __init__(self, context):
        super().__init__('ring', context=context)
        self.declare_parameter(node_parameters.MODE, 'lockstep')
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
        begin, repeated = time.monotonic(), itertools.count(1)
        due = next(repeated)

        def work():
            nonlocal due
            if time.monotonic() - begin > due:
                due = next(repeated)
                repeat()
            self.executor_.spin_once(timeout_sec=0.05)

        wait_until(done, PATIENCE_S, 'the node did not answer', pause=work)

    def linger(self, seconds):
        end = time.monotonic() + seconds
        while time.monotonic() < end:
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
def ring(domain):
    context = rclpy.context.Context()
    rclpy.init(context=context, domain_id=domain)
    node = Ring(context)
    yield node
    spin_node.shut_down(node, context=context)


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
        [*NODE, *set_to(given)],
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
    assert 'odometry rejected (unreadable)' in process.text()

    # each topic has a line of its own, however quickly they follow each other
    for topic in ('/scenario/reference', '/scenario/road_edges', '/scenario/obstacles'):
        ring.pubs[topic].publish(ros.message_type(topic)())
    for topic in ('/scenario/reference', '/scenario/road_edges', '/scenario/obstacles'):
        ring.wait_for(lambda topic=topic: f'{topic} rejected (unreadable)' in process.text())


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

    ring.wait_for(lambda: 'actuators rejected' in process.text(), begin)
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


def test_speeds_up_to_the_least_one_are_warned_of_once_per_path(ring, process, world):
    situation = world.straight(v=5.0)
    for topic, made in (
        ('/scenario/reference', encode.reference(situation.reference._replace(stamp_ns=START))),
        ('/scenario/road_edges', encode.road_edges(situation.edges._replace(stamp_ns=START))),
    ):
        ring.pubs[topic].publish(made)
    whys = ring.heard['/controller/why']
    for k in range(3):
        stamp, answered = START + k * TICK, len(whys)

        def tell(stamp=stamp):
            ring.state(stamp, vx=6.5)
            ring.actuators(stamp)
            ring.obstacles(situation, stamp)

        tell()
        ring.wait_for(lambda: len(whys) > answered, tell)  # noqa: B023
        assert decode.why(whys[-1]).values['reason'] == 'too_slow'
    said = 'limits.least_speed_mps'
    ring.wait_for(lambda: process.text().count(said) >= 2)
    path, car = (line for line in process.text().splitlines() if said in line)
    assert '/scenario/reference asks for 5.00 m/s, below limits.' in path
    assert 'braking to a stop: slower than limits.least_speed_mps, 7 m/s' in car
    assert 'from 8 m/s' in car
    for line in (path, car):
        assert 'WARN' in line
    faster = world.straight(v=7.0).reference._replace(stamp_ns=START + TICK)
    ring.pubs['/scenario/reference'].publish(encode.reference(faster))
    warning = (
        '/scenario/reference asks for 7.00 m/s, at or just above limits.least_speed_mps, 7 m/s'
    )
    ring.wait_for(lambda: warning in process.text())


def test_a_path_as_slow_as_the_one_before_is_not_warned_of_again(ring, shared_controller, world):
    heard = []
    node = Node('listener', context=ring.context)
    node.declare_parameter(node_parameters.MODE, 'lockstep')
    node.get_logger = lambda: SimpleNamespace(warning=heard.append)
    awake = watchdog.make('lockstep', HealthMonitor('controller'), shared_controller.params.ages)
    inputs = ControllerInputs(
        node, shared_controller, trigger.LockstepTrigger(0.05), awake, SteadyClock(), lambda: None
    )
    try:
        for speed, shift_m in ((5.0, 0.0), (5.0, 1.0), (5.0, 2.0), (20.0, 0.0), (5.0, 0.0)):
            path = world.straight(v=speed).reference
            moved = path._replace(stamp_ns=START, X=path.X + shift_m)
            inputs.on_reference(ros.serialize(encode.reference(moved)))
            assert shared_controller.scene.path.arcs.X[0] == shift_m
    finally:
        inputs.destroy()
        node.destroy_node()
    assert [line.split(' m/s')[0] for line in heard] == 2 * ['/scenario/reference asks for 5.00']


def test_the_log_says_how_many_parameters_come_from_which_file(tmp_path):
    """A small file is a controller: what it leaves out is that of the shipped one."""
    own = tmp_path / 'own.yaml'
    own.write_text('/**:\n  ros__parameters:\n    safety: {obstacle_m: 0.4}\n    car_file: none\n')
    done = subprocess.run(
        [
            sys.executable,
            '-m',
            'mpcc_controller.controller_node',
            '--ros-args',
            '--params-file',
            own,
        ],
        capture_output=True,
        text=True,
        timeout=PATIENCE_S,
    )
    told = done.stdout + done.stderr
    count = len(leaves(ControllerParams))
    left = count - 4  # two optional parameters have no value in any file
    assert f'{left} of {count} parameters are not given and come from ' in told
    assert 'config/mpcc.yaml' in told
    assert 'car_file: package mpcc_controller has no file config/none' in told
    assert done.returncode != 0
    assert 'Traceback' not in told


def test_a_mode_that_the_solver_has_not_stops_the_node_with_its_name():
    names = ('solver.mode:=one_step', 'solver.name:=fatrop')
    done = subprocess.run(
        [*NODE, *set_to(names)],
        capture_output=True,
        text=True,
        timeout=PATIENCE_S,
    )
    assert done.returncode != 0
    assert 'solver.mode: one_step needs solver.name riccati' in done.stdout + done.stderr
    assert 'Traceback' not in done.stdout + done.stderr


def test_a_misspelt_parameter_stops_the_node_with_its_name():
    done = subprocess.run(
        [
            sys.executable,
            '-m',
            'mpcc_controller.controller_node',
            '--ros-args',
            '-p',
            'model.horizn:=9',
        ],
        capture_output=True,
        text=True,
        timeout=PATIENCE_S,
    )
    assert done.returncode != 0
    assert 'model.horizn' in done.stdout + done.stderr
    assert 'Traceback' not in done.stdout + done.stderr
