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
    return all(np.allclose(a, b, rtol=0, atol=1e-9) for a, b in zip(one, other))


@runs('circle_20m')
def test_who_comes_late_still_gets_path_and_edges(listener, node):
    early = listener.hear('/scenario/reference')
    listener.wait_until(lambda: early)
    reference, edges = listener.hear('/scenario/reference'), listener.hear('/scenario/road_edges')
    listener.wait_until(lambda: reference and edges)
    wanted = scenario.load('circle_20m')
    received = decode.reference(reference[0])
    assert received.stamp_ns == START_NS
    assert same(received[1:4], wanted.reference[1:4])
    assert received.t == pytest.approx(wanted.reference.t, abs=1e-8)
    assert same(decode.road_edges(edges[0]), wanted.edges)


@runs('moving_obstacle')
def test_every_instant_is_answered_with_obstacles_of_the_same_stamp(listener, node):
    clock, received = listener.speak('/clock'), listener.hear('/scenario/obstacles')
    listener.tick_until_heard(clock, received)
    stamps = [START_NS + k * TICK_NS for k in (1, 2, 3, 4, 5, 40, 120)]
    for stamp_ns in stamps:
        clock.publish(encode.clock(stamp_ns))
        listener.wait_until(
            lambda stamp_ns=stamp_ns: decode.obstacles(received[-1]).stamp_ns == stamp_ns
        )
    answers = [decode.obstacles(message) for message in received]
    after_start = [answer for answer in answers if answer.stamp_ns > START_NS]
    assert [answer.stamp_ns for answer in after_start] == stamps
    assert [len(answer.items) for answer in after_start] == [1] * 6 + [2]
    scn = scenario.load('moving_obstacle')
    for answer in answers:
        t = (answer.stamp_ns - START_NS) * 1e-9
        wanted = scenario.obstacles_at(scn, t, answer.stamp_ns)
        assert all(same(a, b) for a, b in zip(answer.items, wanted.items))


@runs('double_lane_change')
def test_path_and_edges_are_repeated_unchanged_every_250_ms(listener, node):
    reference, edges = listener.hear('/scenario/reference'), listener.hear('/scenario/road_edges')
    clock, obstacles = listener.speak('/clock'), listener.hear('/scenario/obstacles')
    listener.wait_until(lambda: reference and edges)
    listener.tick_until_heard(clock, obstacles)
    for k in range(1, 11):
        clock.publish(encode.clock(START_NS + k * TICK_NS))
        # latched topics keep one message: hear each before it is replaced
        count = 1 + k // 5
        listener.wait_until(lambda count=count: len(reference) >= count <= len(edges))
    for received, read in ((reference, decode.reference), (edges, decode.road_edges)):
        values = [read(message) for message in received]
        assert [value.stamp_ns - START_NS for value in values] == [0, 5 * TICK_NS, 10 * TICK_NS]
        assert all(same(value[1:], values[0][1:]) for value in values)


@runs('double_lane_change')
def test_time_that_goes_on_without_a_listener_of_obstacles_is_answered(listener, node):
    clock, edges = listener.speak('/clock'), listener.hear('/scenario/road_edges')
    listener.wait_until(lambda: edges and clock.get_subscription_count())
    for k in range(6):  # of a controller that takes no notice of obstacles
        clock.publish(encode.clock(START_NS + k * TICK_NS))
    listener.wait_until(lambda: len(edges) > 1)
    assert decode.road_edges(edges[1]).stamp_ns == START_NS + 5 * TICK_NS


@runs('straight')
def test_road_without_obstacles_says_so_and_the_node_is_well(listener, node):
    clock, obstacles = listener.speak('/clock'), listener.hear('/scenario/obstacles')
    health = listener.hear('/diagnostics')
    listener.tick_until_heard(clock, obstacles)
    clock.publish(encode.clock(START_NS + 20 * TICK_NS))
    listener.wait_until(lambda: health)
    assert decode.obstacles(obstacles[0]).items == ()
    (status,) = decode.health(health[-1])
    assert (status.name, status.level, status.values['obstacles']) == ('scenario', 0, 0)


@runs('moving_obstacle', mode='realtime')
def test_on_the_wall_clock_obstacles_move_once_the_vehicle_does(listener, node):
    received = listener.hear('/scenario/obstacles', 'realtime')
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


@runs('straight')
def test_sigterm_ends_the_node_with_success(listener, node):
    reference = listener.hear('/scenario/reference')
    listener.wait_until(lambda: reference)
    code, output = stop(node)
    assert code == 0
    assert 'Traceback' not in output


@pytest.mark.parametrize(
    ('arguments', 'message'),
    [
        (('-p', 'scenario:=nowhere'), "no scenario 'nowhere'; available: bend_inside_fast, bend"),
        (
            ('-p', 'scenario:=/tmp/no/where.yaml'),
            "'/tmp/no/where.yaml': there is no folder /tmp/no",
        ),
        (('-p', 'mode:=fast'), 'lockstep or realtime'),
        (('-p', 'scenari:=straight'), "did you mean 'scenario'"),
    ],
)
def test_wrong_parameter_is_one_clear_line_and_a_failure(arguments, message):
    _, output = (process := start(*arguments)).communicate(timeout=PATIENCE_S)
    assert process.returncode not in (0, None)
    assert message in output
    assert 'Traceback' not in output


def test_broken_scenario_is_one_clear_line_and_a_failure(tmp_path):
    broken = tmp_path / 'broken.yaml'
    broken.write_text(scenario.load('straight').text.replace('friction: 1.0', 'friction: 7'))
    _, output = (process := start('-p', f'scenario:={broken}')).communicate(timeout=PATIENCE_S)
    assert process.returncode not in (0, None)
    assert f'{broken}:21: friction: is 7; allowed 0.05 to 1.5' in output
    assert 'Traceback' not in output
