"""Nodes that use the contract exchange every topic over real Fast DDS."""

from array import array
from typing import Annotated

import pytest
import rclpy
import yaml
from example_messages import decoded, load_example
from rclpy.context import Context
from rclpy.duration import Duration
from rclpy.experimental import EventsExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import (
    DurabilityPolicy,
    HistoryPolicy,
    LivelinessPolicy,
    QoSCompatibility,
    QoSProfile,
    ReliabilityPolicy,
    qos_check_compatible,
)
from rclpy.task import Future
from wait_until import wait_until

from msgs_yaml import contract, decode
from msgs_yaml.types import Health
from node_runtime import ros, spin_node
from node_runtime.input_monitor import ERROR, OK, WARN
from node_runtime.parameters import ParameterError, Range, Struct
from node_runtime.subscriptions_node import LatestMessage, PublisherMonitor

TIMEOUT_S = 60.0
S = 1_000_000_000
TOPICS = contract.load().topics
STATE_TOPIC, OBSTACLES, COMMAND = '/vehicle/odometry', '/scenario/obstacles', '/controller/command'
STATE = decode.odometry(load_example(STATE_TOPIC))
RING = {OBSTACLES: 1}
# of rclpy: reliable, volatile, the last ten messages, no deadline
BY_DEFAULT = QoSProfile(depth=10, liveliness=LivelinessPolicy.AUTOMATIC)


def test_every_policy_is_converted_and_keep_all_needs_no_depth():
    profile = ros.to_qos_profile(contract.Qos('reliable', 'transient_local', 'keep_last', 3, 100.0))
    assert profile.reliability == ReliabilityPolicy.RELIABLE
    assert profile.durability == DurabilityPolicy.TRANSIENT_LOCAL
    assert (profile.history, profile.depth) == (HistoryPolicy.KEEP_LAST, 3)
    assert profile.deadline == Duration(nanoseconds=100_000_000)
    profile = ros.to_qos_profile(contract.Qos('best_effort', 'volatile', 'keep_all', 0, None))
    assert profile.reliability == ReliabilityPolicy.BEST_EFFORT
    assert profile.durability == DurabilityPolicy.VOLATILE
    assert profile.history == HistoryPolicy.KEEP_ALL
    assert profile.deadline.nanoseconds in (0, Duration().nanoseconds, 2**63 - 1)


@pytest.mark.parametrize('mode', contract.MODES)
@pytest.mark.parametrize('topic', TOPICS)
def test_observers_and_our_subscriptions_match_what_is_published(topic, mode):
    offered = ros.to_qos_profile(TOPICS[topic].qos[mode])
    observer = ros.observer_profile(TOPICS[topic], mode)
    compatibility, reason = qos_check_compatible(offered, observer)
    assert compatibility != QoSCompatibility.ERROR, reason
    requested = ros.to_qos_profile(TOPICS[topic].requested_qos(mode))
    pairs = [(offered, requested)]
    if mode == 'realtime' and TOPICS[topic].rate_hz[mode]:  # programs of others are heard, and hear
        pairs.append((BY_DEFAULT, requested))
        if topic in (COMMAND, '/scenario/reference', OBSTACLES):
            pairs.append((offered, BY_DEFAULT))
    for ours, theirs in pairs:
        compatibility, reason = qos_check_compatible(ours, theirs)
        assert compatibility == QoSCompatibility.OK, reason


class Params(Struct):
    gain: Annotated[float, Range(0.0, 9.0, 'N')]
    count: Annotated[int, Range(0, 9, '-')]
    widths: Annotated[tuple[float, ...], Range(0.0, 9.0, 'm')]
    loud: bool
    share: Annotated[float, Range(0.0, 1.0, '-')] | None


@pytest.fixture
def defaults(tmp_path):
    path = tmp_path / 'node.yaml'
    path.write_text(
        '/**:\n  ros__parameters:\n    gain: 2.0  # N per metre\n    count: 3  # -\n'
        '    widths: [1.0, 2.0]  # m\n    loud: true  # -\n'
    )
    return path


