"""Announces a second publisher of a topic: its messages are heard, too, and followed."""

from collections.abc import Mapping

from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.subscription import Subscription

from msgs_yaml.types import Health
from node_runtime import ros
from node_runtime.ages import OK, WARN

LOOK_S = 1.0  # of wall time


class Publishers:
    """Counts the publishers of subscriptions once per second; each change is a line of the log.

    With one publisher of each topic nothing is said, and health stays as it is.
    """

    def __init__(self, node: Node, subscriptions: Mapping[str, Subscription]):
        """`subscriptions` of the node, by topic of the contract."""
        self._node, self._subscriptions = node, subscriptions
        self._counts = dict.fromkeys(subscriptions, 1)
        self._warnings: dict[str, str] = {}  # by topic
        node.create_timer(LOOK_S, self.look, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def look(self) -> None:
        """Count; log topics that have got several publishers, and those that have one again."""
        for topic, subscription in self._subscriptions.items():
            # matched ones: a publisher of other QoS is not heard
            count = max(subscription.get_publisher_count(), 1)
            if count == self._counts[topic]:
                continue
            self._counts[topic] = count
            self._warnings.pop(topic, None)
            if count > 1:
                self._warnings[topic] = self._warning(topic, count)
                self._node.get_logger().warning(self._warnings[topic])
            else:
                self._node.get_logger().info(f'1 publisher of {self._name(topic)} again')

    def added_to(self, health: Health) -> Health:
        """Return a health with the present warnings, at least WARN if there are any."""
        if not self._warnings:
            return health
        causes = [] if health.level == OK else [health.message]
        message = '; '.join([*causes, *self._warnings.values()])
        return health._replace(level=max(health.level, WARN), message=message)

    def _warning(self, topic, count):
        found = self._node.get_publishers_info_by_topic(self._name(topic))
        nodes = sorted(f'{one.node_namespace.rstrip("/")}/{one.node_name}' for one in found)
        return (
            f'{count} publishers of {self._name(topic)} ({", ".join(nodes)}), 1 expected: '
            'all of them are heard; a process that was killed counts for 20 s'
        )

    def _name(self, topic):
        return ros.full_name(self._node, topic)
