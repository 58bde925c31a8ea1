"""The ROS side of every node: parameters, publishers, subscriptions, QoS.

Types and QoS come from the contract, so no node can deviate from them. The contract's topic names
are relative to the namespace of a node: `/vehicle/odometry` of a node in `/car1` is
`/car1/vehicle/odometry`, so systems in different namespaces are separate.
"""

import time
from collections.abc import Callable, Collection, Mapping
from importlib import import_module
from pathlib import Path
from typing import Any, TypeVar

import rclpy
from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor
from rclpy.clock import Clock, ClockType
from rclpy.duration import Duration
from rclpy.lifecycle import LifecycleNode
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import (
    DurabilityPolicy,
    HistoryPolicy,
    LivelinessPolicy,
    QoSProfile,
    ReliabilityPolicy,
)
from rclpy.serialization import deserialize_message, serialize_message
from rclpy.subscription import Subscription
from rclpy.timer import Timer

from msgs_yaml import contract, flat_fields
from msgs_yaml.contract import Qos, Topic
from msgs_yaml.decode import DecodeError
from node_runtime import node_parameters
from node_runtime.parameters import Choice, Range

T = TypeVar('T')
_RETRY_S = 0.001
_TIMEOUT_S = 30.0  # DDS forgets a dead process after 20 s
_RANGES = {
    float: ('floating_point_range', FloatingPointRange),
    int: ('integer_range', IntegerRange),
}
HEALTH = '/diagnostics'  # no node waits for its subscriptions


def mode(node: Node) -> str:
    """Return the parameter `mode` of a node that has declared its parameters."""
    return node.get_parameter(node_parameters.MODE).value


def declare(
    node: Node,
    cls: type[T],
    defaults: Path,
    changeable: Callable[[T], Collection[str]] = lambda params: (),
) -> T:
    """Declare a parameter dataclass, and the parameters of every node; return it.

    All are read-only but `changeable(params)`, which the node checks when they are set. Defaults
    come from the YAML file `defaults`, or from the one that the parameter `base` names; overrides
    from the command line and parameter files. Raises ParameterError for values out of range and for
    overrides that are no parameters. Logs how many values are defaults.
    """
    # rclpy gives overrides only to those who know the names; unknown ones would be ignored
    given = {name: parameter.value for name, parameter in node._parameter_overrides.items()}
    given = {name: value for name, value in given.items() if not node.has_parameter(name)}
    is_managed = isinstance(node, LifecycleNode)
    common = node_parameters.MANAGED if is_managed else node_parameters.COMMON
    params, declarations = node_parameters.resolve(cls, Path(defaults), given, common=common)
    free = changeable(params)
    for declaration in declarations:
        leaf = declaration.leaf
        # a parameter without a value has no type either, unless its type may change
        descriptor = ParameterDescriptor(
            description=declaration.description,
            read_only=declaration.name not in free,
            dynamic_typing=declaration.value is None,
        )
        if isinstance(leaf.rule, Range):
            field, make = _RANGES[leaf.kind]
            low, high = leaf.kind(leaf.rule.low), leaf.kind(leaf.rule.high)
            setattr(descriptor, field, [make(from_value=low, to_value=high)])
        elif isinstance(leaf.rule, Choice):
            descriptor.additional_constraints = leaf.allowed
        # values are checked: ROS must neither override them again nor insist on 1.0 for 1
        node.declare_parameter(
            declaration.name, declaration.value, descriptor, ignore_override=True
        )
    node.get_logger().info(node_parameters.describe_defaults(cls, given, Path(defaults)))
    return params


def relative_name(topic: str) -> str:
    """Return a topic name of the contract or of a bag relative to the namespace of a node."""
    return topic.lstrip('/')


def full_name(node: Node, topic: str) -> str:
    """Return a topic name of the contract with namespace and remappings of a node applied."""
    return node.resolve_topic_name(relative_name(topic))


def polled_node(node: Node, name: str) -> Node:
    """Return a second node in the namespace and context of `node` that no executor spins.

    Its subscriptions have no callbacks and are polled. Create them with `full_name` of `node`:
    arguments of the process, remappings included, do not apply to this node.
    """
    return rclpy.create_node(
        name,
        context=node.context,
        namespace=node.get_namespace(),
        use_global_arguments=False,
        start_parameter_services=False,
        enable_rosout=False,
    )


def steady_timer(node: Node, period_s: float, callback: Callable[[], None]) -> Timer:
    """Return a timer on the monotonic clock, whatever clock the node follows."""
    return node.create_timer(period_s, callback, clock=Clock(clock_type=ClockType.STEADY_TIME))


def publisher(node: Node, topic: str) -> Publisher:
    """Return a publisher of messages with type and QoS of the contract.

    That of a managed node publishes while the node is active only.
    """
    is_managed = isinstance(node, LifecycleNode)
    create = node.create_lifecycle_publisher if is_managed else node.create_publisher
    return create(message_type(topic), relative_name(topic), qos_profile(node, topic))


