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


def watching(offered: Qos) -> QoSProfile:
    """Return the profile of who looks on: takes what it can get, and slows nobody.

    It matches whatever is offered; of a topic that is not latched it may lose messages.
    """
    latched = offered.durability == 'transient_local'
    return QoSProfile(
        reliability=ReliabilityPolicy.RELIABLE if latched else ReliabilityPolicy.BEST_EFFORT,
        durability=DurabilityPolicy[offered.durability.upper()],
        history=HistoryPolicy.KEEP_LAST,
        depth=1,
    )