class Pair:
    """Two nodes of one mode on a domain of their own, and the executor that spins them."""

    def __init__(self, mode, defaults):
        self.context = Context()
        rclpy.init(context=self.context)
        self.executor = EventsExecutor(context=self.context)
        self.defaults, self.nodes = defaults, []
        self.sender, self.receiver = (self.make(name, mode=mode) for name in ('sender', 'receiver'))

    def make(self, name, arguments=(), namespace='', **given):
        node = Node(
            name,
            context=self.context,
            namespace=namespace,
            cli_args=['--ros-args', *arguments],
            parameter_overrides=[Parameter(key, value=value) for key, value in given.items()],
        )
        self.nodes.append(node)
        node.params = ros.declare(node, Params, self.defaults)
        self.executor.add_node(node)
        return node

    def until(self, true):
        def work():
            self.executor.spin_until_future_complete(Future(), timeout_sec=0.02)

        wait_until(true, TIMEOUT_S, 'the two nodes did not get there', pause=work)

    def connect(self, topic, raw=False):
        """Return a publisher and the list that its subscriber fills."""
        received = []
        pub = ros.publisher(self.sender, topic)
        ros.subscribe(self.receiver, topic, received.append, raw=raw)
        self.until(lambda: pub.get_subscription_count() == 1)
        return pub, received

    def deliver(self, pub, received, message):
        """Publish a message and return what is received."""
        pub.publish(message)
        self.until(lambda: received)
        return received[0]


@pytest.fixture
def pair(request, domain, defaults):
    created = Pair(getattr(request, 'param', 'lockstep'), defaults)
    yield created
    spin_node.shut_down(*created.nodes, context=created.context)


both_modes = pytest.mark.parametrize('pair', contract.MODES, indirect=True)


@both_modes
def test_every_topic_arrives_as_it_was_sent(pair):
    topics = [topic.name for topic in TOPICS.values() if not topic.on_request]
    for topic, (pub, received) in {name: pair.connect(name) for name in topics}.items():
        message = pair.deliver(pub, received, load_example(topic))
        assert isinstance(message, ros.message_type(topic))
        assert repr(decoded(topic, message)) == repr(decoded(topic, load_example(topic)))


@both_modes
@pytest.mark.parametrize('topic', ['/scenario/reference', '/scenario/road_edges'])
def test_a_late_subscriber_may_have_the_last_message_of_latched_topics(pair, topic):
    ros.publisher(pair.sender, topic).publish(load_example(topic))
    received = []
    if ros.mode(pair.receiver) == 'lockstep':  # where time stands still until it comes
        ros.subscribe(pair.receiver, topic, received.append)
    else:
        kind, profile = ros.message_type(topic), ros.qos_profile(pair.receiver, topic)
        name = ros.relative_name(topic)
        pair.receiver.create_subscription(kind, name, received.append, profile)
    pair.until(lambda: received)
    assert received[0] == load_example(topic)


def test_parameters_are_declared_with_their_description_and_range(pair):
    assert pair.sender.params == Params(2.0, 3, (1.0, 2.0), True, None)
    assert ros.mode(pair.sender) == 'lockstep'
    descriptor = pair.sender.describe_parameter('gain')
    assert descriptor.description == 'N per metre; 0 to 9 N'
    (allowed,) = descriptor.floating_point_range
    assert (allowed.from_value, allowed.to_value) == (0.0, 9.0)
    (allowed,) = pair.sender.describe_parameter('count').integer_range
    assert (allowed.from_value, allowed.to_value) == (0, 9)
    mode = pair.sender.describe_parameter('mode')
    assert mode.additional_constraints == 'lockstep or realtime'


def test_whole_numbers_and_lists_override_doubles_and_an_unknown_override_stops_the_node(pair):
    node = pair.make('third', gain=1, widths=[1, 2, 3], loud=False)
    assert node.params == Params(1.0, 3, (1.0, 2.0, 3.0), False, None)
    assert node.get_parameter('gain').value == 1.0
    assert list(node.get_parameter('widths').value) == [1.0, 2.0, 3.0]
    with pytest.raises(ParameterError, match=r"gian: .* no such parameter; .* 'gain'"):
        pair.make('fourth', gian=1.0)


def params_file(path, node, values):
    path.write_text(yaml.safe_dump({node: {'ros__parameters': values}}))
    return ['--params-file', str(path)]


def test_a_node_restarts_from_the_output_of_ros2_param_dump(pair, tmp_path):
    node = pair.make('third', namespace='car1', gain=3.0)
    values = {p.name: p.value for p in node.get_parameters(node.list_parameters([], 0).names)}
    assert {'base', 'mode', 'use_sim_time', 'share', 'realtime.priority'} <= values.keys()
    # as ros2cli writes it: lists plain, a value that is not set as null
    plain = {k: v.tolist() if isinstance(v, array) else v for k, v in values.items()}
    arguments = params_file(tmp_path / 'dump.yaml', '/car1/third', plain)
    again = pair.make('third', arguments, namespace='car1')
    assert again.params == node.params == Params(3.0, 3, (1.0, 2.0), True, None)


