"""The age of an input as a level: when it rises, when it falls, what is counted."""

import pytest

from node_runtime.input_monitor import ERROR, OK, STALE, WARN, HeldLevel, InputMonitor

MS = 1_000_000
S = 1_000_000_000


@pytest.fixture
def monitor():
    monitor = InputMonitor('state', limit_s=0.1)
    monitor.record(S)
    return monitor


def test_an_input_without_a_message_is_stale():
    monitor = InputMonitor('state', 0.1)
    assert (
        monitor.level(S) == monitor.held_level == monitor.update(S) == monitor.held_level == STALE
    )
    assert monitor.age_ns(S) is None
    assert monitor.describe(S) == 'state was never received'
    assert monitor.diagnostics(S) == {
        'age.state_limit_ms': 100.0,
        'age.state_stale': 0,
        'age.state_refused': 0,
        'age.state_reason': 'none',
    }


@pytest.mark.parametrize(
    ('age_ns', 'level'),
    [
        (-30 * MS, OK),
        (0, OK),
        (50 * MS, OK),
        (50 * MS + 1, WARN),
        (100 * MS, WARN),
        (100 * MS + 1, ERROR),
        (9 * S, ERROR),
    ],
)
def test_beyond_half_of_the_limit_there_is_a_warning_and_beyond_it_an_error(monitor, age_ns, level):
    assert monitor.level(S + age_ns) == level


def test_a_new_stamp_ends_the_age_at_once_and_an_older_one_changes_nothing(monitor):
    assert monitor.level(S + 200 * MS) == ERROR
    assert monitor.accept(S + 190 * MS, S + 200 * MS) == ''
    assert monitor.level(S + 200 * MS) == OK
    monitor.record(S + 10 * MS)
    assert monitor.age_ns(S + 200 * MS) == 10 * MS
    assert monitor.describe(S + 200 * MS) == 'state is 10 ms old, limit 100 ms'


@pytest.mark.parametrize('sign', [1, -1])
def test_a_stamp_further_from_now_than_the_limit_is_rejected_with_its_reason(monitor, sign):
    reason = monitor.accept(2 * S - sign * 101 * MS, 2 * S)
    where = 'past' if sign > 0 else 'future'
    assert reason == f'the stamp is 101 ms in the {where}, limit 100 ms'
    assert monitor.age_ns(2 * S) == S
    values = monitor.diagnostics(2 * S)
    assert (values['age.state_refused'], values['age.state_reason']) == (1, reason)
    assert monitor.accept(2 * S - sign * 100 * MS, 2 * S) == ''
    assert monitor.diagnostics(2 * S)['age.state_refused'] == 1


def test_a_held_level_names_its_cause(monitor):
    assert monitor.describe(S) == 'state is 0 ms old, limit 100 ms'  # nobody has looked yet
    for age_ms in (60, 110, 130):
        monitor.update(S + age_ms * MS)
    assert monitor.describe(S + 131 * MS) == 'state is 131 ms old, limit 100 ms'
    monitor.record(S + 130 * MS)
    monitor.update(S + 130 * MS)
    assert monitor.held_level == ERROR
    monitor.update(S + 210 * MS)  # a warning does not hide it
    assert monitor.describe(S + 630 * MS) == 'state is 500 ms old, limit 100 ms'
    monitor.record(S + 630 * MS)
    assert monitor.describe(S + 630 * MS) == 'state was 130 ms old 0.5 s ago, limit 100 ms'
    monitor.record(4 * S)
    monitor.update(4 * S)
    assert monitor.held_level == OK
    assert monitor.describe(4 * S) == 'state is 0 ms old, limit 100 ms'


def test_each_timeout_counts_once(monitor):
    for now_ns in (S + 150 * MS, S + 160 * MS):
        monitor.update(now_ns)
    assert monitor.diagnostics(S + 160 * MS)['age.state_stale'] == 1
    monitor.record(S + 170 * MS)
    monitor.update(S + 170 * MS)
    monitor.update(S + 400 * MS)
    assert monitor.diagnostics(S + 400 * MS)['age.state_stale'] == 2


def test_the_worst_age_is_that_since_the_last_report(monitor):
    monitor.update(S + 80 * MS)
    monitor.record(S + 80 * MS)
    first = monitor.diagnostics(S + 90 * MS)
    assert (first['age.state_ms'], first['age.state_worst_ms']) == (10.0, 80.0)
    assert monitor.diagnostics(S + 95 * MS)['age.state_worst_ms'] == 15.0


def test_a_held_level_rises_at_once_and_falls_step_by_step_two_seconds_after_its_cause():
    held = HeldLevel()
    seen = [(STALE, 0), (OK, 0), (ERROR, 1), (WARN, S), (OK, 2 * S), (OK, 2 * S + 1), (OK, 3 * S)]
    seen += [(WARN, 9 * S), (OK, 0)]  # of another run
    shown = [held.update(level, now_ns) for level, now_ns in seen]
    assert shown == [STALE, OK, ERROR, ERROR, ERROR, WARN, OK, WARN, OK]
