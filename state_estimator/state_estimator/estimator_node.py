"""ROS node of the estimator: messages of the sensors in, odometry with its covariance out."""

import sys
import time
from functools import partial

from msgs_yaml import conversions, decode, encode, flat_fields, share
from msgs_yaml.decode import DecodeError
from msgs_yaml.types import Health
from node_runtime import ros, spin_node
from node_runtime.clocks import SteadyClock
from node_runtime.input_monitor import OK, WARN, HeldLevel
from node_runtime.log_filters import ChangeFilter, RejectionLog
from node_runtime.managed_node import ManagedNode
from node_runtime.subscriptions_node import PublisherMonitor
from state_estimator import estimate
from state_estimator.estimators import Stream
from state_estimator.parameters import EstimatorParams

NAME, ODOMETRY, RUN_START = 'estimator', '/estimator/odometry', '/vehicle/run_start'
INERTIAL = '/sensors/inertial'
DECODERS = {
    '/sensors/gnss': decode.gnss,
    '/sensors/chassis': decode.chassis,
    INERTIAL: decode.inertial,
}
TIMER_S = 0.02  # of wall time, between two checks of subscribers and of the car
HEALTH_NS = conversions.NS_PER_S  # between two reports of the health
NO_STATE, NO_IMU = 'no state yet: no fix, or no chassis', f'no message of {INERTIAL}'


class EstimatorNode(ManagedNode):
    """Feeds an estimator what it hears, in order of arrival, which is that of sending."""

    def __init__(self):
        super().__init__(NAME)
        defaults = share.path('state_estimator', 'config', 'estimator.yaml')
        self.params = ros.declare(self, EstimatorParams, defaults)

    def configure(self):
        """Join the graph."""
        self.stream, self.wall = Stream(self.params), SteadyClock()
        self.odometry_pub, self.pending = None, None  # estimate that waits for its subscribers
        self.health_pub = ros.publisher(self, '/diagnostics')
        self.run_start_ns = None
        if ros.mode(self) == 'realtime':
            # heard before the sensors of the run, which are sent later
            ros.subscribe(self, RUN_START, self.on_run_start)
        subscriptions = {
            topic: ros.subscribe(self, topic, partial(self.on_message, topic), raw=True)
            for topic in DECODERS
        }
        self.inertial_sub = subscriptions[INERTIAL]
        self.publishers_of = PublisherMonitor(self, subscriptions)
        self.refusals = {topic: RejectionLog(topic) for topic in DECODERS}
        self.reported_ns = 0
        ros.steady_timer(self, TIMER_S, self.on_timer)

    def activate(self):
        """Begin without a state."""
        self.begin()

    def begin(self):
        """Forget the drive."""
        self.stream.begin()
        self.status_log, self.held, self.cause = ChangeFilter(), HeldLevel(), ''
        self.pending, self.resets, self.heard_ns = None, 0, self.wall.now_ns()

    def on_run_start(self, msg):
        """Begin anew when the run begins: before, the car is held at its start at speed."""
        try:
            start_ns = decode.run_start(msg)
        except DecodeError as error:
            self.get_logger().error(f'{RUN_START} rejected: {error}', throttle_duration_sec=1.0)
            return
        if start_ns != self.run_start_ns:
            self.run_start_ns, self.stream.is_held = start_ns, not start_ns
            self.begin()

    def on_message(self, topic, raw):
        """Use a message of a sensor, or log why not; publish after one of the IMU."""
        if not self.is_active:
            return
        try:
            value = flat_fields.load(topic).read(raw)
            if value is None:
                value = DECODERS[topic](ros.deserialize(topic, raw))
        except DecodeError as error:
            line = self.refusals[topic].line('unreadable', str(error), time.monotonic_ns())
            if line:
                self.get_logger().warning(line)
            return
        believed = self.stream.take(value)
        if topic != INERTIAL:
            return
        self.heard_ns = self.wall.now_ns()
        if believed:
            self.pending = believed
            self.publish()
        self.report(value.stamp_ns, believed.status if believed else NO_STATE)

    def publish(self):
        """Publish the estimate that waits, once its subscribers are connected."""
        if self.odometry_pub is None:
            self.odometry_pub, self.is_connected = ros.TemplatePublisher(self, ODOMETRY), False
            self.odometry_pub.publisher.on_activate(None)  # the node is active already
        self.is_connected = self.is_connected or not ros.missing_subscriptions(self, {ODOMETRY: 1})
        if self.is_connected:
            self.odometry_pub.publish(self.pending.as_message())
            self.pending = None

    def report(self, stamp_ns, status):
        """Log what is missing and why the estimator began anew; publish the health when due."""
        # every status, `ok` too: what fails a second time is told again
        faults = [status] if self.status_log.has_changed(status) and status != estimate.OK else []
        if self.stream.resets > self.resets:
            faults.append(f'begun anew: {self.stream.reason}')
        self.resets = self.stream.resets
        for self.cause in faults:
            self.get_logger().warning(self.cause)
        if not faults and stamp_ns // HEALTH_NS == self.reported_ns // HEALTH_NS:
            return
        self.reported_ns = stamp_ns
        level = self.held.update(WARN if faults or status != estimate.OK else OK, stamp_ns)
        values = {'begun_anew': self.resets}
        if self.stream.estimate:
            values['friction'] = self.stream.estimate.friction
        message = self.cause if level else 'estimating'
        self.health_pub.publish(
            encode.health(
                self.publishers_of.add_warnings(Health(stamp_ns, NAME, level, message, values))
            )
        )

    def on_timer(self):
        """Publish what waits; without a car withdraw the odometry, by which others know of one."""
        if not self.is_active:
            return
        if self.pending:
            self.publish()
        if self.odometry_pub and not self.inertial_sub.get_publisher_count():
            self.destroy_lifecycle_publisher(self.odometry_pub.publisher)
            self.odometry_pub = None
        now_ns = self.wall.now_ns()
        if ros.mode(self) == 'realtime' and now_ns - self.heard_ns > HEALTH_NS:
            self.heard_ns = now_ns
            self.report(now_ns, NO_IMU)


def main() -> int:
    """Run the node."""
    about = 'Estimate the state of the car from its sensors, with its covariance.'
    example = '--ros-args -p mode:=realtime -p method:=kinematic'
    return spin_node.run(EstimatorNode, about, example)


if __name__ == '__main__':
    sys.exit(main())