def test_a_publisher_lacks_subscriptions_until_listeners_and_recorders_are_matched(pair):
    recorded = pair.make('recorded', recorders=1)
    pub = ros.publisher(recorded, OBSTACLES)
    ros.publisher(recorded, '/diagnostics')  # needs no subscription
    lacking = f'2 subscriptions to {OBSTACLES} (has {{}})'
    assert ros.missing_subscriptions(recorded, RING) == [lacking.format(0)]
    ros.subscribe(pair.sender, OBSTACLES, lambda msg: None)
    pair.until(lambda: pub.get_subscription_count() == 1)
    assert ros.missing_subscriptions(recorded, RING) == [lacking.format(1)]
    ros.subscribe(pair.receiver, OBSTACLES, lambda msg: None)
    pair.until(lambda: not ros.missing_subscriptions(recorded, RING))


def test_a_remapped_publisher_waits_for_its_listeners_and_for_no_recorder(pair):
    node = pair.make('remapped', ['-r', f'{STATE_TOPIC}:=/raw/odometry'], recorders=1)
    pub = ros.publisher(node, STATE_TOPIC)
    ring = {STATE_TOPIC: 1}
    assert ros.missing_subscriptions(node, ring) == ['1 subscriptions to /raw/odometry (has 0)']
    kind, profile = ros.message_type(STATE_TOPIC), ros.qos_profile(node, STATE_TOPIC)
    pair.sender.create_subscription(kind, '/raw/odometry', lambda msg: None, profile)
    pair.until(lambda: pub.get_subscription_count() == 1)
    assert not ros.missing_subscriptions(node, ring)


@pytest.fixture
def cars(pair):
    """Return three more nodes, two of them in the same namespace."""
    placed = [('sender', '/car1'), ('receiver', '/car1'), ('other', '/car2')]
    return [pair.make(name, namespace=namespace) for name, namespace in placed]


def test_the_latest_message_is_that_of_the_namespace(pair, cars):
    sender, receiver, other = cars
    newest = LatestMessage(receiver, STATE_TOPIC)
    pair.nodes.append(newest)
    newest.destroy_node = newest.destroy
    pubs = {node: ros.TemplatePublisher(node, STATE_TOPIC) for node in (sender, other)}
    pair.until(lambda: pubs[sender].publisher.get_subscription_count() == 1)
    assert newest.has_publisher()
    pubs[other].publish(STATE._replace(stamp_ns=9 * S))
    pubs[sender].publish(STATE)
    messages = []
    pair.until(lambda: any(messages) or messages.append(newest.take()))
    assert decode.stamp_ns_of(messages[-1]) == STATE.stamp_ns


WELL = Health(1, 'plant', OK, 'running', {})


def test_a_second_publisher_is_named_until_it_has_left(pair, capfd):
    listener, controller, intruder = (
        pair.make(name, namespace='/car1') for name in ('plant', 'controller', 'intruder')
    )
    subscription = ros.subscribe(listener, COMMAND, lambda msg: None)
    publishers = PublisherMonitor(listener, {COMMAND: subscription})
    ros.publisher(controller, COMMAND)
    pair.until(lambda: subscription.get_publisher_count() == 1)
    publishers.update()
    assert publishers.add_warnings(WELL) is WELL
    foreign = ros.publisher(intruder, COMMAND)
    pair.until(lambda: publishers.add_warnings(WELL) is not WELL)
    warning = publishers.add_warnings(WELL)
    expected = '2 publishers of /car1/controller/command (/car1/controller, /car1/intruder)'
    assert (warning.level, warning.message.startswith(expected)) == (WARN, True)
    publishers.update()  # no change: no second line
    assert capfd.readouterr().err.count(expected) == 1
    worse = publishers.add_warnings(WELL._replace(level=ERROR, message='braking'))
    assert (worse.level, worse.message.startswith('braking; 2 publishers')) == (ERROR, True)
    intruder.destroy_publisher(foreign)
    pair.until(lambda: publishers.add_warnings(WELL) is WELL)
    assert '1 publisher of /car1/controller/command again' in capfd.readouterr().err