def subscribe(
    node: Node, topic: str, callback: Callable[[Any], None], raw: bool = False
) -> Subscription:
    """Subscribe to a topic of the contract (`requested_qos`); raw callbacks take bytes."""
    kind, profile = message_type(topic), requested_profile(node, topic)
    return node.create_subscription(kind, relative_name(topic), callback, profile, raw=raw)


def missing_subscriptions(node: Node, listeners: Mapping[str, int]) -> list[str]:
    """Return which publishers of a node lack matched subscriptions, a text for each.

    Each topic of the contract needs as many subscriptions as the parameter `recorders` says, and
    `listeners` more. A remapped topic needs the listeners only: no recorder subscribes to it. A
    node that starts earlier loses messages: DDS sends volatile ones only to matched readers.
    """
    topics = {full_name(node, topic): topic for topic in contract.load().topics if topic != HEALTH}
    recorders = node.get_parameter(node_parameters.RECORDERS).value
    missing = []
    for pub in node.publishers:
        topic = topics.get(pub.topic_name)
        is_recorded = pub.topic_name == f'{node.get_namespace().rstrip("/")}{topic}'
        expected = recorders * is_recorded + listeners.get(topic, 0)
        matched = pub.get_subscription_count()
        if topic and matched < expected:
            missing.append(f'{expected} subscriptions to {pub.topic_name} (has {matched})')
    return missing


serialize = serialize_message  # message -> its bytes, as they are published


def deserialize(topic: str, raw: bytes) -> Any:
    """Return the message of a topic from its bytes; raise DecodeError for other bytes."""
    try:
        return deserialize_message(raw, message_type(topic))
    except RuntimeError as error:  # the base of what the middleware raises
        raise DecodeError(f'{topic}: {len(raw)} bytes are no message of its type') from error


def message_type(topic: str) -> type:
    """Return the message class of a topic of the contract.

    Raises ModuleNotFoundError where its package is not installed, as that of /tf may be.
    """
    package, _, name = contract.load().find(topic).type.split('/')
    return getattr(import_module(f'{package}.msg'), name)


class BlockingPublisher:
    """Publishes serialised messages; waits while the queue is full, so that none is lost."""

    def __init__(self, node: Node, pub: Publisher):
        self._node = node
        self._publisher = pub
        self._is_ending = False  # the node was asked to end while the queue was full

    def send(self, raw: bytes) -> None:
        """Publish the bytes of one message.

        Waits while a reliable keep-all subscriber is thousands of messages behind: lockstep loses
        no message. Raises RuntimeError if that lasts longer than DDS remembers a dead process. A
        node that was asked to end does not wait.
        """
        end = time.monotonic() + _TIMEOUT_S
        while not self._is_ending:
            try:
                self._publisher.publish(raw)
                return
            except RuntimeError:  # the queue is full
                # each further attempt would block for 0.1 s
                self._is_ending = getattr(self._node, 'finished', False)
                if time.monotonic() > end or not self._publisher.get_subscription_count():
                    raise
            time.sleep(_RETRY_S)


class TemplatePublisher:
    """Publishes values of `types` without building their message; see `flat_fields`."""

    def __init__(self, node: Node, topic: str):
        """Raise KeyError for a topic whose values have no fixed size."""
        self.publisher = publisher(node, topic)
        self._sender = BlockingPublisher(node, self.publisher)
        self._fields = flat_fields.load(topic)

    def publish(self, value: Any) -> None:
        """Publish a value as `BlockingPublisher` does; the bytes are those of its message."""
        self._sender.send(self._fields.fill(value))


def qos_profile(node: Node, topic: str) -> QoSProfile:
    """Return the QoS that a publisher of a topic of the contract offers in the mode of a node."""
    return to_qos_profile(contract.load().find(topic).qos[mode(node)])


def requested_profile(node: Node, topic: str) -> QoSProfile:
    """Return the QoS that a subscription of a node asks for (`contract.Topic.requested_qos`)."""
    return to_qos_profile(contract.load().find(topic).requested_qos(mode(node)))


def to_qos_profile(qos: Qos) -> QoSProfile:
    """Return the rclpy profile of a QoS profile of the contract."""
    profile = QoSProfile(
        reliability=ReliabilityPolicy[qos.reliability.upper()],
        durability=DurabilityPolicy[qos.durability.upper()],
        history=HistoryPolicy[qos.history.upper()],
        depth=qos.depth,
        liveliness=LivelinessPolicy.AUTOMATIC,
    )
    if qos.deadline_ms is not None:
        profile.deadline = Duration(nanoseconds=round(qos.deadline_ms * 1e6))
    return profile


def observer_profile(topic: Topic, mode: str) -> QoSProfile:
    """Return the profile of an observer: compatible with whatever is offered, and never blocking.

    It may lose messages of a topic that is not latched.
    """
    is_latched = topic.qos[mode].durability == 'transient_local'
    reliability = 'reliable' if is_latched else 'best_effort'
    durability = topic.requested_qos(mode).durability
    return to_qos_profile(Qos(reliability, durability, 'keep_last', 1))
