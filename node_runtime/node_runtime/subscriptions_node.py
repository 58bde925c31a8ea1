"""Subscriptions beyond callbacks: bounded decoding, polling, and a watch over their publishers.

read_reference, read_road_edges, read_obstacles,
read_predictions                                  serialised message of any size -> value
read_odometry, read_actuators                     serialised message -> value
LatestMessage                                     the newest message, polled
PublisherMonitor                                  warns of a second publisher of a topic
"""

from collections.abc import Mapping

from rclpy.node import Node
from rclpy.qos import HistoryPolicy
from rclpy.subscription import Subscription

from msgs_yaml import contract, decode, flat_fields, raw_scenario
from msgs_yaml.raw_scenario import REFERENCE, ROAD_EDGES
from msgs_yaml.types import (
    Actuators,
    Health,
    Obstacles,
    Predictions,
    Reference,
    RoadEdges,
    VehicleState,
)
from node_runtime import ros
from node_runtime.input_monitor import OK, WARN

OBSTACLES = '/scenario/obstacles'
PREDICTIONS = '/scenario/predictions'
ODOMETRY, ACTUATORS = '/vehicle/odometry', '/vehicle/actuators'
PERIOD_S = 1.0  # of wall time, between two counts of publishers
_COUNT = slice(4, 8)  # of a serialised MarkerArray, behind the encapsulation: number of markers
_OBJECT_BYTES = 400_000  # of a path or of edges; as objects they take 0.1 s to build and to check
_HEAD_BYTES = 10_000  # of predictions, all but their points, at most
_MARKER_BYTES, _POINT_BYTES = 1000, 24  # of one marker without points at most, of one point


def read_reference(raw: bytes) -> Reference:
    """Return the path of a serialised /scenario/reference.

    Raises DecodeError, also, and at once, if the message is longer than the contract allows: the
    controller that reads it has to send a command every 50 ms. The other readers do the same.
    """
    most = contract.load().topics[REFERENCE].sizes['poses'].high
    _check_bytes(REFERENCE, raw, raw_scenario.reference_size(most), f', those of {most} poses')
    path = raw_scenario.read_reference(raw)
    return _decode(REFERENCE, raw, decode.reference) if path is None else path


def read_road_edges(raw: bytes) -> RoadEdges:
    """Return the edges of a serialised /scenario/road_edges; see `read_reference`."""
    _, count, most, limit = _markers(ROAD_EDGES, raw)
    if count > most:
        raise decode.DecodeError(f'{ROAD_EDGES}: markers is {count} long; allowed {most}')
    _check_bytes(ROAD_EDGES, raw, limit)
    edges = raw_scenario.read_road_edges(raw)
    return _decode(ROAD_EDGES, raw, decode.road_edges) if edges is None else edges


def read_obstacles(raw: bytes) -> Obstacles:
    """Return the obstacles of a serialised /scenario/obstacles; see `read_reference`.

    Of more markers than the contract allows no more are deserialised than show that.
    """
    order, count, most, limit = _markers(OBSTACLES, raw)
    if count > most:
        raw = raw[: _COUNT.start] + (most + 1).to_bytes(4, order) + raw[_COUNT.stop : limit]
    _check_bytes(OBSTACLES, raw, limit)
    return decode.obstacles(ros.deserialize(OBSTACLES, raw))


def read_predictions(raw: bytes) -> Predictions:
    """Return the predictions of a serialised /scenario/predictions; see `read_reference`."""
    points = contract.load().topics[PREDICTIONS].sizes['data'].high
    _check_bytes(PREDICTIONS, raw, points + _HEAD_BYTES)
    return decode.predictions(ros.deserialize(PREDICTIONS, raw))


def read_odometry(raw: bytes) -> VehicleState:
    """Return the state of a serialised /vehicle/odometry. Raises DecodeError."""
    state = flat_fields.load(ODOMETRY).read(raw)
    return decode.odometry(ros.deserialize(ODOMETRY, raw)) if state is None else state


def read_actuators(raw: bytes) -> Actuators:
    """Return the value of a serialised /vehicle/actuators. Raises DecodeError."""
    actuators = flat_fields.load(ACTUATORS).read(raw)
    return decode.actuators(ros.deserialize(ACTUATORS, raw)) if actuators is None else actuators


