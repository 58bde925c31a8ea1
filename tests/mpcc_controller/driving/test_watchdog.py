"""The effect of stale inputs: a reason to brake, and the health report."""

import pytest

from mpcc_controller.driving import watchdog
from mpcc_controller.driving.tick_report import OK, WARN
from mpcc_controller.driving.watchdog import (
    EDGES,
    MESSAGES,
    OBSTACLES,
    REFERENCE,
    STATE,
    HealthMonitor,
)
from mpcc_controller.parameters import Ages
from msgs_yaml.types import Why
from node_runtime.input_monitor import ERROR, STALE

MS, S = 1_000_000, 1_000_000_000
AGES = Ages(state_s=0.1, reference_s=1.0, obstacles_s=0.2)
INPUTS = (STATE, REFERENCE, EDGES, OBSTACLES)


def why(stamp_ns, level=OK):
    return Why(stamp_ns, level, '', {'rung': 'solved', 'gate.rejections': 3})


@pytest.fixture
def realtime():
    new_watchdog = watchdog.make('realtime', HealthMonitor('controller'), AGES)
    for name in INPUTS:
        assert new_watchdog.offer(name, S, S) == ''
    return new_watchdog


def refresh(monitored, now_ns, *but):
    for name in INPUTS:
        if name not in but:
            monitored.offer(name, now_ns, now_ns)


@pytest.mark.parametrize(
    ('name', 'limit_ns'),
    [(STATE, 100 * MS), (REFERENCE, S), (EDGES, S), (OBSTACLES, 200 * MS)],
)
def test_each_input_has_its_limit_and_its_reason(realtime, name, limit_ns):
    refresh(realtime, S + limit_ns, name)
    assert realtime.fault(S + limit_ns) == ''
    refresh(realtime, S + limit_ns + 1, name)
    assert realtime.fault(S + limit_ns + 1) == f'{name}_stale'
    assert realtime.is_state_lost(S + limit_ns + 1) == (name == STATE)
    assert realtime.describe(S + limit_ns + 1).startswith(f'{name} is {limit_ns // MS} ms old')
    refresh(realtime, S + limit_ns + 2)
    assert realtime.fault(S + limit_ns + 2) == realtime.describe(S + limit_ns + 2) == ''


def test_the_state_is_named_first_when_several_inputs_are_stale(realtime):
    assert realtime.fault(9 * S) == 'state_stale'
    assert realtime.describe(9 * S).count('limit') == len(INPUTS)


def test_a_rejected_message_does_not_reset_the_age_of_its_input(realtime):
    assert 'in the past' in realtime.offer(OBSTACLES, 0, S + 300 * MS)
    assert realtime.reject(OBSTACLES, 'it has NaN') == 'it has NaN'
    refresh(realtime, S + 300 * MS, OBSTACLES)
    assert realtime.fault(S + 300 * MS) == 'obstacles_stale'
    health = realtime.on_timer(S + 300 * MS, '')
    assert health.values['age.obstacles_refused'] == 2
    assert health.values['age.obstacles_reason'] == 'it has NaN'


def test_a_check_refuses_what_an_offer_would_and_changes_nothing(realtime):
    assert 'in the past' in realtime.check(STATE, 0, S + 90 * MS)
    assert realtime.check(STATE, S + 90 * MS, S + 90 * MS) == ''
    assert realtime.fault(S + 101 * MS) == 'state_stale'
    lockstep = watchdog.make('lockstep', HealthMonitor('controller'), AGES)
    assert lockstep.check(STATE, 0, 99 * S) == ''


def test_internal_errors_are_counted_in_the_health(realtime):
    report = why(S, ERROR)
    realtime.on_step(report._replace(values=report.values | {'internal_errors': 2}))
    assert realtime.on_timer(S, '').values['internal_errors'] == 2


def test_health_is_published_once_per_second_also_without_steps(realtime):
    reports = [realtime.on_timer(S + k * 20 * MS, '') for k in range(101)]
    assert [k for k, health in enumerate(reports) if health] == [0, 50, 100]


