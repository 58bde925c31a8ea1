"""The controller node as a separate process over Fast DDS; the test plays the other nodes."""

import itertools
import math
import signal
import subprocess
import sys
import time
from types import SimpleNamespace

import pytest
import rclpy
import yaml
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from wait_until import wait_until

from mpcc_controller.controller_inputs_node import ACTUATORS, ControllerInputs
from mpcc_controller.driving import trigger, watchdog
from mpcc_controller.driving.controller import Controller
from mpcc_controller.driving.watchdog import HealthMonitor
from mpcc_controller.parameters import ControllerParams
from msgs_yaml import decode, encode, share
from msgs_yaml.types import Actuators, Obstacle, Obstacles, VehicleState
from node_runtime import node_parameters, ros, spin_node
from node_runtime.clocks import SteadyClock
from node_runtime.parameters import leaves

pytestmark = pytest.mark.usefixtures('domain')
START, TICK, MS = 1_000_000_000, 50_000_000, 1_000_000
PATIENCE_S = 60.0

NODE = (sys.executable, '-m', 'mpcc_controller.controller_node')


class Harness(Node):
    """Publishes the inputs of the controller and records its outputs."""

    def __init__(self, context):
        super().__init__('test_harness', context=context)
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
        self.received = {name: [] for name in ('/controller/command', '/controller/why')}
        self.received |= {'/controller/prediction': [], '/diagnostics': []}
        for name, messages in self.received.items():
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
def harness(domain):
    context = rclpy.context.Context()
    rclpy.init(context=context, domain_id=domain)
    node = Harness(context)
    yield node
    spin_node.shut_down(node, context=context)


def set_to(parameters):
    """Return the arguments that give `name:=value` parameters to a node."""
    pairs = [word for parameter in parameters for word in ('-p', parameter)]
    return ['--ros-args', *pairs] if pairs else []


def run_to_its_end(*arguments):
    """Run a node that ends by itself; return its exit code and what it printed."""
    completed = subprocess.run(
        [*NODE, *arguments], capture_output=True, text=True, timeout=PATIENCE_S
    )
    return completed.returncode, completed.stdout + completed.stderr


@pytest.fixture
def process(harness, tmp_path, request):
    """Start the node with indirect parameters, wait for all connections; end it by SIGTERM."""
    settings = getattr(request, 'param', ())
    log = (tmp_path / 'log').open('w+')
    started = subprocess.Popen(
        [*NODE, *set_to(settings)],
        stdout=log,
        stderr=subprocess.STDOUT,
    )
    started.text = lambda: (tmp_path / 'log').read_text()
    try:
        harness.wait_for(lambda: all(p.get_subscription_count() for p in harness.pubs.values()))
        harness.wait_for(lambda: harness.count_publishers('/controller/command'))
        yield started
    finally:
        started.send_signal(signal.SIGTERM)
        code = started.wait(60)
        print(started.text())  # shown by pytest when something fails
        assert code == 0
        log.close()


def test_each_state_is_answered_by_one_command_with_its_stamp(harness, process, world):
    situation = world.lane_change()
    assert 'waiting for path, road, obstacles, vehicle state' in process.text()

    def begin():
        harness.state(START)
        harness.actuators(START)
        harness.obstacles(situation, START)

    begin()
    harness.linger(0.5)
    assert not harness.received['/controller/command'], 'there is no path yet'

    harness.pubs['/scenario/reference'].publish(
        encode.reference(situation.reference._replace(stamp_ns=START))
    )
    harness.pubs['/scenario/road_edges'].publish(
        encode.road_edges(situation.edges._replace(stamp_ns=START))
    )
    harness.wait_for(lambda: all(harness.received.values()), begin)
    first = decode.command(harness.received['/controller/command'][0])
    why = decode.why(harness.received['/controller/why'][0])
    assert first.stamp_ns == why.stamp_ns == START
    assert why.values['set_point.delta'] == pytest.approx(0.02)
    assert why.values['set_point.Fx'] == pytest.approx(-1000.0)
    assert why.values['rung'] == 'solved'
    prediction = decode.prediction(harness.received['/controller/prediction'][0])
    assert len(prediction.X) == 51
    assert decode.health(harness.received['/diagnostics'][0])[0].name == 'controller'

    # the plant repeats its first state until it receives a command
    answered = len(harness.received['/controller/command'])
    harness.state(START)
    harness.wait_for(lambda: len(harness.received['/controller/command']) > answered)
    assert decode.command(harness.received['/controller/command'][-1]) == first
    answered = len(harness.received['/controller/command'])

    # states between ticks are not answered; the next tick needs obstacles of the same stamp
    for k in range(1, 51):
        harness.state(START + k * MS, X=0.02 * k)
    harness.linger(0.5)
    assert len(harness.received['/controller/command']) == answered
    harness.obstacles(situation, START + TICK)
    harness.wait_for(lambda: len(harness.received['/controller/why']) == 2)
    assert decode.command(harness.received['/controller/command'][-1]).stamp_ns == START + TICK
    assert len(harness.received['/controller/command']) == answered + 1

    assert f'no message of {ACTUATORS} has the stamp of the state' in process.text()

    # an invalid state is answered as well, by the shifted last plan
    unreadable = START + 2 * TICK
    harness.state(unreadable, vx=math.nan)
    harness.obstacles(situation, unreadable)
    harness.wait_for(lambda: len(harness.received['/controller/why']) == 3)
    why = decode.why(harness.received['/controller/why'][-1])
    assert (why.stamp_ns, why.values['reason']) == (unreadable, 'state_not_finite')
    assert why.values['rung'] == 'shifted'
    assert why.values['time.publish_ms'] > 0
    assert decode.command(harness.received['/controller/command'][-1]).stamp_ns == unreadable
    assert 'odometry rejected (unreadable)' in process.text()

    # each topic is logged separately, even if the messages arrive in quick succession
    for topic in ('/scenario/reference', '/scenario/road_edges', '/scenario/obstacles'):
        harness.pubs[topic].publish(ros.message_type(topic)())
    for topic in ('/scenario/reference', '/scenario/road_edges', '/scenario/obstacles'):
        harness.wait_for(lambda topic=topic: f'{topic} rejected (unreadable)' in process.text())


