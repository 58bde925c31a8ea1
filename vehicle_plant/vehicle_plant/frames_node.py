"""/robot_description, and /tf and /tf_static where tf2_msgs is installed: frames of the car.

They are for other programs (RViz, rosbag2, a sensor model): no node of this project needs them.
"""

from builtin_interfaces.msg import Time
from geometry_msgs.msg import TransformStamped
from rclpy.node import Node
from std_msgs.msg import Header, String

from msgs_yaml import contract, conversions, encode
from node_runtime import ros
from vehicle_plant import robot_description
from vehicle_plant.car import Car
from vehicle_plant.state import Trajectory, messages

try:
    from tf2_msgs.msg import TFMessage
except ImportError:  # there is no wheel of it
    TFMessage = None

TF, TF_STATIC, DESCRIPTION = '/tf', '/tf_static', '/robot_description'


class FramesPublisher:
    """Publishes the description once, and the frames of a moving car 50 times per second."""

    def __init__(self, node: Node, car: Car, publish_tf: bool = True):
        """`publish_tf` false: another node publishes the frames, which must have one publisher."""
        self._car_frames = robot_description.frames(car)
        self._description = String(data=robot_description.urdf(car))
        self.description_pub = ros.publisher(node, DESCRIPTION)
        self.tf_pub = self.static_pub = None
        self._period_ns = round(1e9 / contract.load().find(TF).rate_hz[ros.mode(node)])
        self._due_ns = 0
        if publish_tf and TFMessage is None:
            node.get_logger().info(
                f'tf2_msgs is not installed: no {TF}; poses are in /vehicle/odometry'
            )
        elif publish_tf:
            self.tf_pub, self.static_pub = ros.publisher(node, TF), ros.publisher(node, TF_STATIC)

    def announce(self) -> None:
        """Publish what does not move; subscribers that come later receive it, too. A run begins."""
        self._due_ns = 0
        self.description_pub.publish(self._description)
        if self.static_pub is not None:
            fixed = [frame for frame in self._car_frames if not frame.is_steered]
            # of time 0: valid at any time
            self.static_pub.publish(TFMessage(transforms=[_mounted(f, 0, 0.0) for f in fixed]))

    def publish(self, trajectory: Trajectory) -> None:
        """Publish the frames at the rows of a trajectory that are due, if anyone listens."""
        stamps = trajectory.stamp_ns
        if self.tf_pub is None or stamps[-1] < self._due_ns:
            return
        if not self.tf_pub.get_subscription_count():
            return  # they stay due: a car that is held at its start is shown to whoever comes
        rows = []
        for row, stamp_ns in enumerate(stamps.tolist()):
            if stamp_ns >= self._due_ns:
                rows.append(row)
                self._due_ns = stamp_ns + self._period_ns
        due = trajectory.where(rows)
        moving = [frame for frame in self._car_frames if frame.is_steered]
        for state, actuators in zip(*map(messages, (due.state_columns(), due.actuator_columns()))):
            wheels = [_mounted(frame, state.stamp_ns, actuators.delta) for frame in moving]
            self.tf_pub.publish(TFMessage(transforms=[encode.transform(state), *wheels]))


def _mounted(frame, stamp_ns, angle):
    """Return the place of a part in the car, turned about z by an angle (rad)."""
    sec, nanosec = conversions.split_stamp(stamp_ns)
    header = Header(stamp=Time(sec=sec, nanosec=nanosec), frame_id=robot_description.BASE)
    msg = TransformStamped(header=header, child_frame_id=frame.name)
    place, turn = msg.transform.translation, msg.transform.rotation
    place.x, place.y, place.z = frame.x, frame.y, frame.z
    turn.z, turn.w = conversions.heading_to_quaternion(angle)
    return msg
