"""Rejected messages are logged once per kind, then counted; repeated lines are dropped."""

from node_runtime.log_filters import PERIOD_NS, ChangeFilter, RejectionLog

TOPIC = '/controller/command'


def test_the_first_of_each_kind_is_logged_and_later_ones_are_counted_at_a_limited_rate():
    rejected = RejectionLog(TOPIC)
    first = rejected.line('unreadable', 'name is wheel', 0)
    assert first == f'{TOPIC} rejected (unreadable): name is wheel'
    lines = [rejected.line('too_old', f'age {k}', k * PERIOD_NS // 50) for k in range(200)]
    assert [k for k, line in enumerate(lines) if line] == [0, 50, 100, 150]
    assert lines[0] == f'{TOPIC} rejected (too_old): age 0'
    counts = '51 too_old, 1 unreadable; the last: age 50'
    assert lines[50] == f'{TOPIC} rejected so far: {counts}'


def test_a_line_passes_once_per_change():
    changes = ChangeFilter()
    passed = [line for line in ('', 'a', 'a', 'b', 'a', '', '') if changes.has_changed(line)]
    assert passed == ['a', 'b', 'a', '']
