"""The ROS side of every node: parameters, publishers, subscriptions.

Types and QoS come from the contract, so a node cannot misstate them. The contract's names are
relative to the namespace of a node: `/vehicle/odometry` of a node in `/car1` is
`/car1/vehicle/odometry`, so rings in different namespaces do not hear each other.
"""

import time
from collections.abc import Callable, Mapping
from importlib import import_module
from pathlib import Path
from typing import Any, TypeVar

import rclpy
from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile
from rclpy.serialization import deserialize_message, serialize_message
from rclpy.subscription import Subscription

from msgs_yaml import contract, fast
from msgs_yaml.checked import DecodeError
from node_runtime import overrides, qos
from node_runtime.parameters import Choice, Range

T = TypeVar('T')
_RETRY_S = 0.001
_PATIENCE_S = 30.0  # DDS forgets a dead process after 20 s
HEALTH = '/diagnostics'  # nobody waits for it to be heard


def mode(node: Node) -> str:
    """Return the parameter `mode` of a node that has declared its parameters."""
    return node.get_parameter(overrides.MODE).value


def declare(node: Node, cls: type[T], defaults: Path) -> T:
    """Declare a parameter dataclass as read-only ROS parameters, and `mode` and `recorders`.

    Defaults come from the YAML file, overrides from the command line and parameter files. Raises
    ParameterError for values that break their range, and for overrides that nobody declares. Logs
    how many values come from the YAML file.
    """
    # rclpy shows overrides only to those who know the names; unknown ones would pass in silence
    given = {name: parameter.value for name, parameter in node._parameter_overrides.items()}
    given = {name: value for name, value in given.items() if not node.has_parameter(name)}
    made, declarations = overrides.resolve(cls, Path(defaults), given)
    for one in declarations:
        # values are checked: ROS must neither override them again nor insist on 1.0 for 1
        node.declare_parameter(one.name, one.value, _descriptor(one), ignore_override=True)
    node.get_logger().info(overrides.told_defaults(cls, given, Path(defaults)))
    return made


def _descriptor(one):
    # without a value it has no type either, unless that may change
    descriptor = ParameterDescriptor(
        description=one.description, read_only=True, dynamic_typing=one.value is None
    )
    rule, kind = one.leaf.rule, one.leaf.kind
    if isinstance(rule, Range) and kind is float:
        ends = {'from_value': float(rule.low), 'to_value': float(rule.high)}
        descriptor.floating_point_range = [FloatingPointRange(**ends)]
    elif isinstance(rule, Range):
        ends = {'from_value': int(rule.low), 'to_value': int(rule.high)}
        descriptor.integer_range = [IntegerRange(**ends)]
    elif isinstance(rule, Choice):
        descriptor.additional_constraints = one.leaf.allowed
    return descriptor


def relative(topic: str) -> str:
    """Return a name of the contract or of a bag as one relative to the namespace of a node."""
    return topic.lstrip('/')


def full_name(node: Node, topic: str) -> str:
    """Return the name of a topic of the contract in the graph: namespace and remappings applied."""
    return node.resolve_topic_name(relative(topic))


def polled_node(node: Node, name: str) -> Node:
    """Return a second node in the namespace and context of `node`, which no executor spins.

    Its subscriptions are asked for messages, they have no callbacks. Create them with `full_name`
    of `node`: arguments of the process, remappings included, do not apply to this node.
    """
    return rclpy.create_node(
        name,
        context=node.context,
        namespace=node.get_namespace(),
        use_global_arguments=False,
        start_parameter_services=False,
        enable_rosout=False,
    )


def publisher(node: Node, topic: str) -> Publisher:
    """Return a publisher with type and QoS of the contract; it takes messages."""
    return node.create_publisher(message_type(topic), relative(topic), profile(node, topic))


def subscribe(
    node: Node, topic: str, callback: Callable[[Any], None], raw: bool = False
) -> Subscription:
    """Subscribe with type and QoS of the contract; raw callbacks take serialised bytes."""
    kind, wanted = message_type(topic), profile(node, topic)
    return node.create_subscription(kind, relative(topic), callback, wanted, raw=raw)


def unheard(node: Node, listeners: Mapping[str, int]) -> list[str]:
    """Return what the publishers of a node still have to be matched with, in words.

    Each topic of the contract needs as many subscriptions as the parameter `recorders` says, and
    `listeners` more. One that was remapped needs the listeners only: no recorder is told to listen
    there. Who starts earlier loses messages: DDS sends volatile ones only to readers that it has
    matched.
    """
    topics = {full_name(node, topic): topic for topic in contract.load().topics if topic != HEALTH}
    recorders = node.get_parameter(overrides.RECORDERS).value
    waiting = []
    for pub in node.publishers:
        topic = topics.get(pub.topic_name)
        is_recorded = pub.topic_name == f'{node.get_namespace().rstrip("/")}{topic}'
        wanted = recorders * is_recorded + listeners.get(topic, 0)
        matched = pub.get_subscription_count()
        if topic and matched < wanted:
            waiting.append(f'{wanted} subscriptions to {pub.topic_name} (has {matched})')
    return waiting


def message(topic: str, raw: bytes) -> Any:
    """Return the message of a topic from its serialised bytes; DecodeError when they are none."""
    try:
        return deserialize_message(raw, message_type(topic))
    except RuntimeError as error:  # the base of what the middleware refuses
        raise DecodeError(f'{topic}: {len(raw)} bytes are no message of its type') from error


def serialized(msg: Any) -> bytes:
    """Return the bytes of a message, as they are published."""
    return serialize_message(msg)


def message_type(topic: str) -> type:
    """Return the message class of a topic of the contract."""
    package, _, name = contract.load().topics[topic].type.split('/')
    return getattr(import_module(f'{package}.msg'), name)


class Sender:
    """Publishes serialised messages, and waits where others would lose them."""

    def __init__(self, node: Node, pub: Publisher):
        self._node = node
        self._publisher = pub
        self._given_up = False  # told to end while the queue was full

    def send(self, raw: bytes) -> None:
        """Publish the bytes of one message.

        Waits while a reliable subscriber that keeps everything is thousands of messages behind:
        lockstep loses none. Raises RuntimeError when that lasts longer than a dead process is
        remembered by DDS. A node that has been told to end does not wait.
        """
        end = time.monotonic() + _PATIENCE_S
        while not (self._given_up or self._accepted(raw, end)):
            time.sleep(_RETRY_S)

    def _accepted(self, raw, end):
        try:
            self._publisher.publish(raw)
        except RuntimeError:  # the queue is full
            # nobody waits for the rest, and each further try would block for 0.1 s
            self._given_up = getattr(self._node, 'finished', False)
            if time.monotonic() > end or not self._publisher.get_subscription_count():
                raise
            return False
        return True


class FastPublisher:
    """Publishes values, not messages, by patching a serialised template."""

    def __init__(self, node: Node, topic: str):
        self.publisher = publisher(node, topic)
        self._sender = Sender(node, self.publisher)
        self._template = fast.Template(topic)

    def publish(self, value: Any) -> None:
        """Publish a value of `types` as `Sender` does; the bytes are those of its message."""
        self._sender.send(self._template.fill(value))


def fast_publisher(node: Node, topic: str) -> FastPublisher:
    """Return a publisher of values for a topic of `fast.FORMS`; KeyError for others."""
    return FastPublisher(node, topic)


def profile(node: Node, topic: str) -> QoSProfile:
    """Return the QoS of a topic of the contract, in the mode of a node."""
    return qos.profile(contract.load().topics[topic].qos[mode(node)])
