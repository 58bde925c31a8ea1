"""Publishes markers for RViz and Foxglove: car, circles, unsafe areas, plan.

Topics and tf are in its namespace: the frames of every car have the same names. Its subscriptions
are best effort with a queue of one, so that it never slows a publisher. Where no plant publishes
/tf, as while a bag is played, it does; that needs tf2_msgs.
"""

import sys
from collections.abc import Sequence
from functools import partial

from builtin_interfaces.msg import Time
from geometry_msgs.msg import Point
from rclpy.node import Node
from std_msgs.msg import ColorRGBA, Header
from visualization_msgs.msg import Marker, MarkerArray

from bags.storage.decoding import DECODERS
from bags.viewers import marker_scene
from bags.viewers.marker_scene import Shape
from msgs_yaml import contract, conversions, decode, encode, share
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
MARKER_TYPES = {
    marker_scene.BOX: Marker.CUBE,
    marker_scene.DISC: Marker.CYLINDER,
    marker_scene.LINE: Marker.LINE_STRIP,
    marker_scene.TEXT: Marker.TEXT_VIEW_FACING,
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
        for drawing in self.scene.update(topic, value):
            self.pubs[drawing.topic].publish(marker_array(*drawing))
        if topic == marker_scene.STATE and self.tf and not self.has_other_tf():
            self.tf.publish(TFMessage(transforms=[encode.transform(value)]))

    def has_other_tf(self):
        """Return whether another node publishes /tf: a frame must have one publisher."""
        return self.count_publishers(ros.full_name(self, TF)) > 1


def marker_array(topic: str, stamp_ns: int, shapes: Sequence[Shape]) -> MarkerArray:
    """Return the message of a marker topic; it replaces all markers sent before."""
    frame = contract.load().topics[topic].frame
    sec, nanosec = conversions.split_stamp(stamp_ns)
    header = Header(stamp=Time(sec=sec, nanosec=nanosec), frame_id=frame)
    clear = Marker(header=header, action=Marker.DELETEALL)
    return MarkerArray(markers=[clear, *(_marker(header, shape) for shape in shapes)])


def _marker(header, shape):
    msg = Marker(
        header=header, ns=shape.ns, id=shape.id, type=MARKER_TYPES[shape.kind], action=Marker.ADD
    )
    position, orientation = msg.pose.position, msg.pose.orientation
    position.x, position.y, position.z = shape.at
    orientation.z, orientation.w = conversions.heading_to_quaternion(shape.yaw)
    if shape.kind == marker_scene.TEXT:
        msg.scale.z = shape.size[0]
    else:
        msg.scale.x, msg.scale.y, msg.scale.z = shape.size
    msg.color = _colour(shape.colour)
    msg.points = [Point(x=float(X), y=float(Y)) for X, Y in shape.points]
    msg.colors = [_colour(colour) for colour in shape.colours]
    msg.text = shape.text
    return msg


def _colour(rgba):
    red, green, blue, opacity = (float(value) for value in rgba)
    return ColorRGBA(r=red, g=green, b=blue, a=opacity)


def main() -> int:
    """Publish until SIGINT or SIGTERM."""
    about = 'Publish road, obstacles, car and plan of a run as markers, for RViz and Foxglove.'
    return spin_node.run(MarkersNode, about, '--ros-args -p mode:=realtime')


if __name__ == '__main__':
    sys.exit(main())
