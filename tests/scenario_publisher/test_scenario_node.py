"""The node as a process of its own, heard over Fast DDS."""

import signal
import subprocess
import sys

import numpy as np
import pytest
import rclpy
from builtin_interfaces.msg import Time
from rclpy.executors import SingleThreadedExecutor
from wait_until import wait_until

from msgs_yaml import contract, decode, encode
from node_runtime import ros, spin_node
from scenario_publisher import scenario
from scenario_publisher.scenario import START_NS

pytestmark = pytest.mark.usefixtures('domain')
PATIENCE_S = 60.0
TICK_NS = 50_000_000
PATH, EDGES = '/scenario/reference', '/scenario/road_edges'
OBSTACLES = '/scenario/obstacles'


@pytest.fixture(scope='module')
def listener(domain):
    """A node of this process, alone in its domain with what the tests start."""
    context = rclpy.Context()
    rclpy.init(context=context, domain_id=domain)
    node = rclpy.create_node('listener', context=context)
    yield Listener(node)
    spin_node.shut_down(node, context=context)


class Listener:
    """Subscribes, publishes, and waits until something has been heard."""

    def __init__(self, node):
        self.node = node
        self.executor = SingleThreadedExecutor(context=node.context)
        self.executor.add_node(node)

    def hear(self, topic, mode='lockstep'):
        """Return a list that fills with the messages of a topic."""
        received = []
        profile = ros.to_qos_profile(contract.load().topics[topic].qos[mode])
        self.node.create_subscription(ros.message_type(topic), topic, received.append, profile)
        return received

    def speak(self, topic, mode='lockstep'):
        """Return a publisher for a topic."""
        profile = ros.to_qos_profile(contract.load().topics[topic].qos[mode])
        return self.node.create_publisher(ros.message_type(topic), topic, profile)

    def wait_until(self, done):
        """Listen until a condition holds; fail when it takes too long."""
        wait_until(
            done,
            PATIENCE_S,
            'nothing heard in time',
            pause=lambda: self.executor.spin_once(timeout_sec=0.05),
        )

    def tick_until_heard(self, clock, received):
        """Repeat the first instant until it is answered: both directions are connected then."""
        clock_msg = encode.clock(START_NS)
        self.wait_until(lambda: clock.publish(clock_msg) or received)


def start(*arguments):
    command = [sys.executable, '-m', 'scenario_publisher.scenario_node', '--ros-args', *arguments]
    return subprocess.Popen(command, stderr=subprocess.PIPE, text=True)


def stop(process):
    process.send_signal(signal.SIGTERM)
    try:
        _, output = process.communicate(timeout=PATIENCE_S)
    except subprocess.TimeoutExpired:
        process.kill()
        raise
    return process.returncode, output


@pytest.fixture
def node(request):
    """The running node; its parameters come from the test."""
    process = start(*request.param)
    yield process
    if process.poll() is None:
        stop(process)


def runs(scenario_name, mode='lockstep'):
    given = ('-p', f'scenario:={scenario_name}', '-p', f'mode:={mode}')
    return pytest.mark.parametrize('node', [given], indirect=True, ids=[f'{scenario_name}-{mode}'])


def same(one, other):
    return all(np.allclose(a, b, rtol=0, atol=1e-8) for a, b in zip(one, other))


