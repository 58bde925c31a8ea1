"""Shapes as messages of the marker topics, and the car's frame as /tf carries it."""

from collections.abc import Sequence

from builtin_interfaces.msg import Time
from geometry_msgs.msg import Point, TransformStamped
from std_msgs.msg import ColorRGBA, Header
from visualization_msgs.msg import Marker, MarkerArray

from bags.viewers import marker_scene
from bags.viewers.marker_scene import Shape
from msgs_yaml import contract, conversions
from msgs_yaml.types import VehicleState

TYPES = {
    marker_scene.BOX: Marker.CUBE,
    marker_scene.DISC: Marker.CYLINDER,
    marker_scene.LINE: Marker.LINE_STRIP,
    marker_scene.TEXT: Marker.TEXT_VIEW_FACING,
}


def marker_array(topic: str, stamp_ns: int, drawn: Sequence[Shape]) -> MarkerArray:
    """Return the message of a marker topic: the shapes drawn now, and nothing of before."""
    frame = contract.load().topics[topic].frame
    header = Header(stamp=_time(stamp_ns), frame_id=frame)
    clear = Marker(header=header, action=Marker.DELETEALL)
    return MarkerArray(markers=[clear, *(_marker(header, one) for one in drawn)])


def transform(x: VehicleState) -> TransformStamped:
    """Return the pose of base_link in map."""
    odometry = contract.load().topics['/vehicle/odometry']
    header = Header(stamp=_time(x.stamp_ns), frame_id=odometry.frame)
    msg = TransformStamped(header=header, child_frame_id=odometry.child_frame)
    msg.transform.translation.x, msg.transform.translation.y = x.X, x.Y
    msg.transform.rotation.z, msg.transform.rotation.w = conversions.heading_to_quaternion(x.psi)
    return msg


def _marker(header, one):
    msg = Marker(header=header, ns=one.ns, id=one.id, type=TYPES[one.kind], action=Marker.ADD)
    position, orientation = msg.pose.position, msg.pose.orientation
    position.x, position.y, position.z = one.at
    orientation.z, orientation.w = conversions.heading_to_quaternion(one.yaw)
    if one.kind == marker_scene.TEXT:
        msg.scale.z = one.size[0]
    else:
        msg.scale.x, msg.scale.y, msg.scale.z = one.size
    msg.color = _colour(one.colour)
    msg.points = [Point(x=float(X), y=float(Y)) for X, Y in one.points]
    msg.colors = [_colour(colour) for colour in one.colours]
    msg.text = one.text
    return msg


def _colour(rgba):
    red, green, blue, opacity = (float(value) for value in rgba)
    return ColorRGBA(r=red, g=green, b=blue, a=opacity)


def _time(stamp_ns):
    sec, nanosec = conversions.split_stamp(stamp_ns)
    return Time(sec=sec, nanosec=nanosec)