def test_health_names_stale_inputs_and_counts_the_fallback_levels(realtime):
    assert realtime.on_step(why(S)) is None
    refresh(realtime, S + 150 * MS, OBSTACLES)
    health = realtime.on_timer(S + 150 * MS, '')
    assert (health.name, health.level) == ('controller', WARN)
    assert health.message == 'obstacles is 150 ms old, limit 200 ms'
    assert health.values['rung.solved'] == 1
    assert health.values['gate.rejections'] == 3
    assert health.values['age.obstacles_ms'] == 150.0
    refresh(realtime, 2 * S + 150 * MS)
    # the warning is held; its cause is gone
    held = realtime.on_timer(2 * S + 150 * MS, '')
    assert held.level == WARN
    assert held.message == 'obstacles was 150 ms old 1.0 s ago, limit 200 ms'
    refresh(realtime, 4 * S)
    well = realtime.on_timer(4 * S, '')
    assert (well.level, well.message) == (OK, MESSAGES[OK])


@pytest.mark.parametrize('level', [OK, ERROR])
def test_actuators_that_do_not_follow_are_a_warning(realtime, level):
    with_fault = why(S, level)
    with_fault.values['actuators.fault'] = 'steer'
    realtime.on_step(with_fault)
    realtime.on_step(why(S + 50 * MS))  # it ended before the report
    refresh(realtime, S + 100 * MS)
    health = realtime.on_timer(S + 100 * MS, '')
    assert health.level == max(level, WARN)
    assert health.message.endswith('actuators do not follow their set-points: steer')
    assert (MESSAGES[ERROR] in health.message) == (level == ERROR)
    assert health.values['actuators.fault'] == 'steer'
    refresh(realtime, 4 * S)
    well = realtime.on_timer(4 * S, '')
    assert (well.level, well.message) == (OK, MESSAGES[OK])
    assert 'actuators.fault' not in well.values


def test_a_bad_step_is_remembered_for_two_seconds(realtime):
    realtime.on_step(why(S, ERROR))
    levels = []
    for second in (1, 2, 3):
        refresh(realtime, second * S)
        levels.append(realtime.on_timer(second * S, '').level)
    assert levels == [ERROR, ERROR, OK]


def test_before_the_first_step_health_names_the_missing_inputs():
    new_watchdog = watchdog.make('realtime', HealthMonitor('controller'), AGES)
    assert new_watchdog.fault(S) == ''
    assert not new_watchdog.is_state_lost(S)
    health = new_watchdog.on_timer(S, 'waiting for path')
    assert (health.level, health.message) == (STALE, 'waiting for path')


def test_in_lockstep_no_input_becomes_stale():
    lockstep = watchdog.make('lockstep', HealthMonitor('controller'), AGES)
    assert (
        lockstep.offer(STATE, 0, 99 * S)
        == lockstep.check(STATE, 0, 99 * S)
        == lockstep.fault(99 * S)
        == lockstep.describe(99 * S)
        == ''
    )
    assert not lockstep.is_state_lost(99 * S)
    assert lockstep.reject(STATE, 'it has NaN') == 'it has NaN'
    assert lockstep.on_timer(99 * S, '') is None
    health = lockstep.on_step(why(S))
    assert (health.stamp_ns, health.level) == (S, OK)
    assert lockstep.on_step(why(S + 50 * MS)) is None


TICK = 50_000_000


def step_report(k, rung='solved', level=OK):
    return Why(1_000_000_000 + k * TICK, level, '', {'rung': rung, 'gate.rejections': 0})


def test_health_is_published_once_per_second_with_the_worst_level():
    monitor = HealthMonitor('controller')
    reports = [monitor.on_step(step_report(0))]
    reports += [monitor.on_step(step_report(k, 'shifted', WARN)) for k in range(1, 20)]
    reports += [
        monitor.on_step(step_report(20, 'braking', ERROR)),
        monitor.on_step(step_report(40)),
    ]
    published = [health for health in reports if health]
    assert [health.level for health in published] == [OK, ERROR, OK]
    assert published[1].message == MESSAGES[ERROR]
    assert published[1].values == {
        'rung.braking': 1,
        'rung.shifted': 19,
        'rung.solved': 1,
        'gate.rejections': 0,
    }


def test_a_stamp_that_is_only_checked_counts_as_not_received(realtime):
    late = S + 200 * MS
    assert realtime.check(OBSTACLES, late, late) == ''
    assert realtime.check(OBSTACLES, S, S + 201 * MS) != ''
    refresh(realtime, late + 1, OBSTACLES)
    assert realtime.fault(late + 1) == 'obstacles_stale'


def test_the_health_has_the_number_of_internal_errors_where_there_are_any():
    monitor = HealthMonitor('controller')
    assert 'internal_errors' not in monitor.on_step(why(S)).values
    failed = why(2 * S)
    failed.values['internal_errors'] = 7
    assert monitor.on_step(failed).values['internal_errors'] == 7
