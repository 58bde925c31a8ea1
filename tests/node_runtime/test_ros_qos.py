"""QoS profiles of the contract become profiles of rclpy."""

import pytest
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


def test_every_policy_is_converted():
    profile = ros.to_qos_profile(contract.Qos('reliable', 'transient_local', 'keep_last', 3, 100.0))
    assert profile.reliability == ReliabilityPolicy.RELIABLE
    assert profile.durability == DurabilityPolicy.TRANSIENT_LOCAL
    assert (profile.history, profile.depth) == (HistoryPolicy.KEEP_LAST, 3)
    assert profile.deadline == Duration(nanoseconds=100_000_000)


def test_keep_all_needs_no_depth():
    profile = ros.to_qos_profile(contract.Qos('best_effort', 'volatile', 'keep_all', 0, None))
    assert profile.reliability == ReliabilityPolicy.BEST_EFFORT
    assert profile.durability == DurabilityPolicy.VOLATILE
    assert profile.history == HistoryPolicy.KEEP_ALL
    assert profile.deadline.nanoseconds in (0, Duration().nanoseconds, 2**63 - 1)


@pytest.mark.parametrize('mode', contract.MODES)
@pytest.mark.parametrize('topic', contract.load().topics.values(), ids=lambda topic: topic.name)
def test_an_observer_of_either_mode_receives_what_is_published(topic, mode):
    published = ros.to_qos_profile(topic.qos[mode])
    observer = ros.observer_profile(topic, mode)
    compatibility, reason = qos_check_compatible(published, observer)
    assert compatibility != QoSCompatibility.ERROR, reason


def test_publisher_and_subscriber_of_one_topic_and_mode_match():
    for topic in contract.load().topics.values():
        for mode in contract.MODES:
            offered = ros.to_qos_profile(topic.qos[mode])
            requested = ros.to_qos_profile(topic.requested_qos(mode))
            compatibility, reason = qos_check_compatible(offered, requested)
            assert compatibility == QoSCompatibility.OK, f'{topic.name} {mode}: {reason}'
