"""The controller node in this process: which messages are answered, refused and logged, and how."""

import itertools
import math
from functools import partial
from types import SimpleNamespace

import node_bench
import numpy as np
import pytest
from controller_driver import COMMAND, WHY
from wait_until import wait_until

from mpcc_controller.controller_inputs_node import ACTUATORS
from msgs_yaml import decode, encode
from msgs_yaml.types import Actuators, Branch, Obstacle, Obstacles, Predictions, VehicleState
from node_runtime import ros

pytestmark = pytest.mark.ros
START, TICK, S = 1_000_000_000, 50_000_000, 1_000_000_000
PATIENCE_S = 60.0
REFERENCE, EDGES = '/scenario/reference', '/scenario/road_edges'
OBSTACLES, ODOMETRY = '/scenario/obstacles', '/vehicle/odometry'
PREDICTIONS = '/scenario/predictions'
PREDICTION, HEALTH = '/controller/prediction', '/diagnostics'


class Running:
    """A node with its log and what it publishes; its clock is set."""

    def __init__(self, node):
        self.node, self.lines, self.now_ns = node, [], START
        node.wall.now_ns = lambda: self.now_ns
        levels = ('info', 'warning', 'error')
        log = {level: lambda text, **_: self.lines.append(text) for level in levels}
        node.get_logger = lambda: SimpleNamespace(**log)
        self.published = {topic: [] for topic in (COMMAND, PREDICTION, WHY, HEALTH)}
        node.bus.listeners = {topic: [partial(self.on_sent, topic)] for topic in self.published}
        wait_until(lambda: not node.missing_subscribers(), PATIENCE_S, 'nobody listens')

    def on_sent(self, topic, raw):
        self.published[topic].append(ros.deserialize(topic, raw))

    @property
    def whys(self):
        return [decode.why(message) for message in self.published[WHY]]

    @property
    def commands(self):
        return [decode.command(message) for message in self.published[COMMAND]]

    def logged(self, text):
        """Return the lines of the log with a text."""
        return [line for line in self.lines if text in line]

    def send(self, topic, message):
        node_bench.send(self.node, topic, message)

    def send_road(self, situation, stamp_ns=START):
        for topic, message in (
            (REFERENCE, encode.reference(situation.reference._replace(stamp_ns=stamp_ns))),
            (EDGES, encode.road_edges(situation.edges._replace(stamp_ns=stamp_ns))),
        ):
            self.send(topic, message)

    def send_state(self, stamp_ns, X=0.0, vx=20.0):
        message = encode.odometry(VehicleState(stamp_ns, X, 0.0, 0.0, 20.0, 0.0, 0.0))
        message.twist.twist.linear.x = vx
        self.send(ODOMETRY, message)

    def send_obstacles(self, stamp_ns, *items):
        self.send(OBSTACLES, encode.obstacles(Obstacles(stamp_ns, items)))

    def send_actuators(self, stamp_ns, delta=0.02):
        values = Actuators(stamp_ns, delta, 0.0, -600.0, -400.0, (0.0,) * 4)
        self.send(ACTUATORS, encode.actuators(values))

    def tick(self, k, delta=0.02, vx=20.0):
        stamp_ns = START + k * TICK
        self.send_state(stamp_ns, float(k), vx)
        self.send_obstacles(stamp_ns, Obstacle(1, 72.0, 1.5, 1.0, 0.0, 0.0))
        self.send_actuators(stamp_ns, delta)


@pytest.fixture
def lockstep():
    with node_bench.running('controller', 'lockstep') as bench:
        yield Running(bench.node)


@pytest.fixture
def realtime():
    with node_bench.running('controller', 'realtime') as bench:
        yield Running(bench.node)


