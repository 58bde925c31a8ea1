"""Rejected messages are logged once per kind, then counted; repeated lines are dropped."""

from node_runtime.log_filters import PERIOD_NS, ChangeFilter, RejectionLog

TOPIC = '/controller/command'


def test_the_first_of_each_kind_is_logged_with_its_reason():
    refusals = RejectionLog(TOPIC)
    first = refusals.line('unreadable', 'name is wheel', 1)
    assert first == f'{TOPIC} rejected (unreadable): name is wheel'
    assert refusals.line('unreadable', 'name is wheel', 2) == ''
    assert refusals.line('too_old', '1 s old', 3) == f'{TOPIC} rejected (too_old): 1 s old'


def test_later_ones_are_counted_at_a_limited_rate():
    refusals = RejectionLog(TOPIC)
    lines = [refusals.line('too_old', f'age {k}', k * PERIOD_NS // 50) for k in range(200)]
    assert [k for k, line in enumerate(lines) if line] == [0, 50, 100, 150]
    assert lines[50] == f'{TOPIC} rejected so far: 51 too_old; the last: age 50'


def test_counts_name_every_kind():
    refusals = RejectionLog(TOPIC)
    refusals.line('too_old', 'a', 0)
    refusals.line('unreadable', 'b', 0)
    counted = refusals.line('unreadable', 'c', PERIOD_NS)
    assert counted == f'{TOPIC} rejected so far: 1 too_old, 2 unreadable; the last: c'


def test_a_line_passes_once_per_change():
    changes = ChangeFilter()
    passed = [line for line in ('', 'a', 'a', 'b', 'a', '', '') if changes.has_changed(line)]
    assert passed == ['a', 'b', 'a', '']
