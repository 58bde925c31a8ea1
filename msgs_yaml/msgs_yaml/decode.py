"""ROS messages to values, checked against the contract first.

Messages may come from rclpy, rosbags or mcap_ros2: only their attributes are used. Every function
raises DecodeError, which names the field and what is allowed, and is the inverse of the function
of the same name in `encode`.
"""

import struct
from typing import Any

import numpy as np

from msgs_yaml import stamp, words
from msgs_yaml.checked import DecodeError, check, check_form, heading
from msgs_yaml.decode_markers import obstacles, road_edges
from msgs_yaml.types import (
    WHEELS,
    Actuators,
    Command,
    Health,
    Imu,
    Prediction,
    Reference,
    VehicleState,
    Wheels,
    Why,
)

__all__ = [
    'DecodeError',
    'actuators',
    'clock',
    'command',
    'health',
    'imu',
    'obstacles',
    'odometry',
    'prediction',
    'reference',
    'road_edges',
    'stamp_ns_of',
    'wheels',
    'why',
]

_CDR_HEADERS = {b'\x00\x01': '<iI', b'\x00\x00': '>iI'}
_STAMP_AT = 4  # after the encapsulation header


def odometry(msg: Any) -> VehicleState:
    """Return the vehicle state of /vehicle/odometry."""
    check('/vehicle/odometry', msg)
    pose, twist = msg.pose.pose, msg.twist.twist
    return VehicleState(
        stamp_ns=stamp.to_ns(msg.header.stamp),
        X=float(pose.position.x),
        Y=float(pose.position.y),
        psi=heading('/vehicle/odometry', pose.orientation),
        vx=float(twist.linear.x),
        vy=float(twist.linear.y),
        r=float(twist.angular.z),
    )


def imu(msg: Any) -> Imu:
    """Return the accelerations of /vehicle/imu."""
    check('/vehicle/imu', msg)
    a = msg.linear_acceleration
    return Imu(stamp.to_ns(msg.header.stamp), float(a.x), float(a.y), float(msg.angular_velocity.z))


def actuators(msg: Any) -> Actuators:
    """Return the actuators of /vehicle/actuators."""
    check('/vehicle/actuators', msg)
    (delta, *_), (d_delta, *_), (_, Fxf, Fxr, *torque) = _arrays(msg)
    return Actuators(stamp.to_ns(msg.header.stamp), delta, d_delta, Fxf, Fxr, tuple(torque))


def wheels(msg: Any) -> Wheels:
    """Return the wheels of /vehicle/wheels."""
    check('/vehicle/wheels', msg)
    position, velocity, effort = (np.reshape(a, (len(WHEELS), -1)).T for a in _arrays(msg))
    _, _, kappa, alpha = position.tolist()
    omega, *_ = velocity.tolist()
    torque, Fz, Fx, Fy = effort.tolist()
    columns = (omega, torque, Fz, kappa, Fx, alpha, Fy)
    return Wheels(stamp.to_ns(msg.header.stamp), *map(tuple, columns))


def command(msg: Any) -> Command:
    """Return the set-points of /controller/command."""
    check('/controller/command', msg)
    (delta, *_), (d_delta, *_), (_, Fxf, Fxr) = _arrays(msg)
    return Command(stamp.to_ns(msg.header.stamp), delta, d_delta, Fxf, Fxr)


def reference(msg: Any) -> Reference:
    """Return the path of /scenario/reference; pose stamps must increase."""
    stamp_ns, X, Y, psi, t = _path('/scenario/reference', msg)
    if np.any(np.diff(t) <= 0.0):
        i = int(np.argmax(np.diff(t) <= 0.0)) + 1
        raise DecodeError(
            f'/scenario/reference: poses[{i}].header.stamp is {t[i]:.9f} s after the first pose; '
            f'allowed above {t[i - 1]:.9f} s, the pose before it'
        )
    return Reference(stamp_ns, X, Y, np.unwrap(psi), t - t[0])


def prediction(msg: Any) -> Prediction:
    """Return the plan of /controller/prediction."""
    stamp_ns, X, Y, psi, t = _path('/controller/prediction', msg)
    return Prediction(stamp_ns, X, Y, np.unwrap(psi), t)


def why(msg: Any) -> Why:
    """Return the reasons of /controller/why."""
    status = _status('/controller/why', msg)
    return Why(stamp.to_ns(msg.header.stamp), _level(status), status.message, _values(status))


def health(msg: Any) -> Health:
    """Return the health of one node from /diagnostics."""
    status = _status('/diagnostics', msg)
    stamp_ns = stamp.to_ns(msg.header.stamp)
    return Health(stamp_ns, status.name, _level(status), status.message, _values(status))


def clock(msg: Any) -> int:
    """Return the time of /clock in nanoseconds; 0, which says that there is no time, is refused."""
    check('/clock', msg)
    now_ns = stamp.to_ns(msg.clock)
    if not now_ns:
        raise DecodeError('/clock: clock (t) is 0 s: no time yet; allowed above 0 s')
    return now_ns


def stamp_ns_of(raw: bytes) -> int:
    """Return the header stamp of a serialised message whose first field is a Header."""
    form = _CDR_HEADERS.get(bytes(raw[:2]))
    if form is None or len(raw) < _STAMP_AT + struct.calcsize(form):
        raise DecodeError(f'no CDR message with a header: {bytes(raw[:16])!r}')
    sec, nanosec = struct.unpack_from(form, raw, _STAMP_AT)
    return sec * stamp.NS_PER_S + nanosec


def _arrays(msg):
    return tuple(list(map(float, a)) for a in (msg.position, msg.velocity, msg.effort))


def _path(topic, msg):
    """Return stamp, X, Y, psi, t; t in s after the stamp of the message."""
    check(topic, msg)
    stamp_ns = stamp.to_ns(msg.header.stamp)
    rows = [
        (
            float(p.pose.position.x),
            float(p.pose.position.y),
            heading(topic, p.pose.orientation),
            stamp.seconds(stamp.to_ns(p.header.stamp) - stamp_ns),
        )
        for p in msg.poses
    ]
    return stamp_ns, *np.array(rows).T.copy()


def _status(topic, msg):
    """Return the one status; its numbers may be absurd: a failed tick must stay readable."""
    check_form(topic, msg)
    (status,) = msg.status
    return status


def _level(status):
    """Return the level as a number: rclpy holds a byte, others an integer."""
    level = status.level
    return level[0] if isinstance(level, bytes) else int(level)


def _values(status):
    return {pair.key: words.read(pair.value) for pair in status.values}