def test_each_state_is_answered_by_one_command_with_its_stamp(lockstep, world):
    prepared, prepare = [], lockstep.node.controller.prepare
    lockstep.node.controller.prepare = lambda: prepared.append(prepare())
    assert 'waiting for path, road, obstacles, vehicle state' in lockstep.node.waiting()
    lockstep.tick(0)
    lockstep.node.on_timer()
    assert not lockstep.commands, 'there is no path yet'
    lockstep.send_road(world.lane_change())
    (first,), (why,) = lockstep.commands, lockstep.whys
    assert first.stamp_ns == why.stamp_ns == START
    assert why.values['set_point.delta'] == pytest.approx(0.02)
    assert why.values['set_point.Fx'] == pytest.approx(-1000.0)
    assert why.values['rung'] == 'solved'
    assert len(decode.prediction(lockstep.published[PREDICTION][0]).X) == 51
    assert decode.health(lockstep.published[HEALTH][0])[0].name == 'controller'
    assert len(prepared) == 1

    # the plant repeats its first state until it receives a command
    lockstep.tick(0)
    assert lockstep.commands == [first, first]
    # states between ticks are not answered; the next tick needs obstacles of the same stamp
    for k in range(1, 51):
        lockstep.send_state(START + k * S // 1000, X=0.02 * k)
    assert len(lockstep.commands) == 2
    lockstep.send_obstacles(START + TICK)
    assert len(lockstep.commands) == 2
    # and the actuators, as long as these may come
    for _ in range(2):
        lockstep.now_ns += 2 * S
        lockstep.node.on_timer()
    assert [command.stamp_ns for command in lockstep.commands[2:]] == [START + TICK]
    assert lockstep.logged(f'no message of {ACTUATORS} has the stamp of the state')

    # an invalid state is answered as well, by the shifted last plan
    lockstep.send_state(START + 2 * TICK, vx=math.nan)
    lockstep.send_obstacles(START + 2 * TICK)
    why = lockstep.whys[-1]
    assert (why.stamp_ns, lockstep.commands[-1].stamp_ns) == (START + 2 * TICK,) * 2
    assert (why.values['rung'], why.values['reason']) == ('shifted', 'state_not_finite')
    assert why.values['time.publish_ms'] > 0
    assert lockstep.logged('odometry rejected (unreadable)')
    for topic in (REFERENCE, EDGES, OBSTACLES):
        lockstep.send(topic, ros.message_type(topic)())
        assert lockstep.logged(f'{topic} rejected (unreadable)')


def test_actuators_that_are_not_finite_are_rejected_until_valid_ones_arrive(lockstep, world):
    lockstep.send_road(world.lane_change())
    lockstep.tick(0, delta=math.nan)
    assert 'waiting for valid ones' in lockstep.logged('actuators rejected')[0]
    assert not lockstep.commands
    lockstep.tick(0)
    assert lockstep.whys[0].values['set_point.delta'] == pytest.approx(0.02)


def test_actuators_that_do_not_follow_are_logged_once_per_change(lockstep, world):
    lockstep.send_road(world.lane_change())
    for k in range(22):
        lockstep.tick(k, delta=0.3 if k else 0.0)
    assert all('actuators.age_ms' in why.values for why in lockstep.whys)
    faults = [why.values.get('actuators.fault', '') for why in lockstep.whys]
    assert not any(faults[:4])
    assert all('steer' in fault for fault in faults[4:])
    changes = sum(before != after for before, after in itertools.pairwise(faults))
    assert len(lockstep.logged('actuators do not follow: steering angle 0.300 rad')) == changes
    health = decode.health(lockstep.published[HEALTH][-1])[0]
    assert 'steer' in health.values['actuators.fault']


def test_a_restart_does_not_wait_for_actuators_that_nobody_publishes_any_more(
    realtime, world, monkeypatch
):
    node = realtime.node
    node.is_warm = True
    realtime.send_road(world.lane_change())
    realtime.tick(0)
    realtime.node.on_timer()
    assert len(realtime.commands) == 1
    monkeypatch.setattr(node.inputs.newest_actuators, 'has_publisher', lambda: False)
    node.trigger.on_lost(START)
    for k in range(1, 30):
        realtime.now_ns = START + k * TICK
        realtime.send_road(world.lane_change(), realtime.now_ns)
        realtime.send_obstacles(realtime.now_ns)
        realtime.send_state(realtime.now_ns, float(k))
    assert len(realtime.commands) > 5
    assert len(realtime.logged('nobody publishes')) == 1


def test_a_publisher_of_the_actuators_that_leaves_is_waited_for_once(lockstep, world, monkeypatch):
    lockstep.send_road(world.lane_change())
    for k in range(2):
        lockstep.tick(k)
    monkeypatch.setattr(lockstep.node.inputs.newest_actuators, 'has_publisher', lambda: False)
    for k in range(2, 5):
        lockstep.send_state(START + k * TICK, float(k))
        lockstep.send_obstacles(START + k * TICK)
        if k == 2:
            assert len(lockstep.commands) == 2
            for _ in range(2):
                lockstep.now_ns += 2 * S
                lockstep.node.on_timer()
    assert len(lockstep.commands) == 5
    assert len(lockstep.logged(f'no message of {ACTUATORS} has the stamp of the state')) == 1


def test_speeds_up_to_the_least_speed_cause_one_warning_per_path_and_car(lockstep, world):
    def warnings_of(speed, shift_m=0.0):
        lockstep.lines.clear()
        path = world.straight(v=speed).reference
        lockstep.send(
            REFERENCE, encode.reference(path._replace(stamp_ns=START, X=path.X + shift_m))
        )
        return [line.partition(', 7 m/s')[0] for line in lockstep.logged(REFERENCE)]

    below = [f'{REFERENCE} asks for 5.00 m/s, below limits.least_speed_mps']
    lockstep.send_road(world.straight())
    assert warnings_of(5.0) == below
    assert warnings_of(5.0, 1.0) == warnings_of(5.0, 2.0) == warnings_of(20.0) == []
    assert warnings_of(5.0) == below
    near = f'{REFERENCE} asks for 7.00 m/s, at or just above limits.least_speed_mps'
    assert warnings_of(7.0) == [near]
    for k in range(3):
        lockstep.tick(k, vx=6.5)
    assert {why.values['reason'] for why in lockstep.whys} == {'too_slow'}
    (line,) = lockstep.logged('braking to a stop')
    assert 'slower than limits.least_speed_mps, 7 m/s' in line
    assert 'from 8 m/s' in line


def test_an_obstacle_that_breaks_the_contract_is_refused_alone_and_counted(realtime):
    near, far = Obstacle(1, 20.0, 0.0, 1.0, 0.0, 0.0), Obstacle(2, 90.0, 0.0, 1.0, 0.0, 0.0)

    def known_after(items, damage=lambda message: None):
        message = encode.obstacles(Obstacles(START, items))
        damage(message)
        realtime.send(OBSTACLES, message)
        return realtime.node.controller.scene.obstacles.items

    def spoil(message):
        message.markers[1].pose.position.x = math.nan

    for _ in range(3):
        assert known_after((near, far), spoil) == (near,)
    age = realtime.node.watchdog.inputs['obstacles'].diagnostics(START)
    assert (age['age.obstacles_refused'], age['age.obstacles_stale']) == (3, 0)
    assert known_after((near,), lambda message: message.markers.clear()) == ()
    assert known_after((near, far)) == (near, far)
    unreadable = known_after((far, near), lambda message: (spoil(message), message.markers.pop(0)))
    assert unreadable == (near, far)
    alone, whole = realtime.logged('rejected')
    assert alone.startswith(f'object of {OBSTACLES} rejected (field): obstacle 2: ')
    assert whole.startswith(f'{OBSTACLES} rejected (unreadable): ')


def test_a_prediction_that_breaks_the_contract_is_refused_alone_and_the_last_message_stays(
    realtime,
):
    line = np.array([0.0, 1.0])
    branch = Branch(START, 1.0, line, 20.0 + line, line, np.zeros((2, 2, 2)))
    late = branch._replace(t=line[::-1])

    def known_after(message):
        realtime.send(PREDICTIONS, message)
        return [*realtime.node.controller.scene.predictions]

    assert known_after(encode.predictions(Predictions(START, {1: (branch,), 2: (late,)}))) == [1]
    assert known_after(ros.message_type(PREDICTIONS)()) == [1]
    alone, whole = realtime.logged('rejected')
    assert alone.startswith(f'object of {PREDICTIONS} rejected (times): prediction 2: t is 0.0 s')
    assert whole.startswith(f'{PREDICTIONS} rejected (unreadable): ')
    assert known_after(encode.predictions(Predictions(START, {}))) == []


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
def test_a_path_that_cannot_be_used_counts_as_not_received(realtime, world, spoil, reason):
    path, watchdog = world.straight().reference, realtime.node.watchdog

    def send_path(path):
        stamped = path._replace(stamp_ns=realtime.now_ns)
        realtime.send(REFERENCE, encode.reference(stamped))
        return realtime.node.controller.scene.path

    realtime.send_state(START, X=50.0)
    used = send_path(path)
    assert used is not None
    for _ in range(5):
        assert 'reference' not in watchdog.fault(realtime.now_ns)
        realtime.now_ns += S // 4
        assert send_path(spoil(path)) is used
        watchdog.offer('state', realtime.now_ns, realtime.now_ns)
    assert watchdog.fault(realtime.now_ns) == 'reference_stale'
    (line,) = realtime.logged('rejected')
    assert f'{REFERENCE} rejected (unusable): ' in line
    assert reason in line
    send_path(path)
    assert watchdog.fault(realtime.now_ns) == ''


def test_a_path_of_before_the_first_state_is_dropped_if_it_is_elsewhere(realtime, world):
    path, node = world.straight().reference._replace(stamp_ns=START), realtime.node
    for shift_m, dropped in ((2000.0, True), (10.0, False)):
        realtime.send(REFERENCE, encode.reference(path._replace(Y=path.Y + shift_m)))
        assert node.controller.scene.path is not None
        realtime.send_state(START)
        assert node.inputs.refuse_path_elsewhere() == dropped
        assert (node.controller.scene.path is None) == dropped
        node.inputs.state = None
    assert len(realtime.logged('rejected')) == 1
