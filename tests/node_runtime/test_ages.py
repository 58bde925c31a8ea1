"""The age of an input as a level: when it rises, when it falls, what is counted."""

import pytest

from node_runtime.ages import ERROR, OK, STALE, WARN, Held, Watch

MS = 1_000_000
S = 1_000_000_000


@pytest.fixture
def watch():
    made = Watch('state', limit_s=0.1)
    made.take(S)
    return made


def test_what_has_never_come_is_stale():
    watch = Watch('state', 0.1)
    assert watch.level(S) == watch.held == watch.look(S) == watch.held == STALE
    assert watch.age_ns(S) is None
    assert watch.told(S) == 'state has never come'
    assert watch.values(S) == {
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
def test_beyond_half_of_the_limit_there_is_a_warning_and_beyond_it_an_error(watch, age_ns, level):
    assert watch.level(S + age_ns) == level


def test_a_new_stamp_ends_the_age_at_once_and_an_older_one_changes_nothing(watch):
    assert watch.level(S + 200 * MS) == ERROR
    assert watch.offer(S + 190 * MS, S + 200 * MS) == ''
    assert watch.level(S + 200 * MS) == OK
    watch.take(S + 10 * MS)
    assert watch.age_ns(S + 200 * MS) == 10 * MS
    assert watch.told(S + 200 * MS) == 'state is 10 ms old, limit 100 ms'


@pytest.mark.parametrize(('off_ns', 'where'), [(101 * MS, 'past'), (-101 * MS, 'future')])
def test_a_stamp_far_from_now_is_refused_with_its_reason_and_counted(watch, off_ns, where):
    told = watch.offer(2 * S - off_ns, 2 * S)
    assert told == f'the stamp is 101 ms in the {where}, limit 100 ms'
    assert watch.age_ns(2 * S) == S
    values = watch.values(2 * S)
    assert values['age.state_refused'] == 1
    assert values['age.state_reason'] == told


@pytest.mark.parametrize('off_ns', [100 * MS, -100 * MS])
def test_a_stamp_on_the_limit_is_taken(watch, off_ns):
    assert watch.offer(2 * S - off_ns, 2 * S) == ''
    assert watch.values(2 * S)['age.state_refused'] == 0


def test_a_level_that_is_held_names_what_it_comes_from(watch):
    assert watch.cause(S) == 'state is 0 ms old, limit 100 ms'  # nobody has looked yet
    for age_ms in (60, 110, 130):
        watch.look(S + age_ms * MS)
    assert watch.cause(S + 131 * MS) == 'state is 131 ms old, limit 100 ms'
    watch.take(S + 130 * MS)
    watch.look(S + 130 * MS)
    assert watch.held == ERROR
    watch.look(S + 210 * MS)  # a warning does not hide it
    assert watch.cause(S + 630 * MS) == 'state is 500 ms old, limit 100 ms'
    watch.take(S + 630 * MS)
    assert watch.cause(S + 630 * MS) == 'state was 130 ms old 0.5 s ago, limit 100 ms'
    watch.take(4 * S)
    watch.look(4 * S)
    assert watch.held == OK
    assert watch.cause(4 * S) == 'state is 0 ms old, limit 100 ms'


def test_each_time_that_the_limit_is_passed_counts_once(watch):
    for now_ns in (S + 150 * MS, S + 160 * MS):
        watch.look(now_ns)
    assert watch.values(S + 160 * MS)['age.state_stale'] == 1
    watch.take(S + 170 * MS)
    watch.look(S + 170 * MS)
    watch.look(S + 400 * MS)
    assert watch.values(S + 400 * MS)['age.state_stale'] == 2


def test_the_worst_age_is_that_since_it_was_told_last(watch):
    watch.look(S + 80 * MS)
    watch.take(S + 80 * MS)
    first = watch.values(S + 90 * MS)
    assert (first['age.state_ms'], first['age.state_worst_ms']) == (10.0, 80.0)
    assert watch.values(S + 95 * MS)['age.state_worst_ms'] == 15.0


def test_the_level_that_is_shown_falls_after_two_good_seconds(watch):
    assert watch.look(S + 150 * MS) == watch.held == ERROR
    watch.take(S + 160 * MS)
    assert watch.look(S + 160 * MS) == OK
    assert watch.held == ERROR
    watch.take(3 * S + 149 * MS)
    watch.look(3 * S + 149 * MS)
    assert watch.held == ERROR
    watch.look(3 * S + 150 * MS)
    assert watch.held == OK


def test_a_held_level_rises_at_once_and_falls_step_by_step():
    held = Held()
    shown = [held.take(level, ns) for level, ns in ((OK, 0), (ERROR, 1), (WARN, S), (OK, 2 * S))]
    assert shown == [OK, ERROR, ERROR, ERROR]
    assert held.take(OK, 2 * S + 1) == WARN
    assert held.take(OK, 3 * S) == OK


def test_never_heard_ends_with_the_first_message():
    held = Held()
    assert held.take(STALE, 0) == STALE
    assert held.take(OK, 1) == OK
