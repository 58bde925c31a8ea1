"""Draws the ring for RViz and Foxglove: car, circles, unsafe areas, plan; and /tf where it can.

Topics and tf are in its namespace: the frames of every car have the same names. It watches with
queues of one message that may be lost, so that it never slows what it watches.
"""

import sys
from functools import partial
from typing import Any

from rclpy.node import Node

from bags.viewers import encode, marker_scene
from msgs_yaml import contract, decode, share
from node_runtime import ros, spin_node, subscriptions_node

try:
    from tf2_msgs.msg import TFMessage
except ImportError:  # there is no wheel of it
    TFMessage = None

DECODERS = {
    marker_scene.STATE: decode.odometry,
    marker_scene.PLAN: decode.prediction,
    marker_scene.WHY: decode.why,
}
READERS = {  # of serialised messages
    marker_scene.REFERENCE: subscriptions_node.read_reference,
    marker_scene.EDGES: subscriptions_node.read_road_edges,
    marker_scene.OBSTACLES: subscriptions_node.read_obstacles,
}
THROTTLE_S = 1.0
TF_DEPTH = 100  # what tf2 listeners use


class MarkersNode(Node):
    """Draws each plan, and the car 20 times a second of ROS time."""

    def __init__(self):
        super().__init__('markers')
        defaults = share.path('bags', 'config', 'markers.yaml')
        self.stage = marker_scene.MarkerScene(ros.declare(self, marker_scene.ShapeParams, defaults))
        drawn = (marker_scene.VEHICLE, marker_scene.SAFETY, marker_scene.PREDICTION)
        self.pubs = {topic: ros.publisher(self, topic) for topic in drawn}
        self.tf = self.create_publisher(TFMessage, 'tf', TF_DEPTH) if TFMessage else None
        if self.tf is None:
            self.get_logger().info('tf2_msgs is not installed: no /tf; markers are in map anyway')
        for topic in marker_scene.WATCHED:
            offered = contract.load().topics[topic].qos[ros.mode(self)]
            callback, kind = partial(self.on_message, topic), ros.message_type(topic)
            self.create_subscription(
                kind, ros.relative_name(topic), callback, ros.observer_profile(offered), raw=True
            )

    def on_message(self, topic, raw):
        """Draw what a message changes, and nothing of one that breaks the contract."""
        try:
            if not self.stage.wants(
                topic, decode.stamp_ns_of(raw) if topic == marker_scene.STATE else 0
            ):
                return
            value = read(topic, raw)
        except decode.DecodeError as error:
            told = f'nothing is drawn of this: {error}'
            self.get_logger().warning(told, throttle_duration_sec=THROTTLE_S)
            return
        for picture in self.stage.take(topic, value):
            self.pubs[picture.topic].publish(encode.marker_array(*picture))
        if topic == marker_scene.STATE and self.tf:
            self.tf.publish(TFMessage(transforms=[encode.transform(value)]))


def read(topic: str, raw: bytes) -> Any:
    """Return the value of a serialised message of a topic of WATCHED; DecodeError."""
    if topic in READERS:
        return READERS[topic](raw)
    return DECODERS[topic](ros.deserialize(topic, raw))


def main() -> int:
    """Draw until SIGINT or SIGTERM."""
    return spin_node.spin(MarkersNode)


if __name__ == '__main__':
    sys.exit(main())