@pytest.mark.parametrize(
    'process', [('solver.mode:=one_step', 'solver.prepare:=true')], indirect=True
)
def test_actuators_that_are_not_finite_are_rejected_until_valid_ones_arrive(
    harness, process, world
):
    for messages in harness.received.values():  # of the previous test
        messages.clear()
    situation = world.lane_change()
    harness.pubs['/scenario/reference'].publish(
        encode.reference(situation.reference._replace(stamp_ns=START))
    )
    harness.pubs['/scenario/road_edges'].publish(
        encode.road_edges(situation.edges._replace(stamp_ns=START))
    )

    def begin(delta=math.nan):
        harness.state(START)
        harness.actuators(START, delta)
        harness.obstacles(situation, START)

    harness.wait_for(lambda: 'actuators rejected' in process.text(), begin)
    assert 'waiting for valid ones' in process.text()
    assert process.poll() is None
    assert not harness.received['/controller/command']
    begin(delta=0.02)
    harness.wait_for(lambda: harness.received['/controller/why'], lambda: begin(0.02))
    why = decode.why(harness.received['/controller/why'][0])
    assert why.values['set_point.delta'] == pytest.approx(0.02)

    # the mode was set over ROS: the next tick was prepared
    harness.state(START + TICK, X=1.0)
    harness.obstacles(situation, START + TICK)
    harness.wait_for(lambda: decode.why(harness.received['/controller/why'][-1]).stamp_ns > START)
    why = decode.why(harness.received['/controller/why'][-1])
    assert why.values['reason'] == 'one_step'
    assert why.values['time.ahead_ms'] > 0


def test_actuators_that_do_not_follow_are_logged_once_per_change(harness, process, world):
    situation, whys = world.lane_change(), harness.received['/controller/why']
    for messages in harness.received.values():  # of the previous test
        messages.clear()
    for topic, message in (
        ('/scenario/reference', encode.reference(situation.reference._replace(stamp_ns=START))),
        ('/scenario/road_edges', encode.road_edges(situation.edges._replace(stamp_ns=START))),
    ):
        harness.pubs[topic].publish(message)
    for k in range(22):
        stamp, answered = START + k * TICK, len(whys)

        def publish_inputs(stamp=stamp, k=k):
            harness.state(stamp, X=float(k))
            harness.obstacles(situation, stamp)
            harness.actuators(stamp, delta=0.3 if k else 0.0)  # last: the answer waits for it

        publish_inputs()
        harness.wait_for(lambda: len(whys) > answered, publish_inputs)  # noqa: B023
    reports = [decode.why(message) for message in whys]
    assert all('actuators.age_ms' in why.values for why in reports)
    faults = [why.values.get('actuators.fault', '') for why in reports]
    assert not any(faults[:4])
    assert all('steer' in fault for fault in faults[4:])
    changes = sum(before != after for before, after in itertools.pairwise(faults))
    line = 'actuators do not follow: steering angle 0.300 rad'
    harness.wait_for(lambda: process.text().count(line) == changes)
    health = [decode.health(message)[0] for message in harness.received['/diagnostics']]
    assert 'steer' in health[-1].values['actuators.fault']


