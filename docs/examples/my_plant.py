"""A plant: a car that rolls without slip (kinematic single track) and follows every set-point."""

import math
import sys

import rclpy
from builtin_interfaces.msg import Time
from nav_msgs.msg import Odometry
from rclpy.duration import Duration
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rclpy.qos import HistoryPolicy, QoSProfile
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState

START_NS, TICK_NS, STEP_NS, STEP_S = 1_000_000_000, 50_000_000, 10_000_000, 0.01
MASS_KG, WHEELBASE_M, TO_REAR_M = 1850.0, 2.89, 1.46


class Plant(Node):
    """Publishes the state of the car, and moves it as the commands say."""

    def __init__(self):
        super().__init__('plant')
        self.is_lockstep = self.given('mode', 'lockstep') == 'lockstep'
        self.recorders, self.time_s = self.given('recorders', 0), self.given('stop.time_s', 60.0)
        names = 'start.x_m', 'start.y_m', 'start.yaw_rad', 'start.speed_mps'
        self.X, self.Y, self.psi, self.v = (self.given(name, 0.0) for name in names)
        names = 'stop.x_m', 'stop.y_m', 'stop.yaw_rad'
        self.stop = [self.given(name, 0.0) for name in names]
        self.delta = self.force = self.d_delta = self.d_force = 0.0
        self.now_ns, self.begun_ns, self.steps, self.exit_code = START_NS, 0, 0, None
        # in lockstep nothing may be lost
        qos = QoSProfile(history=HistoryPolicy.KEEP_ALL) if self.is_lockstep else 10
        self.odometry = self.create_publisher(Odometry, 'vehicle/odometry', qos)
        self.clock_pub = self.create_publisher(Clock, 'clock', qos)
        self.run_start = self.create_publisher(Time, 'vehicle/run_start', qos)
        self.create_subscription(JointState, 'controller/command', self.on_command, qos)
        self.create_timer(0.1 if self.is_lockstep else STEP_S, self.on_timer)

    def given(self, name, default):
        """Return a parameter of the command line, or its default."""
        return self.declare_parameter(name, default).value

    def on_timer(self):
        """Realtime: move on to now. Lockstep: repeat the start until it is answered."""
        if not self.is_lockstep:
            wall_ns = self.get_clock().now().nanoseconds
            while self.begun_ns and self.now_ns + STEP_NS <= wall_ns:
                self.step()
            self.now_ns = self.now_ns if self.begun_ns else wall_ns
            self.run_start.publish(time_of(self.begun_ns))
            self.publish_state()
        elif not self.begun_ns and self.odometry.get_subscription_count() > self.recorders:
            self.publish_state()
            self.clock_pub.publish(Clock(clock=time_of(self.now_ns)))

    def on_command(self, msg):
        """Head for the set-points, which are due in 50 ms; in lockstep drive until then."""
        if self.is_lockstep and msg.header.stamp != time_of(self.now_ns):
            return
        self.begun_ns = self.begun_ns or self.now_ns
        self.steps = TICK_NS // STEP_NS
        self.d_delta = (msg.position[0] - self.delta) / self.steps
        self.d_force = (msg.effort[1] + msg.effort[2] - self.force) / self.steps
        if self.is_lockstep:
            for _ in range(self.steps):
                self.step()
                self.publish_state()
            self.clock_pub.publish(Clock(clock=time_of(self.now_ns)))

    def step(self):
        """Drive for 10 ms; end behind the finish line, or when the time is over."""
        if self.steps:
            self.delta, self.force = self.delta + self.d_delta, self.force + self.d_force
            self.steps -= 1
        slip = math.atan(TO_REAR_M / WHEELBASE_M * math.tan(self.delta))
        self.X += STEP_S * self.v / math.cos(slip) * math.cos(self.psi + slip)
        self.Y += STEP_S * self.v / math.cos(slip) * math.sin(self.psi + slip)
        self.psi += STEP_S * self.v * math.tan(self.delta) / WHEELBASE_M
        self.v = max(0.0, self.v + STEP_S * self.force / MASS_KG)
        self.now_ns += STEP_NS
        x, y, yaw = self.stop
        if (self.X - x) * math.cos(yaw) + (self.Y - y) * math.sin(yaw) >= 0.0:
            self.exit_code = 0
        elif self.now_ns - self.begun_ns > 1e9 * self.time_s:
            self.exit_code = 2

    def publish_state(self):
        """Say where the car is, and how fast: forwards, to the left, and turning."""
        msg = Odometry(child_frame_id='base_link')
        msg.header.frame_id, msg.header.stamp = 'map', time_of(self.now_ns)
        pose, twist = msg.pose.pose, msg.twist.twist
        pose.position.x, pose.position.y = self.X, self.Y
        pose.orientation.z, pose.orientation.w = math.sin(self.psi / 2), math.cos(self.psi / 2)
        twist.linear.x, twist.angular.z = self.v, self.v * math.tan(self.delta) / WHEELBASE_M
        twist.linear.y = TO_REAR_M * twist.angular.z
        self.odometry.publish(msg)


def time_of(stamp_ns):
    """Return a stamp in ns as a message."""
    return Time(sec=stamp_ns // 1_000_000_000, nanosec=stamp_ns % 1_000_000_000)


def main():
    """Drive one run; return its exit code."""
    rclpy.init()
    plant = Plant()
    try:
        while plant.exit_code is None:
            rclpy.spin_once(plant)
        print('finish line crossed' if plant.exit_code == 0 else 'out of time')
        plant.odometry.wait_for_all_acked(Duration(seconds=5))
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    plant.destroy_node()
    return plant.exit_code or 0


if __name__ == '__main__':
    sys.exit(main())
