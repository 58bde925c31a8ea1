"""Publishes a scenario: path and edges latched and repeated, obstacles at each instant."""

import sys

from rclpy.clock import Clock, ClockType
from rclpy.node import Node

from msgs_yaml import decode, encode, ros, share
from scenario_publisher import scenario
from scenario_publisher.parameters import NodeParams
from scenario_publisher.timeline import NAME, Timeline

LOOK_S = 0.02  # of wall time, between two looks at who is listening


class ScenarioNode(Node):
    """Follows /clock in lockstep, the wall clock in realtime."""

    def __init__(self):
        super().__init__(NAME)
        defaults = share.path('scenario_publisher', 'config', 'scenario_node.yaml')
        parameters = ros.declare(self, NodeParams, defaults)
        scn = scenario.load(parameters.scenario)
        self.timeline = Timeline(scn, ros.mode(self))
        self.reference_pub = ros.publisher(self, '/scenario/reference')
        self.edges_pub = ros.publisher(self, '/scenario/road_edges')
        self.obstacles_pub = ros.publisher(self, '/scenario/obstacles')
        self.health_pub = ros.publisher(self, '/diagnostics')
        self.instant = None  # of simulated time, not answered yet
        if ros.mode(self) == 'lockstep':
            ros.subscribe(self, '/clock', self.on_clock)
            steady = Clock(clock_type=ClockType.STEADY_TIME)
            self.looking = self.create_timer(LOOK_S, self.answer, clock=steady)
            self.publish_facts(scenario.START_NS)
        else:
            self.start_sub = ros.subscribe(self, '/vehicle/odometry', self.on_start, raw=True)
            self.create_timer(1.0 / self.timeline.rate_hz, self.on_timer)
        self.get_logger().info(f'{scn.name}: {scn.description}')

    def on_clock(self, msg):
        """Answer an instant of simulated time under the same stamp."""
        self.instant = decode.clock(msg)
        self.answer()

    def answer(self):
        """Answer the instant as soon as all are listening; from then on at once."""
        if self.instant is None or ros.unheard(self, {'/scenario/obstacles': 1}):
            return
        self.looking.cancel()
        self.publish(self.instant)
        self.instant = None

    def on_timer(self):
        """Publish at an instant of the wall clock."""
        self.publish(self.get_clock().now().nanoseconds)

    def on_start(self, raw):
        """Let obstacles move once the vehicle does: the first odometry is the beginning."""
        self.timeline.begin(decode.stamp_ns_of(raw))
        self.destroy_subscription(self.start_sub)

    def publish(self, stamp_ns):
        """Publish the obstacles, and what else is due."""
        self.obstacles_pub.publish(encode.obstacles(self.timeline.obstacles(stamp_ns)))
        self.publish_facts(stamp_ns)
        if self.timeline.health_beat.is_due(stamp_ns):
            self.health_pub.publish(encode.health(self.timeline.health(stamp_ns)))

    def publish_facts(self, stamp_ns):
        """Publish path and edges when they are due."""
        if self.timeline.facts.is_due(stamp_ns):
            self.reference_pub.publish(encode.reference(self.timeline.reference(stamp_ns)))
            self.edges_pub.publish(encode.road_edges(self.timeline.edges(stamp_ns)))


def main():
    """Run the node."""
    return ros.spin(ScenarioNode)


if __name__ == '__main__':
    sys.exit(main())
