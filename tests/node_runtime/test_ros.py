"""Nodes that use the contract exchange every topic over real Fast DDS."""

from array import array
from typing import Annotated

import numpy as np
import pytest
import rclpy
import yaml
from rclpy.context import Context
from rclpy.experimental import EventsExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.task import Future
from wait_until import wait_until

from msgs_yaml import cdr_templates, contract, decode, encode, flat_fields, types
from node_runtime import ros, spin_node
from node_runtime.parameters import ParameterError, Range, Struct
from node_runtime.subscriptions_node import LatestMessage

pytestmark = pytest.mark.usefixtures('domain')
TIMEOUT_S = 60.0
S = 1_000_000_000
STATE_TOPIC = '/vehicle/odometry'
FOUR = (0.1, 0.2, 0.3, 0.4)
LINE = np.array([[0.0, 3.5], [9.0, 3.5]])
STATE = types.VehicleState(S, 1.0, 2.0, 0.3, 20.0, -0.1, 0.2)
VALUES = {
    'reference': types.Reference(S, np.arange(3.0), np.zeros(3), np.zeros(3), np.arange(3.0)),
    'road_edges': types.RoadEdges(S, LINE, -LINE),
    'obstacles': types.Obstacles(S, (types.Obstacle(1, 5.0, 0.0, 0.5, 1.0, 0.0),)),
    'odometry': STATE,
    'actuators': types.Actuators(S, 0.1, 0.2, -3000.0, -2000.0, FOUR),
    'imu': types.Imu(S, 1.0, 2.0, 0.1),
    'wheels': types.Wheels(S, *[FOUR] * 7),
    'command': types.Command(S, 0.1, 0.2, -3000.0, -2000.0),
    'prediction': types.Prediction(S, np.arange(51.0), *np.zeros((2, 51)), np.arange(51) * 0.05),
    'why': types.Why(S, 0, 'solved', {'rung': 'solved', 'cost.con': 0.5}),
    'diagnostics': types.Health(S, 'plant', 0, 'running', {'steps': 1}),
    'run_start': S,
    'clock': S,
}


class Params(Struct):
    gain: Annotated[float, Range(0.0, 9.0, 'N')]
    count: Annotated[int, Range(0, 9, '-')]
    widths: Annotated[tuple[float, ...], Range(0.0, 9.0, 'm')]
    loud: bool


class Optional(Params):
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
        self.nodes = [self.make(name, {'mode': mode}, defaults) for name in ('sender', 'receiver')]
        self.sender, self.receiver = self.nodes

    def make(self, name, given, defaults, cls=Params, namespace='', arguments=None):
        chosen = [Parameter(key, value=value) for key, value in given.items()]
        node = Node(
            name,
            context=self.context,
            namespace=namespace,
            cli_args=arguments,
            parameter_overrides=chosen,
        )
        node.params = ros.declare(node, cls, defaults)
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

    def close(self):
        spin_node.shut_down(*self.nodes, context=self.context)


@pytest.fixture
def pair(request, domain, defaults):
    created = Pair(getattr(request, 'param', 'lockstep'), defaults)
    yield created
    created.close()


both_modes = pytest.mark.parametrize('pair', contract.MODES, indirect=True)


def coders(topic):
    name = topic.rsplit('/', 1)[1]
    called = 'health' if name == 'diagnostics' else name
    return VALUES[name], getattr(encode, called), getattr(decode, called)


DEFAULT_QOS = 10  # of rclpy: reliable, volatile, the last ten messages, no deadline
on_the_wall_clock = pytest.mark.parametrize('pair', ['realtime'], indirect=True)


@on_the_wall_clock
def test_publishers_with_the_default_qos_are_heard(pair):
    topics = [topic for topic in contract.load().topics.values() if topic.rate_hz['realtime']]
    for topic in topics:
        received, name = [], ros.relative_name(topic.name)
        pub = pair.sender.create_publisher(ros.message_type(topic.name), name, DEFAULT_QOS)
        ros.subscribe(pair.receiver, topic.name, received.append)
        pair.until(pub.get_subscription_count)
        value, to_message, _ = coders(topic.name)
        pub.publish(to_message(value))
        pair.until(lambda received=received: received)


