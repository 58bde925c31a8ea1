"""The numbers of a run as columns: one row per message, names with units, SI, ISO 8855 axes.

Every table begins with `stamp_ns` (int64, ROS time) and `t_s` (float64, seconds since the zero of
the run: its first odometry). Columns have shape (n,), those of the wheels (n, 4) in the order
front-left, front-right, rear-left, rear-right. Positions and yaw are in the frame map, velocities
and accelerations in base_link at the centre of gravity, tyre forces in the tyre frame.
"""

from typing import Any, NamedTuple

import numpy as np

WHEELS = ('fl', 'fr', 'rl', 'rr')


class Odometry(NamedTuple):
    """/vehicle/odometry; yaw in (-pi, pi]."""

    stamp_ns: np.ndarray
    t_s: np.ndarray
    x_m: np.ndarray
    y_m: np.ndarray
    yaw_rad: np.ndarray
    vx_mps: np.ndarray
    vy_mps: np.ndarray
    yaw_rate_radps: np.ndarray


class Actuators(NamedTuple):
    """/vehicle/actuators; axle forces at the contact patch, braking negative."""

    stamp_ns: np.ndarray
    t_s: np.ndarray
    steer_rad: np.ndarray
    steer_rate_radps: np.ndarray
    front_x_n: np.ndarray
    rear_x_n: np.ndarray
    torque_nm: np.ndarray


class Imu(NamedTuple):
    """/vehicle/imu, without gravity."""

    stamp_ns: np.ndarray
    t_s: np.ndarray
    ax_mps2: np.ndarray
    ay_mps2: np.ndarray
    yaw_rate_radps: np.ndarray


class Wheels(NamedTuple):
    """/vehicle/wheels."""

    stamp_ns: np.ndarray
    t_s: np.ndarray
    spin_radps: np.ndarray
    torque_nm: np.ndarray
    load_n: np.ndarray
    slip: np.ndarray
    force_x_n: np.ndarray
    slip_angle_rad: np.ndarray
    force_y_n: np.ndarray


class Command(NamedTuple):
    """/controller/command: set-points due 50 ms after the stamp."""

    stamp_ns: np.ndarray
    t_s: np.ndarray
    steer_rad: np.ndarray
    steer_rate_radps: np.ndarray
    front_x_n: np.ndarray
    rear_x_n: np.ndarray


class Values(NamedTuple):
    """Any other topic: the values of `msgs_yaml.types`, one per message."""

    stamp_ns: np.ndarray
    t_s: np.ndarray
    values: tuple[Any, ...]


Columns = Odometry | Actuators | Imu | Wheels | Command | Values


class Source(NamedTuple):
    """Where the columns of a table lie in the message.

    A path as in 'pose.pose.position.x'; 'effort[rear_axle]' is the element of a JointState at the
    place of that name; four paths make a column of four.
    """

    table: type
    stamp: str
    paths: dict[str, str | tuple[str, ...]]


def _each_wheel(form):
    return tuple(form.format(wheel) for wheel in WHEELS)


_AXLES = {
    'steer_rad': 'position[steer]',
    'steer_rate_radps': 'velocity[steer]',
    'front_x_n': 'effort[front_axle]',
    'rear_x_n': 'effort[rear_axle]',
}
SOURCES = {
    '/vehicle/odometry': Source(
        Odometry,
        'header.stamp',
        {
            'x_m': 'pose.pose.position.x',
            'y_m': 'pose.pose.position.y',
            # a turn about z: the quaternion is (0, 0, sin(yaw / 2), cos(yaw / 2))
            'yaw_rad': ('pose.pose.orientation.z', 'pose.pose.orientation.w'),
            'vx_mps': 'twist.twist.linear.x',
            'vy_mps': 'twist.twist.linear.y',
            'yaw_rate_radps': 'twist.twist.angular.z',
        },
    ),
    '/vehicle/actuators': Source(
        Actuators, 'header.stamp', {**_AXLES, 'torque_nm': _each_wheel('effort[{}_wheel]')}
    ),
    '/vehicle/imu': Source(
        Imu,
        'header.stamp',
        {
            'ax_mps2': 'linear_acceleration.x',
            'ay_mps2': 'linear_acceleration.y',
            'yaw_rate_radps': 'angular_velocity.z',
        },
    ),
    '/vehicle/wheels': Source(
        Wheels,
        'header.stamp',
        {
            'spin_radps': _each_wheel('velocity[{}_spin]'),
            'torque_nm': _each_wheel('effort[{}_spin]'),
            'load_n': _each_wheel('effort[{}_vertical]'),
            'slip': _each_wheel('position[{}_longitudinal]'),
            'force_x_n': _each_wheel('effort[{}_longitudinal]'),
            'slip_angle_rad': _each_wheel('position[{}_lateral]'),
            'force_y_n': _each_wheel('effort[{}_lateral]'),
        },
    ),
    '/controller/command': Source(Command, 'header.stamp', _AXLES),
}
