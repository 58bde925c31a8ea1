"""Draws the ring for RViz and Foxglove: car, circles, unsafe areas, plan; and /tf where it can.

It watches with queues of one message that may be lost, so that it never slows what it watches.
"""

import sys

from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, HistoryPolicy, ReliabilityPolicy

from bags.viewers import encode, shapes
from msgs_yaml import contract, decode, qos, ros, share

try:
    from tf2_msgs.msg import TFMessage
except ImportError:  # there is no wheel of it
    TFMessage = None

VEHICLE, SAFETY, PREDICTION = '/markers/vehicle', '/markers/safety', '/markers/prediction'
PERIOD_NS = 50_000_000  # that of the controller
TF_DEPTH = 100  # what tf2 listeners use


class MarkersNode(Node):
    """Keeps the latest of every topic and draws it 20 times a second of ROS time."""

    def __init__(self):
        super().__init__('markers')
        defaults = share.path('bags', 'config', 'markers.yaml')
        self.params = ros.declare(self, shapes.ShapeParams, defaults)
        self.latest = {}
        self.due_ns = 0
        self.pubs = {topic: ros.publisher(self, topic) for topic in (VEHICLE, SAFETY, PREDICTION)}
        self.tf = self.create_publisher(TFMessage, '/tf', TF_DEPTH) if TFMessage else None
        if self.tf is None:
            self.get_logger().info('tf2_msgs is not installed: no /tf; markers are in map anyway')
        for topic, decoder in (
            ('/scenario/reference', decode.reference),
            ('/scenario/road_edges', decode.road_edges),
            ('/scenario/obstacles', decode.obstacles),
            ('/controller/why', decode.why),
        ):
            self._watch(topic, lambda raw, t=topic, d=decoder: self._keep(t, d, raw))
        self._watch('/vehicle/odometry', self.on_odometry)
        self._watch('/controller/prediction', self.on_prediction)

    def _watch(self, topic, callback):
        profile = qos.profile(contract.load().topics[topic].qos[ros.mode(self)])
        profile.history, profile.depth = HistoryPolicy.KEEP_LAST, 1
        profile.deadline = Duration()
        if profile.durability != DurabilityPolicy.TRANSIENT_LOCAL:
            profile.reliability = ReliabilityPolicy.BEST_EFFORT
        self.create_subscription(ros.message_type(topic), topic, callback, profile, raw=True)

    def _keep(self, topic, decoder, raw):
        self.latest[topic] = decoder(ros.message(topic, raw))

    def on_odometry(self, raw):
        """Draw car and areas when a period of theirs has passed since the last time."""
        stamp_ns = decode.stamp_ns_of(raw)
        # a clock that went back is a run that began anew
        if self.due_ns - PERIOD_NS <= stamp_ns < self.due_ns:
            return
        self.due_ns = stamp_ns + PERIOD_NS
        state = decode.odometry(ros.message('/vehicle/odometry', raw))
        self._publish(VEHICLE, state, shapes.vehicle(state, self._friction(), self.params.outline))
        seen = self.latest.get('/scenario/obstacles')
        edges = self.latest.get('/scenario/road_edges')
        areas = shapes.safety(state, seen.items if seen else (), edges, self.params.safety)
        self._publish(SAFETY, state, areas)
        if self.tf:
            self.tf.publish(TFMessage(transforms=[encode.transform(state)]))

    def on_prediction(self, raw):
        """Draw the plan."""
        plan = decode.prediction(ros.message('/controller/prediction', raw))
        reference = self.latest.get('/scenario/reference')
        self._publish(PREDICTION, plan, shapes.prediction(plan, reference))

    def _friction(self):
        why = self.latest.get('/controller/why')
        return shapes.friction_use(why.values) if why else {}

    def _publish(self, topic, value, drawn):
        self.pubs[topic].publish(encode.markers(topic, value.stamp_ns, drawn))


def main() -> int:
    """Draw until SIGINT or SIGTERM."""
    return ros.spin(MarkersNode)


if __name__ == '__main__':
    sys.exit(main())
