"""A controller node: steers to a point of the coarse path ahead (pure pursuit), avoids nothing."""

import contextlib
import math

import numpy as np
import rclpy
from nav_msgs.msg import Odometry, Path
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
from rclpy.signals import SignalHandlerOptions
from sensor_msgs.msg import JointState

TICK_NS = 50_000_000  # between two answers
PREVIEW_S = 0.7  # of driving, to the point that is steered to
WHEELBASE_M, MASS_KG, SPEED_S = 2.9, 1800.0, 0.5  # SPEED_S: to reach the desired speed

EVERY_MESSAGE = QoSProfile(reliability=ReliabilityPolicy.RELIABLE, history=HistoryPolicy.KEEP_ALL)
LATCHED = QoSProfile(
    reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL, depth=1
)


def steer_and_force(path, v_ref, pose, vx):
    """Return the road-wheel angle [rad] and the longitudinal force [N]."""
    X, Y, psi = pose
    nearest = np.argmin(np.hypot(path[:, 0] - X, path[:, 1] - Y))
    s = np.concatenate([[0], np.cumsum(np.hypot(*np.diff(path, axis=0).T))])
    ahead = min(np.searchsorted(s, s[nearest] + PREVIEW_S * vx), len(path) - 1)
    dx, dy = path[ahead] - (X, Y)
    alpha = math.atan2(dy, dx) - psi
    delta = math.atan(2 * WHEELBASE_M * math.sin(alpha) / math.hypot(dx, dy))
    return delta, MASS_KG * (v_ref[min(nearest, len(v_ref) - 1)] - vx) / SPEED_S


class FollowPath(Node):
    """Answers the state of every 50 ms with a command that has its stamp."""

    def __init__(self):
        super().__init__('controller')
        self.recorders = self.declare_parameter('recorders', 0).value
        self.path = self.state = None
        self.delta = 0.0
        self.commands = self.create_publisher(JointState, 'controller/command', EVERY_MESSAGE)
        self.create_subscription(Path, 'scenario/reference', self.on_path, LATCHED)
        self.create_subscription(Odometry, 'vehicle/odometry', self.on_state, EVERY_MESSAGE)
        self.create_timer(0.02, self.answer)  # until everybody listens

    def on_path(self, msg):
        """Keep the points [m] and the desired speeds [m/s], from the stamps of the poses."""
        poses = msg.poses
        self.path = np.array([(p.pose.position.x, p.pose.position.y) for p in poses])
        t = np.array([p.header.stamp.sec + 1e-9 * p.header.stamp.nanosec for p in poses])
        self.v_ref = np.hypot(*np.diff(self.path, axis=0).T) / np.diff(t)

    def on_state(self, msg):
        """Answer the first state of each tick; the others are for those who want more."""
        if msg.header.stamp.nanosec % TICK_NS == 0:
            self.state = msg
            self.answer()

    def answer(self):
        """Send the command for the state, once plant and recorder listen."""
        listeners = self.commands.get_subscription_count()
        if self.state is None or self.path is None or listeners < 1 + self.recorders:
            return
        pose, vx = self.state.pose.pose, self.state.twist.twist.linear.x
        psi = 2 * math.atan2(pose.orientation.z, pose.orientation.w)
        place = pose.position.x, pose.position.y, psi
        delta, force = steer_and_force(self.path, self.v_ref, place, vx)
        command = JointState()
        command.header.stamp = self.state.header.stamp
        command.header.frame_id = 'base_link'
        command.name = ['steer', 'front_axle', 'rear_axle']
        command.position = [delta, 0.0, 0.0]
        command.velocity = [(delta - self.delta) / 0.05, 0.0, 0.0]
        command.effort = [0.0, 0.0, force]  # rear-wheel drive
        self.commands.publish(command)
        self.delta, self.state = delta, None


def main():
    """Answer until SIGINT, then wait until everybody has the last commands."""
    # the handlers of rclpy would shut it down first, and then nothing is sent again
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    node = FollowPath()
    with contextlib.suppress(KeyboardInterrupt):
        rclpy.spin(node)
    node.commands.wait_for_all_acked(Duration(seconds=5))


if __name__ == '__main__':
    main()