def test_speeds_up_to_the_least_speed_cause_one_warning_per_path(harness, process, world):
    situation = world.straight(v=5.0)
    for topic, message in (
        ('/scenario/reference', encode.reference(situation.reference._replace(stamp_ns=START))),
        ('/scenario/road_edges', encode.road_edges(situation.edges._replace(stamp_ns=START))),
    ):
        harness.pubs[topic].publish(message)
    whys = harness.received['/controller/why']
    for k in range(3):
        stamp, answered = START + k * TICK, len(whys)

        def publish_inputs(stamp=stamp):
            harness.state(stamp, vx=6.5)
            harness.actuators(stamp)
            harness.obstacles(situation, stamp)

        publish_inputs()
        harness.wait_for(lambda: len(whys) > answered, publish_inputs)  # noqa: B023
        assert decode.why(whys[-1]).values['reason'] == 'too_slow'
    parameter = 'limits.least_speed_mps'
    harness.wait_for(lambda: process.text().count(parameter) >= 2)
    # the output of a process may arrive in another order than it was written
    lines = [line for line in process.text().splitlines() if parameter in line]
    path, car = sorted(lines, key=lambda line: 'braking' in line)
    assert '/scenario/reference asks for 5.00 m/s, below limits.' in path
    assert 'braking to a stop: slower than limits.least_speed_mps, 7 m/s' in car
    assert 'from 8 m/s' in car
    for line in (path, car):
        assert 'WARN' in line
    faster = world.straight(v=7.0).reference._replace(stamp_ns=START + TICK)
    harness.pubs['/scenario/reference'].publish(encode.reference(faster))
    warning = (
        '/scenario/reference asks for 7.00 m/s, at or just above limits.least_speed_mps, 7 m/s'
    )
    harness.wait_for(lambda: warning in process.text())


