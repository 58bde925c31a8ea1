"""What the recorder tells of itself."""

from bags.storage.message_loss import LossCounter, RecordingHealth
from msgs_yaml import contract
from node_runtime.input_monitor import HOLD_NS, OK, STALE, WARN

MODE = 'realtime'
STATE, MARKERS = '/vehicle/odometry', '/markers/vehicle'
NOW_NS = 10**18


def counted(sequences):
    return {
        name: LossCounter().add_all(sequences.get(name, ())).losses
        for name in contract.load().topics
    }


def test_recorder_that_hears_nothing_says_so():
    result = RecordingHealth(MODE).health(NOW_NS, counted({}))
    assert (result.name, result.level) == ('recorder', STALE)
    assert result.values['messages'] == 0


def test_topics_that_are_silent_are_named_but_not_those_published_on_request_only():
    result = RecordingHealth(MODE).health(NOW_NS, counted({STATE: (1, 2, 3)}))
    assert result.level == OK
    assert result.values['messages'] == 3
    silent = result.values['silent'].split()
    assert '/controller/why' in silent
    assert STATE not in silent
    assert MARKERS not in silent


def test_every_topic_heard_leaves_none_silent():
    result = RecordingHealth(MODE).health(
        NOW_NS, counted(dict.fromkeys(contract.load().topics, (1,)))
    )
    assert result.values['silent'] == 'none'


def test_a_loss_is_a_warning_until_nothing_was_lost_for_a_while():
    monitor, lossy = RecordingHealth(MODE), counted({STATE: (1, 2, 5)})
    first = monitor.health(NOW_NS, lossy)
    assert (first.level, first.values['lost']) == (WARN, 2)
    assert monitor.health(NOW_NS + HOLD_NS - 1, lossy).level == WARN
    assert monitor.health(NOW_NS + HOLD_NS, lossy).level == OK
