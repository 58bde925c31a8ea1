"""Publishes markers for RViz and Foxglove: car, circles, unsafe areas, plan.

Topics and tf are in its namespace: the frames of every car have the same names. Its subscriptions
are best effort with a queue of one, so that it never slows a publisher. Where no plant publishes
/tf, as while a bag is played, it does; that needs tf2_msgs.
"""

import sys
from functools import partial

from rclpy.node import Node

from bags.storage.decoding import DECODERS
from bags.viewers import marker_scene
from msgs_yaml import contract, decode, encode, share
from node_runtime import ros, spin_node, subscriptions_node

try:
    from tf2_msgs.msg import TFMessage
except ImportError:  # there is no wheel of it
    TFMessage = None

READERS = {  # of serialised messages of any size
    marker_scene.REFERENCE: subscriptions_node.read_reference,
    marker_scene.EDGES: subscriptions_node.read_road_edges,
    marker_scene.OBSTACLES: subscriptions_node.read_obstacles,
}
THROTTLE_S = 1.0
TF = '/tf'


class MarkersNode(Node):
    """Publishes markers of each plan, and of the car 20 times per second of ROS time."""

    def __init__(self):
        super().__init__('markers')
        defaults = share.path('bags', 'config', 'markers.yaml')
        self.scene = marker_scene.MarkerScene(ros.declare(self, marker_scene.ShapeParams, defaults))
        drawn = (marker_scene.VEHICLE, marker_scene.SAFETY, marker_scene.PREDICTION)
        self.pubs = {topic: ros.publisher(self, topic) for topic in drawn}
        self.tf = ros.publisher(self, TF) if TFMessage else None
        if self.tf is None:
            self.get_logger().info('tf2_msgs is not installed: no /tf; markers are in map anyway')
        for topic in marker_scene.WATCHED:
            profile = ros.observer_profile(contract.load().topics[topic], ros.mode(self))
            callback, kind = partial(self.on_message, topic), ros.message_type(topic)
            self.create_subscription(kind, ros.relative_name(topic), callback, profile, raw=True)

    def on_message(self, topic, raw):
        """Publish what a message changes; nothing for one that breaks the contract."""
        try:
            stamp_ns = decode.stamp_ns_of(raw) if topic == marker_scene.STATE else 0
            if not self.scene.needs(topic, stamp_ns):
                return
            if topic in READERS:
                value = READERS[topic](raw)
            else:
                value = DECODERS[topic](ros.deserialize(topic, raw))
        except decode.DecodeError as error:
            text = f'nothing is drawn of this: {error}'
            self.get_logger().warning(text, throttle_duration_sec=THROTTLE_S)
            return
        for drawn, message in self.scene.update(topic, value).items():
            self.pubs[drawn].publish(message)
        if topic == marker_scene.STATE and self.tf and not self.has_other_tf():
            self.tf.publish(TFMessage(transforms=[encode.transform(value)]))

    def has_other_tf(self):
        """Return whether another node publishes /tf: a frame must have one publisher."""
        return self.count_publishers(ros.full_name(self, TF)) > 1


def main() -> int:
    """Publish until SIGINT or SIGTERM."""
    about = 'Publish road, obstacles, car and plan of a run as markers, for RViz and Foxglove.'
    return spin_node.run(MarkersNode, about, '--ros-args -p mode:=realtime')


if __name__ == '__main__':
    sys.exit(main())
