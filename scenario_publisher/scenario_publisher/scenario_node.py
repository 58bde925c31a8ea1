"""ROS node of a scenario: path and edges latched and repeated, obstacles at each instant."""

import sys

from msgs_yaml import decode, encode, raw_scenario, share
from node_runtime import ros, spin_node, subscriptions_node
from node_runtime.clocks import SteadyClock
from node_runtime.managed_node import ManagedNode
from scenario_publisher import scenario
from scenario_publisher.scenario import NodeParams
from scenario_publisher.timeline import NAME, RUN_START, Timeline

POLL_S = 0.02  # of wall time, between two checks for subscribers
THROTTLE_S = 1.0
PREDICTIONS, ODOMETRY = '/scenario/predictions', '/vehicle/odometry'


class ScenarioNode(ManagedNode):
    """Follows /clock in lockstep, the wall clock in realtime."""

    def __init__(self):
        super().__init__(NAME)
        defaults = share.path('scenario_publisher', 'config', 'scenario_node.yaml')
        self.params = ros.declare(self, NodeParams, defaults)

    def configure(self):
        """Load the scenario and join the graph."""
        scn = scenario.load(self.params.scenario)
        self.timeline = Timeline(scn, ros.mode(self))
        self.reference_pub = ros.publisher(self, '/scenario/reference')
        self.edges_pub = ros.publisher(self, '/scenario/road_edges')
        # known to others before that of the obstacles: in lockstep a controller waits for both
        self.predictions_pub = ros.publisher(self, PREDICTIONS) if scn.predicts else None
        self.obstacles_pub = ros.publisher(self, '/scenario/obstacles')
        self.health_pub = ros.publisher(self, '/diagnostics')
        # serialised once: building the messages takes longer than the time between two obstacles
        self.path = ros.serialize(encode.reference(scn.reference))
        self.edges = ros.serialize(encode.road_edges(scn.edges))
        self.pending_ns = None  # simulated instant that is not answered yet
        self.listeners = {'/scenario/obstacles': 1}  # that the first answer waits for
        if scn.predicts:
            self.listeners[PREDICTIONS] = 1
        self.has_sight, self.state, self.state_ns = scn.sight is not None, None, None
        if self.has_sight:
            ros.subscribe(self, ODOMETRY, self.on_odometry, raw=True)
        if ros.mode(self) == 'lockstep':
            ros.subscribe(self, '/clock', self.on_clock)
            self.polling = ros.steady_timer(self, POLL_S, self.answer)
        else:
            self.wall = SteadyClock()
            ros.subscribe(self, RUN_START, self.on_run_start, raw=True)
            ros.steady_timer(self, 1.0 / self.timeline.rate_hz, self.on_timer)
        self.get_logger().info(f'{scn.name}: {scn.description}')
        if not self.timeline.has_plant:
            self.get_logger().info(f'obstacles wait for the plant ({RUN_START})')

    def activate(self):
        """Publish from now on; in lockstep the instant first that came meanwhile."""
        if ros.mode(self) == 'lockstep':
            self.publish_road(scenario.START_NS if self.pending_ns is None else self.pending_ns)
            self.polling.reset()

    def on_clock(self, msg):
        """Answer an instant of simulated time under the same stamp."""
        try:
            stamp_ns = decode.clock(msg)
        except decode.DecodeError as error:
            self.log_rejected('/clock', error)
            return
        self.answer()
        if self.is_active and self.pending_ns is not None and stamp_ns > self.pending_ns:
            # time goes on without obstacles: this controller does not subscribe to them
            self.listeners = {}
            self.answer()
        self.pending_ns = stamp_ns
        self.answer()

    def on_odometry(self, raw):
        """Keep the newest state of the car; in lockstep an instant waits for that of its stamp."""
        try:
            self.state, self.state_ns = raw, decode.stamp_ns_of(raw)
        except decode.DecodeError as error:
            self.log_rejected(ODOMETRY, error)
        if self.state_ns == self.pending_ns:
            self.answer()

    def answer(self):
        """Answer the pending instant once all subscribers are matched."""
        if self.pending_ns is None or not self.is_active:
            return
        if ros.missing_subscriptions(self, self.listeners):
            return
        if self.has_sight and self.listeners and self.state_ns != self.pending_ns:
            return
        self.polling.cancel()
        self.publish(self.pending_ns)
        self.pending_ns = None

    def on_timer(self):
        """Publish at an instant of the wall clock."""
        if self.is_active:
            self.publish(self.wall.now_ns())

    def on_run_start(self, raw):
        """Take the start of the run; what is no instant leaves the last one as it is."""
        try:
            self.timeline.update_run_start(decode.run_start(ros.deserialize(RUN_START, raw)))
        except decode.DecodeError as error:
            self.log_rejected(RUN_START, error)

    def log_rejected(self, topic, error):
        """Log why a message is not used."""
        text = f'{topic} rejected: {error}'
        self.get_logger().error(text, throttle_duration_sec=THROTTLE_S)

    def publish(self, stamp_ns):
        """Publish the obstacles, and path, edges and health when they are due."""
        if self.has_sight and self.state is not None:
            try:
                state = subscriptions_node.read_odometry(self.state)
                self.timeline.car = state.X, state.Y
            except decode.DecodeError as error:
                self.log_rejected(ODOMETRY, error)
        if self.timeline.has_plant:
            obstacles = self.timeline.obstacles(stamp_ns)
            if self.predictions_pub:
                predictions = encode.predictions(self.timeline.predictions(obstacles))
                self.predictions_pub.publish(predictions)
            self.obstacles_pub.publish(encode.obstacles(obstacles))
        self.publish_road(stamp_ns)
        if self.timeline.health_rate.is_due(stamp_ns):
            self.health_pub.publish(encode.health(self.timeline.health(stamp_ns)))

    def publish_road(self, stamp_ns):
        """Publish path and edges when they are due."""
        if self.timeline.road_rate.is_due(stamp_ns):
            self.reference_pub.publish(raw_scenario.restamp_reference(self.path, stamp_ns))
            self.edges_pub.publish(raw_scenario.restamp_road_edges(self.edges, stamp_ns))


def main():
    """Run the node."""
    about = 'Publish the road, the path and the obstacles of a scenario.'
    example = '--ros-args -p mode:=realtime -p scenario:=moving_obstacle'
    return spin_node.run(ScenarioNode, about, example)


if __name__ == '__main__':
    sys.exit(main())
