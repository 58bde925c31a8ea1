"""Values to ROS messages. Names, frames and forms are those of topics.yaml; values are not checked.

Every function but `transform` is the inverse of the one of the same name in `decode`.
"""

import math
from array import array
from functools import partial

import numpy as np
from builtin_interfaces.msg import Duration, Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from geometry_msgs.msg import Point, PoseStamped, TransformStamped
from nav_msgs.msg import Odometry, Path
from rclpy.serialization import deserialize_message
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import Imu, JointState, PointCloud2, PointField
from std_msgs.msg import ColorRGBA, Header
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint
from visualization_msgs.msg import Marker, MarkerArray

from msgs_yaml import contract, conversions, flat_fields, point_cloud, types

# appearance in RViz and Foxglove
_EDGE_WIDTH_M = 0.15
_OBSTACLE_HEIGHT_M = 1.0
_ARROW_M = (0.15, 0.35)  # shaft and head diameter
_NOTHING = array('d', (0.0, 0.0, 0.0))
_WHITE = ColorRGBA(r=1.0, g=1.0, b=1.0, a=1.0)
_RED = ColorRGBA(r=0.85, g=0.15, b=0.1, a=0.9)


def _flat(topic, kind, x):
    """Return the message of a value of `flat_fields.TYPES`."""
    return deserialize_message(flat_fields.load(topic).fill(x), kind)


# each takes the value of its topic and returns the message
odometry = partial(_flat, '/vehicle/odometry', Odometry)
estimate = partial(_flat, '/estimator/odometry', Odometry)
imu = partial(_flat, '/vehicle/imu', Imu)
actuators = partial(_flat, '/vehicle/actuators', JointState)
wheels = partial(_flat, '/vehicle/wheels', JointState)
inertial = partial(_flat, '/sensors/inertial', Imu)
chassis = partial(_flat, '/sensors/chassis', JointState)
gnss = partial(_flat, '/sensors/gnss', Odometry)
command = partial(_flat, '/controller/command', JointState)


def transform(x: types.VehicleState) -> TransformStamped:
    """Return the pose of the car in the map, as /tf has it."""
    msg = TransformStamped(header=_header('/vehicle/odometry', x.stamp_ns))
    msg.child_frame_id = contract.load().topics['/vehicle/odometry'].child_frame
    msg.transform.translation.x, msg.transform.translation.y = x.X, x.Y
    msg.transform.rotation.z, msg.transform.rotation.w = conversions.heading_to_quaternion(x.psi)
    return msg


def reference(x: types.Reference) -> Path:
    """Return /scenario/reference."""
    return _path('/scenario/reference', x)


def prediction(x: types.Prediction) -> Path:
    """Return /controller/prediction."""
    return _path('/controller/prediction', x)


def stop_plan(x: types.StopPlan) -> JointTrajectory:
    """Return /controller/stop_plan."""
    msg = JointTrajectory(header=_header('/controller/stop_plan', x.stamp_ns))
    msg.joint_names = [*contract.load().topics['/controller/command'].joints]
    for t, delta, Fxf, Fxr in zip(*(column.tolist() for column in x[1:])):
        sec, nanosec = conversions.split_stamp(conversions.add_seconds(0, t))
        point = JointTrajectoryPoint(positions=[delta, 0.0, 0.0], effort=[0.0, Fxf, Fxr])
        point.velocities = point.accelerations = _NOTHING  # libraries differ in empty arrays
        point.time_from_start = Duration(sec=sec, nanosec=nanosec)
        msg.points.append(point)
    return msg


def road_edges(x: types.RoadEdges) -> MarkerArray:
    """Return /scenario/road_edges."""
    markers = []
    for ns, line in (('left', x.left), ('right', x.right)):
        marker = _marker('/scenario/road_edges', x.stamp_ns, ns, 0, Marker.LINE_STRIP, _WHITE)
        marker.scale.x = _EDGE_WIDTH_M
        marker.points = [Point(x=float(X), y=float(Y)) for X, Y in line]
        markers.append(marker)
    return MarkerArray(markers=markers)


def obstacles(x: types.Obstacles) -> MarkerArray:
    """Return /scenario/obstacles."""
    shapes, arrows = [], []
    for obstacle in x.items:
        kind = Marker.SPHERE_LIST if obstacle.others else Marker.CYLINDER
        marker = _obstacle_marker(x.stamp_ns, obstacle, 'obstacle', kind)
        marker.scale.x = marker.scale.y = marker.scale.z = 2.0 * float(obstacle.r_obs)
        if obstacle.others:
            others = (Point(x=float(dX), y=float(dY)) for dX, dY in obstacle.others)
            marker.points = [Point(), *others]
        else:
            marker.scale.z = _OBSTACLE_HEIGHT_M
        shapes.append(marker)
        if obstacle.vX or obstacle.vY:
            marker = _obstacle_marker(x.stamp_ns, obstacle, 'velocity', Marker.ARROW)
            marker.scale.x, marker.scale.y = _ARROW_M
            # tail at the centre: the tip alone carries the velocity, exactly
            marker.points = [Point(), Point(x=float(obstacle.vX), y=float(obstacle.vY))]
            arrows.append(marker)
    header = _header('/scenario/obstacles', x.stamp_ns)
    no_obstacle = [Marker(header=header, action=Marker.DELETEALL)]
    return MarkerArray(markers=shapes + arrows or no_obstacle)


