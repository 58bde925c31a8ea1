"""QoS profiles of rclpy from the words of the contract."""

from rclpy.duration import Duration
from rclpy.qos import (
    DurabilityPolicy,
    HistoryPolicy,
    LivelinessPolicy,
    QoSProfile,
    ReliabilityPolicy,
)

from msgs_yaml.contract import Qos


def profile(qos: Qos) -> QoSProfile:
    """Return the rclpy profile of a profile of the contract."""
    made = QoSProfile(
        reliability=ReliabilityPolicy[qos.reliability.upper()],
        durability=DurabilityPolicy[qos.durability.upper()],
        history=HistoryPolicy[qos.history.upper()],
        depth=qos.depth,
        liveliness=LivelinessPolicy.AUTOMATIC,
    )
    if qos.deadline_ms is not None:
        made.deadline = Duration(nanoseconds=round(qos.deadline_ms * 1e6))
    return made