@on_the_wall_clock
@pytest.mark.parametrize(
    'topic', ['/controller/command', '/scenario/reference', '/scenario/obstacles']
)
def test_subscribers_with_the_default_qos_hear(pair, topic):
    received, pub = [], ros.publisher(pair.sender, topic)
    kind, name = ros.message_type(topic), ros.relative_name(topic)
    pair.receiver.create_subscription(kind, name, received.append, DEFAULT_QOS)
    pair.until(pub.get_subscription_count)
    value, to_message, _ = coders(topic)
    pub.publish(to_message(value))
    pair.until(lambda: received)


@both_modes
def test_every_topic_arrives_as_it_was_sent(pair):
    topics = contract.load().topics.values()
    connected = {t.name: pair.connect(t.name) for t in topics if not t.on_request}
    for topic, (pub, received) in connected.items():
        value, to_message, to_value = coders(topic)
        pub.publish(to_message(value))
        pair.until(lambda received=received: received)
        assert isinstance(received[0], ros.message_type(topic))
        assert repr(to_value(received[0])) == repr(to_value(to_message(value)))


@both_modes
@pytest.mark.parametrize('topic', ['/scenario/reference', '/scenario/road_edges'])
def test_a_late_subscriber_may_have_the_last_message_of_latched_topics(pair, topic):
    value, to_message, to_value = coders(topic)
    ros.publisher(pair.sender, topic).publish(to_message(value))
    received = []
    if ros.mode(pair.receiver) == 'lockstep':  # where time stands still until it comes
        ros.subscribe(pair.receiver, topic, received.append)
    else:
        kind, profile = ros.message_type(topic), ros.qos_profile(pair.receiver, topic)
        name = ros.relative_name(topic)
        pair.receiver.create_subscription(kind, name, received.append, profile)
    pair.until(lambda: received)
    assert repr(to_value(received[0])) == repr(to_value(to_message(value)))


@pytest.mark.parametrize('topic', sorted(flat_fields.TYPES))
def test_messages_of_a_template_arrive_as_those_of_an_object(pair, topic):
    received = []
    pub = ros.TemplatePublisher(pair.sender, topic)
    ros.subscribe(pair.receiver, topic, received.append, raw=True)
    pair.until(lambda: pub.publisher.get_subscription_count() == 1)
    value, _, to_value = coders(topic)
    pub.publish(value)
    pair.until(lambda: received)
    assert received[0] == cdr_templates.Template(topic).fill(value)
    assert decode.stamp_ns_of(received[0]) == S
    assert to_value(ros.deserialize(topic, received[0])) == to_value(coders(topic)[1](value))


def test_lockstep_loses_none_of_a_long_burst(pair):
    received = []
    pub = ros.TemplatePublisher(pair.sender, '/vehicle/odometry')
    ros.subscribe(pair.receiver, '/vehicle/odometry', received.append, raw=True)
    pair.until(lambda: pub.publisher.get_subscription_count() == 1)
    stamps = [S + 1_000_000 * k for k in range(500)]
    for stamp_ns in stamps:
        pub.publish(STATE._replace(stamp_ns=stamp_ns))
    pair.until(lambda: len(received) >= len(stamps))
    assert [decode.stamp_ns_of(raw) for raw in received] == stamps


def test_parameters_are_declared_with_their_description_and_range(pair):
    assert pair.sender.params == Params(2.0, 3, (1.0, 2.0), True)
    assert ros.mode(pair.sender) == 'lockstep'
    descriptor = pair.sender.describe_parameter('gain')
    assert descriptor.description == 'N per metre; 0 to 9 N'
    (allowed,) = descriptor.floating_point_range
    assert (allowed.from_value, allowed.to_value) == (0.0, 9.0)
    (allowed,) = pair.sender.describe_parameter('count').integer_range
    assert (allowed.from_value, allowed.to_value) == (0, 9)
    mode = pair.sender.describe_parameter('mode')
    assert mode.additional_constraints == 'lockstep or realtime'