@runs('moving_obstacle')
def test_road_and_obstacles_are_published_at_the_stamps_of_the_clock(listener, node):
    scn = scenario.load('moving_obstacle')
    early, health = listener.hear(PATH), listener.hear('/diagnostics')
    listener.wait_until(lambda: early)
    # who comes late still gets path and edges
    road = {topic: listener.hear(topic) for topic in (PATH, EDGES)}
    clock, received = listener.speak('/clock'), listener.hear(OBSTACLES)
    listener.tick_until_heard(clock, received)
    stamps = [START_NS + k * TICK_NS for k in (*range(1, 11), 40, 120)]
    for k, stamp_ns in enumerate(stamps, 1):
        clock.publish(encode.clock(stamp_ns))
        listener.wait_until(
            lambda stamp_ns=stamp_ns: decode.obstacles(received[-1]).stamp_ns == stamp_ns
        )
        # latched topics keep one message: hear each before it is replaced
        count = 1 + min(k, 10) // 5 + max(k - 10, 0)
        listener.wait_until(lambda count=count: all(len(road[t]) >= count for t in road))
    answers = [decode.obstacles(message) for message in received]
    after_start = [answer for answer in answers if answer.stamp_ns > START_NS]
    assert [answer.stamp_ns for answer in after_start] == stamps
    assert [len(answer.items) for answer in after_start] == [1] * 11 + [2]
    for answer in answers:
        wanted = scenario.obstacles_at(scn, (answer.stamp_ns - START_NS) * 1e-9, answer.stamp_ns)
        assert all(same(a, b) for a, b in zip(answer.items, wanted.items))
    # unchanged every 250 ms
    paths, edges = map(decode.reference, road[PATH]), map(decode.road_edges, road[EDGES])
    for values, wanted in ((list(paths), scn.reference), (list(edges), scn.edges)):
        assert [value.stamp_ns for value in values] == [
            START_NS,
            *(stamps[k] for k in (4, 9, 10, 11)),
        ]
        assert all(same(value[1:], wanted[1:]) for value in values)
    # published after the obstacles of the same stamp
    listener.wait_until(lambda: decode.health(health[-1])[0].values['obstacles'] == 2)
    (status,) = decode.health(health[-1])
    assert (status.name, status.level) == ('scenario', 0)
    code, output = stop(node)
    assert code == 0
    assert 'Traceback' not in output


@runs('straight')
def test_time_that_goes_on_without_a_listener_of_obstacles_is_answered(listener, node):
    clock, edges = listener.speak('/clock'), listener.hear(EDGES)
    listener.wait_until(lambda: edges and clock.get_subscription_count())
    for k in range(6):  # of a controller that takes no notice of obstacles
        clock.publish(encode.clock(START_NS + k * TICK_NS))
    listener.wait_until(lambda: len(edges) > 1)
    assert decode.road_edges(edges[1]).stamp_ns == START_NS + 5 * TICK_NS
    received = listener.hear(OBSTACLES)  # a road without obstacles says so
    listener.wait_until(lambda: clock.publish(encode.clock(START_NS + 6 * TICK_NS)) or received)
    assert decode.obstacles(received[0]).items == ()


@runs('moving_obstacle', mode='realtime')
def test_on_the_wall_clock_obstacles_move_once_the_vehicle_does(listener, node):
    received = listener.hear(OBSTACLES, 'realtime')
    starts, statuses = (
        listener.speak('/vehicle/run_start', 'realtime'),
        listener.hear('/diagnostics'),
    )
    listener.wait_until(lambda: statuses and starts.get_subscription_count())
    (waiting,) = decode.health(statuses[0])
    assert (waiting.name, waiting.level) == ('scenario', 3)
    assert 'plant' in waiting.message
    assert not received
    # repeated as by a plant: the first ones may come before the node knows their publisher
    held = encode.run_start(0)
    listener.wait_until(lambda: starts.publish(held) or len(received) >= 5)
    waiting = [decode.obstacles(message).items[0].X for message in received]
    assert waiting == pytest.approx([60.0] * len(waiting))
    now = listener.node.get_clock().now().nanoseconds
    starts.publish(encode.run_start(now))
    listener.wait_until(lambda: decode.obstacles(received[-1]).items[0].X > 65.0)
    starts.publish(Time(sec=-1))  # no instant: the last one stands
    listener.wait_until(lambda: decode.obstacles(received[-1]).items[0].X > 70.0)
    last = decode.obstacles(received[-1])
    assert pytest.approx(60.0 + 8.0 * (last.stamp_ns - now) * 1e-9, abs=1e-6) == last.items[0].X
    stamps = np.array([decode.obstacles(message).stamp_ns for message in received])
    # a busy machine leaves instants out: the rate is tested without a node
    assert np.median(np.diff(stamps)) * 1e-9 > 0.04


def test_an_unknown_or_broken_scenario_is_one_clear_line_and_a_failure(tmp_path):
    broken = tmp_path / 'broken.yaml'
    broken.write_text(scenario.load('straight').text.replace('friction: 1.0', 'friction: 7'))
    wrong = {
        'nowhere': "no scenario 'nowhere'; available: bend_inside_fast, bend",
        str(broken): f'{broken}:21: friction: is 7; allowed 0.05 to 1.5',
    }
    for name, message in wrong.items():
        _, output = (process := start('-p', f'scenario:={name}')).communicate(timeout=PATIENCE_S)
        assert process.returncode not in (0, None)
        assert message in output
        assert 'Traceback' not in output