def predictions(x: types.Predictions) -> PointCloud2:
    """Return /scenario/predictions."""
    branches = [(k, i, b) for k, several in x.by_id.items() for i, b in enumerate(several)]
    rows = np.zeros(sum(len(b.t) for _, _, b in branches), point_cloud.ROW)
    end = 0
    for number, i, b in branches:
        begin, end = end, end + len(b.t)
        (var_x, cov_xy), (_, var_y) = b.covariance.transpose(1, 2, 0)
        row = (number, i, b.probability, b.t, b.X, b.Y, 0.0, var_x, cov_xy, var_y)
        for name, column in zip(point_cloud.COLUMNS, row):
            rows[name][begin:end] = column
    fields = [
        PointField(name=name, offset=point_cloud.ROW.fields[name][1], datatype=kinds[0], count=1)
        for name, kinds in point_cloud.COLUMNS.items()
    ]
    return PointCloud2(
        header=_header('/scenario/predictions', x.stamp_ns),
        height=1,
        width=len(rows),
        fields=fields,
        point_step=rows.itemsize,
        row_step=rows.nbytes,
        data=array('B', rows.tobytes()),
        is_dense=True,
    )


def why(x: types.Why) -> DiagnosticArray:
    """Return /controller/why; raise ValueError for a word that would be read as a number."""
    return _diagnostics('/controller/why', x.stamp_ns, ('controller', x))


def health(x: types.Health, *others: types.Health) -> DiagnosticArray:
    """Return /diagnostics; raise ValueError for a word that would be read as a number."""
    return _diagnostics('/diagnostics', x.stamp_ns, *((each.name, each) for each in (x, *others)))


def clock(stamp_ns: int) -> Clock:
    """Return /clock."""
    return Clock(clock=_time(stamp_ns))


def run_start(stamp_ns: int) -> Time:
    """Return /vehicle/run_start; 0 ns stands for a run that has not begun."""
    return _time(stamp_ns)


def _path(topic, x):
    msg = Path(header=_header(topic, x.stamp_ns))
    for X, Y, psi, t in zip(x.X, x.Y, x.psi, x.t):
        pose = PoseStamped(header=_header(topic, conversions.add_seconds(x.stamp_ns, t)))
        pose.pose.position.x, pose.pose.position.y = float(X), float(Y)
        pose.pose.orientation.z, pose.pose.orientation.w = conversions.heading_to_quaternion(psi)
        msg.poses.append(pose)
    return msg


def _time(stamp_ns):
    sec, nanosec = conversions.split_stamp(stamp_ns)
    return Time(sec=sec, nanosec=nanosec)


def _header(topic, stamp_ns):
    return Header(stamp=_time(stamp_ns), frame_id=contract.load().topics[topic].frame)


def _marker(topic, stamp_ns, ns, number, kind, color):
    header = _header(topic, stamp_ns)
    marker = Marker(header=header, ns=ns, id=number, type=kind, action=Marker.ADD, color=color)
    marker.pose.orientation.w = 1.0
    return marker


def _obstacle_marker(stamp_ns, obstacle, ns, kind):
    topic = '/scenario/obstacles'
    marker = _marker(topic, stamp_ns, ns, obstacle.id, kind, _RED)
    marker.pose.position.x, marker.pose.position.y = float(obstacle.X), float(obstacle.Y)
    marker.pose.position.z = 0.5 * _OBSTACLE_HEIGHT_M
    # viewers drop an obstacle that is gone after four periods
    period_s = 1.0 / contract.load().topics[topic].rate_hz['lockstep']
    fraction, whole = math.modf(4.0 * period_s)
    marker.lifetime = Duration(sec=int(whole), nanosec=round(fraction * conversions.NS_PER_S))
    return marker


def _diagnostics(topic, stamp_ns, *named):
    msg = DiagnosticArray(header=_header(topic, stamp_ns))
    for name, x in named:
        pairs = ((key, conversions.value_to_text(value)) for key, value in x.values.items())
        msg.status.append(
            DiagnosticStatus(
                level=bytes([x.level]),
                name=name,
                message=x.message,
                hardware_id=name,
                values=[KeyValue(key=key, value=text) for key, text in pairs],
            )
        )
    return msg