def test_a_path_as_slow_as_the_previous_one_is_not_warned_of_again(
    harness, shared_controller, world
):
    warnings = []
    node = Node('listener', context=harness.context)
    node.declare_parameter(node_parameters.MODE, 'lockstep')
    node.get_logger = lambda: SimpleNamespace(warning=warnings.append)
    lockstep = watchdog.make('lockstep', HealthMonitor('controller'), shared_controller.params.ages)
    inputs = ControllerInputs(
        node,
        shared_controller,
        trigger.LockstepTrigger(0.05),
        lockstep,
        SteadyClock(),
        lambda: None,
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
    assert [line.split(' m/s')[0] for line in warnings] == 2 * ['/scenario/reference asks for 5.00']


def test_an_obstacle_that_breaks_the_contract_is_refused_alone_and_counted(
    harness, shared_controller
):
    """In realtime, where the ages of inputs count."""
    warnings = []
    node = Node('driver', context=harness.context)
    node.declare_parameter(node_parameters.MODE, 'realtime')
    node.get_logger = lambda: SimpleNamespace(warning=warnings.append)
    clock, ages = SteadyClock(), shared_controller.params.ages
    realtime = watchdog.make('realtime', HealthMonitor('controller'), ages)
    inputs = ControllerInputs(
        node, shared_controller, trigger.RealtimeTrigger(0.05), realtime, clock, lambda: None
    )

    def receive(items, damage=lambda message: None):
        message = encode.obstacles(Obstacles(clock.now_ns(), items))
        damage(message)
        inputs.on_obstacles(ros.serialize(message))

    def spoil(message):
        message.markers[1].pose.position.x = math.nan

    near, far = Obstacle(1, 20.0, 0.0, 1.0, 0.0, 0.0), Obstacle(2, 90.0, 0.0, 1.0, 0.0, 0.0)
    try:
        for _ in range(3):
            receive((near, far), spoil)
            assert shared_controller.scene.obstacles.items == (near,)
        age = realtime.inputs['obstacles'].diagnostics(clock.now_ns())
        assert (age['age.obstacles_refused'], age['age.obstacles_stale']) == (3, 0)
        receive((near,), lambda message: message.markers.clear())
        assert shared_controller.scene.obstacles.items == ()
        receive((near, far))
        receive((far, near), lambda message: (spoil(message), message.markers.pop(0)))
        assert shared_controller.scene.obstacles.items == (near, far)
    finally:
        inputs.destroy()
        node.destroy_node()
    alone, whole = warnings
    assert alone.startswith('object of /scenario/obstacles rejected (field): obstacle 2: ')
    assert whole.startswith('/scenario/obstacles rejected (unreadable): ')


@pytest.fixture
def realtime_inputs(harness, params, vehicle, world):
    """Return the inputs of a node in realtime whose clock stands, its watchdog and its log."""
    lines, clock = [], SimpleNamespace(stamp_ns=START, now_ns=lambda: clock.stamp_ns)
    node = Node('listener', context=harness.context)
    node.declare_parameter(node_parameters.MODE, 'realtime')
    node.get_logger = lambda: SimpleNamespace(warning=lines.append)
    ages = watchdog.make('realtime', HealthMonitor('controller'), params.ages)
    controller = Controller(params, vehicle)
    inputs = ControllerInputs(
        node, controller, trigger.RealtimeTrigger(0.05), ages, clock, lambda: None
    )
    yield SimpleNamespace(
        inputs=inputs, controller=controller, watchdog=ages, clock=clock, lines=lines
    )
    inputs.destroy()
    node.destroy_node()


def reversed_path(path):
    return path._replace(X=path.X[::-1], Y=path.Y[::-1], psi=path.psi[::-1] + math.pi)


@pytest.mark.parametrize(
    ('spoil', 'reason'),
    [
        (lambda path: path._replace(psi=path.psi + math.pi), 'its heading points backwards'),
        (reversed_path, 'the path runs against the motion of the car'),
        (lambda path: path._replace(Y=path.Y + 2000.0), 'the path is 2000 m from the car'),
    ],
)
def test_a_path_that_cannot_be_used_counts_as_not_received(realtime_inputs, world, spoil, reason):
    n, path = realtime_inputs, world.straight().reference
    n.inputs.on_odometry(ros.serialize(encode.odometry(world.rolling(X=50.0, stamp_ns=START))))
    n.inputs.on_reference(ros.serialize(encode.reference(path._replace(stamp_ns=START))))
    used = n.controller.scene.path
    assert used is not None
    for _ in range(5):
        assert 'reference' not in n.watchdog.fault(n.clock.stamp_ns)
        n.clock.stamp_ns += 250_000_000
        bad = spoil(path)._replace(stamp_ns=n.clock.stamp_ns)
        n.inputs.on_reference(ros.serialize(encode.reference(bad)))
        n.watchdog.offer('state', n.clock.stamp_ns, n.clock.stamp_ns)
    assert n.watchdog.fault(n.clock.stamp_ns) == 'reference_stale'
    assert n.controller.scene.path is used
    assert len(n.lines) == 1
    assert '/scenario/reference rejected (unusable): ' in n.lines[0]
    assert reason in n.lines[0]
    n.inputs.on_reference(ros.serialize(encode.reference(path._replace(stamp_ns=n.clock.stamp_ns))))
    assert n.watchdog.fault(n.clock.stamp_ns) == ''


def test_a_path_of_before_the_first_state_is_dropped_if_it_is_elsewhere(realtime_inputs, world):
    n, path = realtime_inputs, world.straight().reference._replace(stamp_ns=START)
    for shift_m, dropped in ((2000.0, True), (10.0, False)):
        elsewhere = ros.serialize(encode.reference(path._replace(Y=path.Y + shift_m)))
        n.inputs.on_reference(elsewhere)
        assert n.controller.scene.path is not None
        n.inputs.on_odometry(ros.serialize(encode.odometry(world.rolling(stamp_ns=START))))
        assert n.inputs.refuse_path_elsewhere() == dropped
        assert (n.controller.scene.path is None) == dropped
        n.inputs.state = None
    assert len(n.lines) == 1


def test_the_log_names_the_number_of_parameters_from_each_file(tmp_path):
    """A file may set a few parameters; the others take the values of the shipped file."""
    own = tmp_path / 'own.yaml'
    own.write_text('/**:\n  ros__parameters:\n    safety: {obstacle_m: 0.4}\n    car_file: none\n')
    returncode, output = run_to_its_end('--ros-args', '--params-file', str(own))
    count = len(leaves(ControllerParams))
    shipped = yaml.safe_load(share.path('mpcc_controller', 'config', 'mpcc.yaml').read_text())
    groups = shipped['/**']['ros__parameters'].values()
    left = sum(len(group) if isinstance(group, dict) else 1 for group in groups) - 2
    assert f'{left} of {count} parameters are not given and come from ' in output
    assert 'config/mpcc.yaml' in output
    assert 'car_file: package mpcc_controller has no file config/none' in output
    assert returncode != 0
    assert 'Traceback' not in output


@pytest.mark.parametrize(
    ('parameters', 'message'),
    [
        (('model.horizn:=9',), 'model.horizn'),
        (('limits.brake_n:=0.0',), 'limits.brake_n: is 0; allowed from 14000'),
        (('limits.force_rate_nps:=1.0',), 'limits.force_rate_nps: is 1; allowed from 28000'),
    ],
)
def test_a_parameter_that_cannot_be_used_stops_the_node_and_is_named(parameters, message):
    returncode, output = run_to_its_end(*set_to(parameters))
    assert returncode != 0
    assert message in output
    assert 'Traceback' not in output