@pytest.mark.parametrize(('name', 'value'), [('gain', 3.0), ('mode', 'realtime'), ('loud', False)])
def test_a_parameter_cannot_change_while_the_node_runs(pair, name, value):
    (result,) = pair.sender.set_parameters([Parameter(name, value=value)])
    assert not result.successful
    assert 'read-only' in result.reason
    assert pair.sender.get_parameter(name).value != value


def test_whole_numbers_and_lists_override_doubles(pair, defaults):
    node = pair.make('third', {'gain': 1, 'widths': [1, 2, 3], 'loud': False}, defaults)
    pair.nodes.append(node)
    assert node.params == Params(1.0, 3, (1.0, 2.0, 3.0), False)
    assert node.get_parameter('gain').value == 1.0
    assert list(node.get_parameter('widths').value) == [1.0, 2.0, 3.0]


def params_file(path, node, values):
    path.write_text(yaml.safe_dump({node: {'ros__parameters': values}}))
    return ['--ros-args', '--params-file', str(path)]


def test_a_parameter_file_with_a_base_overrides_the_file_that_it_names(pair, defaults, tmp_path):
    text = '/**: {ros__parameters: {base: node.yaml, gain: 4.0, loud: false}}'
    (tmp_path / 'quiet.yaml').write_text(text)
    for base, expected in (('quiet.yaml', 4.0), (str(tmp_path / 'quiet.yaml'), 4.0), ('', 2.0)):
        arguments = params_file(tmp_path / 'small.yaml', '/**', {'base': base, 'count': 5})
        node = pair.make('third', {}, defaults, arguments=arguments)
        pair.nodes.append(node)
        assert node.params == Params(expected, 5, (1.0, 2.0), not base)
        assert node.get_parameter('base').value == base
    (result,) = node.set_parameters([Parameter('base', value='quiet.yaml')])
    assert 'read-only' in result.reason


def test_a_node_restarts_from_the_output_of_ros2_param_dump(pair, defaults, tmp_path):
    node = pair.make('third', {'gain': 3.0}, defaults, cls=Optional, namespace='car1')
    pair.nodes.append(node)
    names = node.list_parameters([], 0).names
    values = {p.name: p.value for p in node.get_parameters(names)}
    assert {'base', 'mode', 'use_sim_time', 'share', 'realtime.priority'} <= values.keys()
    # as ros2cli writes it: lists plain, a value that is not set as null
    plain = {k: v.tolist() if isinstance(v, array) else v for k, v in values.items()}
    arguments = params_file(tmp_path / 'dump.yaml', '/car1/third', plain)
    again = pair.make('third', {}, defaults, cls=Optional, namespace='car1', arguments=arguments)
    pair.nodes.append(again)
    assert again.params == node.params == Optional(3.0, 3, (1.0, 2.0), True, None)


def test_an_unknown_override_stops_the_node(pair, defaults):
    with pytest.raises(ParameterError, match=r"gian: .* no such parameter; .* 'gain'"):
        pair.make('third', {'gian': 1.0}, defaults)


def test_a_topic_outside_the_contract_is_an_error(pair):
    with pytest.raises(KeyError):
        ros.publisher(pair.sender, '/vehicle/odometer')


