"""Serialised messages made by patching a template: stamp and float64 runs, nothing else.

Building and serialising a message object costs tens of microseconds, patching its bytes two; the
plant sends two thousand messages per simulated second. No ROS is needed.
"""

import struct
from collections.abc import Callable
from typing import Any, NamedTuple

from msgs_yaml import blocks, cdr, contract, stamp
from msgs_yaml.contract import Topic

_NO_ORIENTATION = (-1.0, *(0.0,) * 8)  # sensor_msgs/Imu: covariance of what is not measured
_COVARIANCE_3D = (0.0,) * 9
_COVARIANCE_6D = (0.0,) * 36
_IDENTITY = (0.0, 0.0, 0.0, 1.0)
_VECTOR = (0.0,) * 3
_POSE = (0.0,) * 7
_TWIST = (0.0,) * 6


class Layout(NamedTuple):
    """A serialised message and where in it the numbers of its value lie."""

    buffer: bytearray
    offsets: tuple[int, ...]


class Template:
    """A serialised message whose stamp and numbers can be replaced."""

    def __init__(self, topic: str):
        """Take a topic of `FORMS`; KeyError for others."""
        self._blocks, layout = FORMS[topic]
        self._buffer, self._offsets = layout(contract.load().topics[topic])

    def fill(self, value: Any) -> bytes:
        """Return the serialised message of a value of `types`."""
        buffer = self._buffer
        cdr.STAMP.pack_into(buffer, cdr.STAMP_AT, *stamp.split(value.stamp_ns))
        for offset, run in zip(self._offsets, self._blocks(value)):
            struct.pack_into(f'<{len(run)}d', buffer, offset, *run)
        return bytes(buffer)


def _odometry(topic: Topic) -> Layout:
    writer = cdr.Writer()
    writer.header(topic.frame)
    writer.text(topic.child_frame)
    pose = writer.floats(_POSE)
    writer.floats(_COVARIANCE_6D)
    twist = writer.floats(_TWIST)
    writer.floats(_COVARIANCE_6D)
    return Layout(writer.buffer, (pose, twist))


def _imu(topic: Topic) -> Layout:
    writer = cdr.Writer()
    writer.header(topic.frame)
    writer.floats(_IDENTITY)
    writer.floats(_NO_ORIENTATION)
    rate = writer.floats(_VECTOR)
    writer.floats(_COVARIANCE_3D)
    acceleration = writer.floats(_VECTOR)
    writer.floats(_COVARIANCE_3D)
    return Layout(writer.buffer, (rate, acceleration))


def _joint_state(topic: Topic) -> Layout:
    writer = cdr.Writer()
    writer.header(topic.frame)
    writer.count(len(topic.joints))
    for name in topic.joints:
        writer.text(name)
    offsets = []
    for _ in ('position', 'velocity', 'effort'):
        writer.count(len(topic.joints))
        offsets.append(writer.floats((0.0,) * len(topic.joints)))
    return Layout(writer.buffer, tuple(offsets))


# value to runs of numbers, topic to layout
FORMS: dict[str, tuple[Callable, Callable[[Topic], Layout]]] = {
    '/vehicle/odometry': (blocks.odometry, _odometry),
    '/vehicle/imu': (blocks.imu, _imu),
    '/vehicle/actuators': (blocks.actuators, _joint_state),
    '/vehicle/wheels': (blocks.wheels, _joint_state),
    '/controller/command': (blocks.command, _joint_state),
}
