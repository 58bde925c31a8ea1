"""The words of the contract are the profiles of rclpy."""

from rclpy.duration import Duration
from rclpy.qos import (
    DurabilityPolicy,
    HistoryPolicy,
    QoSCompatibility,
    ReliabilityPolicy,
    qos_check_compatible,
)

from msgs_yaml import contract
from node_runtime import ros


def test_every_word_becomes_its_policy():
    made = ros.to_qos_profile(
        contract.Qos('x', 'reliable', 'transient_local', 'keep_last', 3, 100.0)
    )
    assert made.reliability == ReliabilityPolicy.RELIABLE
    assert made.durability == DurabilityPolicy.TRANSIENT_LOCAL
    assert (made.history, made.depth) == (HistoryPolicy.KEEP_LAST, 3)
    assert made.deadline == Duration(nanoseconds=100_000_000)


def test_keep_all_needs_no_depth():
    made = ros.to_qos_profile(contract.Qos('x', 'best_effort', 'volatile', 'keep_all', 0, None))
    assert made.reliability == ReliabilityPolicy.BEST_EFFORT
    assert made.durability == DurabilityPolicy.VOLATILE
    assert made.history == HistoryPolicy.KEEP_ALL
    assert made.deadline.nanoseconds in (0, Duration().nanoseconds, 2**63 - 1)


def test_publisher_and_subscriber_of_one_topic_and_mode_match():
    for topic in contract.load().topics.values():
        for mode in contract.MODES:
            profile = ros.to_qos_profile(topic.qos[mode])
            compatibility, reason = qos_check_compatible(profile, profile)
            assert compatibility == QoSCompatibility.OK, f'{topic.name} {mode}: {reason}'