def test_a_publisher_lacks_subscriptions_until_listeners_and_recorders_are_matched(pair, defaults):
    recorded = pair.make('recorded', {'recorders': 1}, defaults)
    pair.nodes.append(recorded)
    pub = ros.publisher(recorded, '/scenario/obstacles')
    ros.publisher(recorded, '/diagnostics')  # needs no subscription
    ring = {'/scenario/obstacles': 1}
    assert ros.missing_subscriptions(recorded, ring) == [
        '2 subscriptions to /scenario/obstacles (has 0)'
    ]
    ros.subscribe(pair.sender, '/scenario/obstacles', lambda msg: None)
    pair.until(lambda: pub.get_subscription_count() == 1)
    assert ros.missing_subscriptions(recorded, ring) == [
        '2 subscriptions to /scenario/obstacles (has 1)'
    ]
    ros.subscribe(pair.receiver, '/scenario/obstacles', lambda msg: None)
    pair.until(lambda: not ros.missing_subscriptions(recorded, ring))


@pytest.fixture
def cars(pair, defaults):
    """Return three more nodes, two of them in the same namespace."""
    placed = [('sender', '/car1'), ('receiver', '/car1'), ('other', '/car2')]
    created = [pair.make(name, {}, defaults, namespace=namespace) for name, namespace in placed]
    pair.nodes += created
    return created


@pytest.mark.parametrize('topic', sorted(contract.load().topics))
def test_every_topic_stays_in_the_namespace_of_its_node(pair, cars, topic):
    sender, receiver, other = cars
    pub = ros.publisher(sender, topic)
    assert pub.topic_name == ros.full_name(sender, topic) == f'/car1{topic}'
    subs = [ros.subscribe(node, topic, lambda msg: None) for node in (receiver, other)]
    subs.append(ros.subscribe(pair.receiver, topic, lambda msg: None))
    pair.until(lambda: pub.get_subscription_count() == 1)
    assert [sub.topic_name for sub in subs] == [f'/car1{topic}', f'/car2{topic}', topic]
    # whoever is matched is matched for good: the others have not been in the same time
    assert [sub.get_publisher_count() for sub in subs[1:]] == [0, 0]


def test_listeners_in_another_namespace_do_not_count(pair, cars):
    sender, receiver, other = cars
    ros.publisher(sender, '/scenario/obstacles')
    ring = {'/scenario/obstacles': 1}
    for stranger in (other, pair.receiver):
        ros.subscribe(stranger, '/scenario/obstacles', lambda msg: None)
    assert ros.missing_subscriptions(sender, ring) == [
        '1 subscriptions to /car1/scenario/obstacles (has 0)'
    ]
    ros.subscribe(receiver, '/scenario/obstacles', lambda msg: None)
    pair.until(lambda: not ros.missing_subscriptions(sender, ring))


def test_a_remapped_publisher_waits_for_its_listeners_and_for_no_recorder(pair, defaults):
    arguments = ['--ros-args', '-r', '/vehicle/odometry:=/raw/odometry']
    node = pair.make('remapped', {'recorders': 1}, defaults, arguments=arguments)
    pair.nodes.append(node)
    pub = ros.publisher(node, '/vehicle/odometry')
    ring = {'/vehicle/odometry': 1}
    assert ros.missing_subscriptions(node, ring) == ['1 subscriptions to /raw/odometry (has 0)']
    kind, profile = ros.message_type(STATE_TOPIC), ros.qos_profile(node, STATE_TOPIC)
    pair.sender.create_subscription(kind, '/raw/odometry', lambda msg: None, profile)
    pair.until(lambda: pub.get_subscription_count() == 1)
    assert not ros.missing_subscriptions(node, ring)


def test_the_latest_message_is_that_of_the_namespace(pair, cars):
    sender, receiver, other = cars
    newest = LatestMessage(receiver, STATE_TOPIC)
    try:
        pubs = {node: ros.TemplatePublisher(node, STATE_TOPIC) for node in (sender, other)}
        pair.until(lambda: pubs[sender].publisher.get_subscription_count() == 1)
        pubs[other].publish(STATE._replace(stamp_ns=9 * S))
        pubs[sender].publish(STATE)
        messages = []
        pair.until(lambda: any(messages) or messages.append(newest.take()))
        assert decode.stamp_ns_of(messages[-1]) == S
    finally:
        newest.destroy()
