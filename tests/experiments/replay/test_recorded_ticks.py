"""The ticks of a recording: lost, torn and foreign messages, in lockstep and in realtime."""

import math

import numpy as np
import pytest

from bags.errors import BagError
from experiments.replay.recorded_ticks import (
    COMMAND,
    EDGES,
    OBSTACLES,
    REFERENCE,
    STATE,
    WHY,
    RecordedTopic,
    has_same_content,
    read_ticks,
)
from msgs_yaml import encode
from node_runtime import ros

from .conftest import in_mode, with_columns


def without(bag, topic, row):
    """Return a bag that lost one message."""
    one = bag.recordings[topic]
    columns = {name: np.delete(getattr(one, name), row) for name in one._fields[1:4]}
    payloads = [payload for i, payload in enumerate(one.payloads) if i != row]
    return with_columns(bag, topic, **columns, payloads=payloads)


@pytest.mark.parametrize('topic', [STATE, OBSTACLES])
def test_in_lockstep_a_lost_input_is_an_error_that_names_it(mpcc, topic):
    with pytest.raises(BagError, match=f'{topic} has no message of stamp'):
        read_ticks(without(mpcc, topic, 40))


@pytest.mark.parametrize('topic', [WHY, COMMAND, REFERENCE, EDGES, OBSTACLES, STATE])
def test_a_torn_message_of_another_publisher_does_not_end_a_replay(mpcc, topic):
    one = mpcc.recordings[topic]
    middle = len(one.payloads) // 2
    columns = {name: getattr(one, name) for name in one._fields[1:4]}
    columns = {n: np.insert(column, middle, column[middle]) for n, column in columns.items()}
    payloads = [*one.payloads[:middle], one.payloads[middle][:20], *one.payloads[middle:]]
    torn = with_columns(mpcc, topic, **columns, payloads=payloads)
    expected, found = read_ticks(mpcc, 120), read_ticks(torn, 120)
    for name in ('stamp_ns', 'gaps', 'command'):
        assert [getattr(one, name) for one in found] == [getattr(one, name) for one in expected]
    assert all(
        has_same_content(a.inputs.reference, b.inputs.reference) for a, b in zip(found, expected)
    )
    assert [one.inputs.state for one in found] == [one.inputs.state for one in expected]


def with_report(bag, row, **values):
    """Return a bag in which one report says something else under some keys."""
    report = RecordedTopic(bag, WHY).value(row)
    payloads = [*bag.recordings[WHY].payloads]
    payloads[row] = ros.serialize(encode.why(report._replace(values=report.values | values)))
    return with_columns(bag, WHY, payloads=payloads)


@pytest.mark.parametrize('mode', ['lockstep', 'realtime'])
@pytest.mark.parametrize('time', ['n/a', math.nan, math.inf, -math.inf, 1e300, -1e12, 1e12])
def test_an_impossible_duration_counts_as_zero(mpcc, mode, time):
    bag = in_mode(mpcc, mode)
    times = dict.fromkeys(('time.lead_ms', 'time.prepare_ms', 'time.solve_ms'), time)
    found = read_ticks(with_report(bag, 20, **times), 22)
    assert len(found) == 22
    assert found[20].inputs.acts_ns == found[20].stamp_ns
    assert found[20].inputs.state == read_ticks(bag, 22)[20].inputs.state


@pytest.mark.parametrize('reason', [12, 0.5, True])
def test_a_report_whose_reason_is_no_text_belongs_to_no_tick(mpcc, reason):
    bag = in_mode(mpcc, 'realtime')
    found, expected = read_ticks(with_report(bag, 20, reason=reason), 40), read_ticks(bag, 41)
    assert [one.why for one in found] == [one.why for one in (*expected[:20], *expected[21:])]


def test_two_drives_in_one_bag_are_refused(mpcc, golden):
    one, other = (bag.recordings[STATE] for bag in (mpcc, golden('frenet')))
    names = one._fields[1:]
    columns = {n: np.concatenate([getattr(one, n), getattr(other, n)]) for n in names[:3]}
    both = with_columns(mpcc, STATE, **columns, payloads=one.payloads + other.payloads)
    with pytest.raises(BagError, match='the bag holds two drives'):
        read_ticks(both)


@pytest.mark.parametrize(
    ('topic', 'tick', 'gap'),
    [
        (STATE, 40, 'its state was lost'),
        (WHY, 40, 'a tick without a message of /controller/why'),
        (COMMAND, 40, 'its command was lost'),
        (OBSTACLES, 0, 'what it knew of /scenario/obstacles was not recorded'),
    ],
)
def test_in_realtime_a_lost_message_is_a_gap_in_the_replay(mpcc, topic, tick, gap):
    row = RecordedTopic(mpcc, topic).row_of[read_ticks(mpcc)[tick].stamp_ns]
    found = read_ticks(in_mode(without(mpcc, topic, row), 'realtime'))
    assert [one.number for one in found if one.gaps] == [tick]
    assert found[tick].gaps == (gap,)


def test_a_controller_that_was_started_again_begins_at_the_actuators(mpcc):
    sequence = mpcc.recordings[WHY].sequence.copy()
    sequence[60:] -= sequence[59]
    found = read_ticks(with_columns(mpcc, WHY, sequence=sequence))
    assert [one.number for one in found if one.inputs.actuators] == [0, 60]
    assert found[60].inputs.actuators.stamp_ns == found[60].stamp_ns


def test_after_braking_without_a_state_a_controller_begins_at_the_actuators(mpcc, monkeypatch):
    value = RecordedTopic.value

    def blind(topic, row):
        found = value(topic, row)
        if topic.topic.name == WHY and row in (20, 21):
            return found._replace(values={'reason': 'state_stale', 'rung': 'braking'})
        return found

    monkeypatch.setattr(RecordedTopic, 'value', blind)
    inputs = [one.inputs for one in read_ticks(in_mode(mpcc, 'realtime'), 40)]
    assert [k for k, one in enumerate(inputs) if one.state is None] == [20, 21]
    assert [k for k, one in enumerate(inputs) if one.fault] == [20, 21]
    assert [k for k, one in enumerate(inputs) if one.actuators] == [0, 22]