def _decode(topic, raw, decoder):
    """Return the value of a message object, or raise the DecodeError that names its violation."""
    if len(raw) > _OBJECT_BYTES:
        raise decode.DecodeError(
            f'{topic}: {len(raw)} bytes violate the contract or are no little-endian CDR; the '
            f'reason is given up to {_OBJECT_BYTES} bytes'
        )
    return decoder(ros.deserialize(topic, raw))


def _check_bytes(topic, raw, limit, those=''):
    if len(raw) > limit:
        raise decode.DecodeError(f'{topic}: {len(raw)} bytes; allowed {limit}{those}')


def _markers(topic, raw):
    """Return byte order and number of markers of a serialised MarkerArray, and the most of a topic.

    And the most bytes that these can have.
    """
    order = 'little' if raw[1:2] and raw[1] & 1 else 'big'
    sizes = contract.load().topics[topic].sizes
    most = sizes['markers'].high
    points = max(allowed.high for key, allowed in sizes.items() if key.endswith('.points'))
    limit = most * (_MARKER_BYTES + _POINT_BYTES * points)
    return order, int.from_bytes(raw[_COUNT], order), most, limit


class LatestMessage:
    """A subscription without callbacks that keeps the newest message, serialised.

    A callback costs about 50 us of Python: at 1 kHz a twentieth of a core, for messages that are
    needed once, at the start. Its own node is in the same context and in no executor.
    """

    def __init__(self, node: Node, topic: str):
        """`node` has declared its parameters; its namespace and remappings hold here too."""
        self._node = ros.polled_node(node, f'{node.get_name()}_inbox')
        profile = ros.requested_profile(node, topic)
        profile.history, profile.depth = HistoryPolicy.KEEP_LAST, 1
        kind = ros.message_type(topic)
        self._subscription = self._node.create_subscription(
            kind, ros.full_name(node, topic), lambda raw: None, profile, raw=True
        )

    def take(self) -> bytes | None:
        """Return the newest message since the last call, None if there is none."""
        handle = self._subscription.handle
        with handle:
            result = handle.take_message(self._subscription.msg_type, True)
        return None if result is None else result[0]

    def has_publisher(self) -> bool:
        """Return whether a publisher of the topic is known."""
        return self._subscription.get_publisher_count() > 0

    def destroy(self) -> None:
        """Destroy the node of this subscription."""
        self._node.destroy_node()


class PublisherMonitor:
    """Counts the publishers of subscriptions once per second, and logs each change.

    With one publisher per topic it logs nothing and leaves the health as it is.
    """

    def __init__(self, node: Node, subscriptions: Mapping[str, Subscription]):
        """`subscriptions` of the node, by topic of the contract."""
        self._node, self._subscriptions = node, subscriptions
        self._counts = dict.fromkeys(subscriptions, 1)
        self._warnings: dict[str, str] = {}  # by topic
        ros.steady_timer(node, PERIOD_S, self.update)

    def update(self) -> None:
        """Count; log topics that now have several publishers, and those that have one again."""
        for topic, subscription in self._subscriptions.items():
            # matched ones only: a publisher with another QoS is not received
            count = max(subscription.get_publisher_count(), 1)
            if count == self._counts[topic]:
                continue
            self._counts[topic], name = count, ros.full_name(self._node, topic)
            self._warnings.pop(topic, None)
            if count > 1:
                self._warnings[topic] = (
                    f'{count} publishers of {name} ({", ".join(self._publishers(name))}), 1 '
                    'expected: the messages of all are used; a process that was killed counts for '
                    '20 s'
                )
                self._node.get_logger().warning(self._warnings[topic])
            else:
                self._node.get_logger().info(f'1 publisher of {name} again')

    def add_warnings(self, health: Health) -> Health:
        """Return a health with the present warnings, at least WARN if there are any."""
        if not self._warnings:
            return health
        causes = [] if health.level == OK else [health.message]
        message = '; '.join([*causes, *self._warnings.values()])
        return health._replace(level=max(health.level, WARN), message=message)

    def _publishers(self, name):
        infos = self._node.get_publishers_info_by_topic(name)
        return sorted(f'{info.node_namespace.rstrip("/")}/{info.node_name}' for info in infos)
