"""Values as a receiver reads them: what passing through a message changes, and nothing else.

A heading passes through a quaternion and a time through whole nanoseconds. With these functions a
ring closed in one process computes with the same bits as one closed over ROS. All other numbers
pass unchanged.
"""

import numpy as np

from msgs_yaml import stamp, yaw
from msgs_yaml.types import Prediction, Reference, VehicleState


def odometry(x: VehicleState) -> VehicleState:
    """Return decode.odometry(encode.odometry(x))."""
    return x._replace(psi=yaw.as_received(x.psi))


def reference(x: Reference) -> Reference:
    """Return decode.reference(encode.reference(x))."""
    return x._replace(psi=_headings(x.psi), t=_times(x.stamp_ns, x.t))


def prediction(x: Prediction) -> Prediction:
    """Return decode.prediction(encode.prediction(x))."""
    return x._replace(psi=_headings(x.psi), t=_times(x.stamp_ns, x.t))


def _headings(psi):
    return np.unwrap([yaw.as_received(float(p)) for p in psi])


def _times(stamp_ns, t):
    return np.array([stamp.seconds(stamp.later(stamp_ns, t_i) - stamp_ns) for t_i in t])
