"""The numbers of a run as columns: one row per message, names with units, SI, ISO 8855 axes.

Every table begins with `stamp_ns` (int64, ROS time) and `t_s` (float64, seconds since the zero of
the run: its first odometry). Columns have shape (n,), those of the wheels (n, 4) in the order
front-left, front-right, rear-left, rear-right. Positions and yaw, in (-pi, pi], are in the frame
map, velocities and accelerations in base_link at the centre of gravity, tyre forces in the tyre
frame. The columns of a topic are those of topics.yaml (`msgs_yaml.flat_fields`):

    Odometry    x_m, y_m, yaw_rad, vx_mps, vy_mps, yaw_rate_radps
    Actuators   steer_rad, steer_rate_radps, front_x_n, rear_x_n, torque_nm (per wheel)
    Imu         ax_mps2, ay_mps2, yaw_rate_radps, roll_rate_radps
    Wheels      spin_radps, torque_nm, load_n, slip, force_x_n, slip_angle_rad, force_y_n
    Command     steer_rad, steer_rate_radps, front_x_n, rear_x_n
"""

from collections import namedtuple
from typing import Any, NamedTuple

import numpy as np

from msgs_yaml import flat_fields

STAMP = 'header.stamp'


class Source(NamedTuple):
    """Where the columns of a table are in the message.

    A path such as 'pose.pose.position.x'; 'effort[rear_axle]' is the element of a JointState at the
    index of that name; four paths make a column of four, those of z and w of a quaternion the yaw.
    """

    table: type
    stamp: str
    paths: dict[str, str | tuple[str, ...]]


def _table(name: str, topic: str) -> type:
    """Return the named tuple with the columns of a topic."""
    columns = ('stamp_ns', 't_s', *flat_fields.load(topic).columns)
    members = {'__doc__': f'{topic}: {", ".join(columns)}.', '__slots__': (), '__repr__': _repr}
    return type(name, (namedtuple(name, columns),), members | {'__module__': __name__})


def _repr(table) -> str:
    return f'{type(table).__name__}({len(table.stamp_ns)} rows: {", ".join(table._fields)})'


Odometry = _table('Odometry', '/vehicle/odometry')
Actuators = _table('Actuators', '/vehicle/actuators')
Imu = _table('Imu', '/vehicle/imu')
Wheels = _table('Wheels', '/vehicle/wheels')
Command = _table('Command', '/controller/command')


class Values(NamedTuple):
    """Any other topic: the values of `msgs_yaml.types`, one per message."""

    stamp_ns: np.ndarray
    t_s: np.ndarray
    values: tuple[Any, ...]

    __repr__ = _repr


Columns = Odometry | Actuators | Imu | Wheels | Command | Values
_TABLES = {
    '/vehicle/odometry': Odometry,
    '/vehicle/actuators': Actuators,
    '/vehicle/imu': Imu,
    '/vehicle/wheels': Wheels,
    '/controller/command': Command,
}
SOURCES = {
    topic: Source(
        table,
        STAMP,
        {
            column: paths if len(paths) > 1 else paths[0]
            for column, paths in flat_fields.load(topic).columns.items()
        },
    )
    for topic, table in _TABLES.items()
}
