"""The effect of stale inputs: a reason to brake, and the health report."""

import pytest

from mpcc_controller.driving.tick_report import OK, WARN
from mpcc_controller.driving.watchdog import (
    EDGES,
    MESSAGES,
    OBSTACLES,
    REFERENCE,
    STATE,
    Watchdog,
)
from mpcc_controller.parameters import Ages
from msgs_yaml.types import Why
from node_runtime.input_monitor import ERROR, STALE

MS, S = 1_000_000, 1_000_000_000
AGES = Ages(state_s=0.1, reference_s=1.0, obstacles_s=0.2)
LIMITS = {STATE: 100 * MS, REFERENCE: S, EDGES: S, OBSTACLES: 200 * MS}


def why(stamp_ns, level=OK, rung='solved', **values):
    values = {'rung': rung, 'gate.rejections': 3} | {
        k.replace('__', '.'): v for k, v in values.items()
    }
    return Why(stamp_ns, level, '', values)


def make(mode):
    return Watchdog('controller', AGES if mode == 'realtime' else None)


@pytest.fixture
def realtime():
    new_watchdog = make('realtime')
    assert new_watchdog.fault(S) == ''
    assert not new_watchdog.is_state_lost(S)
    refresh(new_watchdog, S)
    return new_watchdog


def refresh(monitored, now_ns, *but):
    for name in LIMITS:
        if name not in but:
            assert monitored.offer(name, now_ns, now_ns) == ''


@pytest.mark.parametrize('name', LIMITS)
def test_each_input_has_its_limit_and_its_reason(realtime, name):
    late = S + LIMITS[name]
    refresh(realtime, late, name)
    assert realtime.fault(late) == ''
    refresh(realtime, late + 1, name)
    assert realtime.fault(late + 1) == f'{name}_stale'
    assert realtime.is_state_lost(late + 1) == (name == STATE)
    assert realtime.describe(late + 1).startswith(f'{name} is {LIMITS[name] // MS} ms old')
    refresh(realtime, late + 2)
    assert realtime.fault(late + 2) == realtime.describe(late + 2) == ''


def test_a_message_that_is_refused_or_only_checked_does_not_reset_the_age(realtime):
    late = S + 300 * MS
    assert 'in the past' in realtime.offer(OBSTACLES, 0, late)
    assert realtime.reject(OBSTACLES, 'it has NaN') == 'it has NaN'
    assert 'in the past' in realtime.check(OBSTACLES, 0, late)
    assert realtime.check(OBSTACLES, late, late) == ''
    refresh(realtime, late, OBSTACLES)
    assert realtime.fault(late) == 'obstacles_stale'
    values = realtime.on_timer(late, '').values
    assert values['age.obstacles_refused'] == 2
    assert values['age.obstacles_reason'] == 'it has NaN'


def test_health_is_published_once_per_second_also_without_steps(realtime):
    reports = [realtime.on_timer(S + k * 20 * MS, '') for k in range(101)]
    assert [k for k, health in enumerate(reports) if health] == [0, 50, 100]


def test_health_names_stale_inputs_holds_a_warning_and_counts_levels_and_errors(realtime):
    assert realtime.on_step(why(S, internal_errors=2)) is None
    refresh(realtime, S + 150 * MS, OBSTACLES)
    health = realtime.on_timer(S + 150 * MS, '')
    assert (health.name, health.level) == ('controller', WARN)
    assert health.message == 'obstacles is 150 ms old, limit 200 ms'
    counts = {'rung.solved': 1, 'gate.rejections': 3, 'internal_errors': 2}
    assert counts.items() <= health.values.items()
    assert health.values['age.obstacles_ms'] == 150.0
    refresh(realtime, 2 * S + 150 * MS)
    # the warning is held; its cause is gone
    held = realtime.on_timer(2 * S + 150 * MS, '')
    assert held.level == WARN
    assert held.message == 'obstacles was 150 ms old 1.0 s ago, limit 200 ms'
    refresh(realtime, 4 * S)
    assert realtime.on_timer(4 * S, '')[2:4] == (OK, MESSAGES[OK])


@pytest.mark.parametrize('level', [OK, ERROR])
def test_actuators_that_do_not_follow_are_a_warning(realtime, level):
    realtime.on_step(why(S, level, actuators__fault='steer'))
    realtime.on_step(why(S + 50 * MS))  # it ended before the report
    refresh(realtime, S + 100 * MS)
    health = realtime.on_timer(S + 100 * MS, '')
    assert health.level == max(level, WARN)
    assert health.message.endswith('actuators do not follow their set-points: steer')
    assert (MESSAGES[ERROR] in health.message) == (level == ERROR)
    assert health.values['actuators.fault'] == 'steer'
    refresh(realtime, 4 * S)
    well = realtime.on_timer(4 * S, '')
    assert well[2:4] == (OK, MESSAGES[OK])
    assert 'actuators.fault' not in well.values


def test_before_the_first_step_health_names_the_missing_inputs():
    health = make('realtime').on_timer(S, 'waiting for path')
    assert (health.level, health.message) == (STALE, 'waiting for path')


def test_in_lockstep_no_input_ages_and_health_comes_with_the_steps_of_each_second():
    lockstep = make('lockstep')
    assert lockstep.offer(STATE, 0, 99 * S) == lockstep.check(STATE, 0, 99 * S) == ''
    assert lockstep.fault(99 * S) == lockstep.describe(99 * S) == ''
    assert not lockstep.is_state_lost(99 * S)
    assert lockstep.reject(STATE, 'it has NaN') == 'it has NaN'
    assert lockstep.on_timer(99 * S, '') is None
    reports = [lockstep.on_step(why(S))]
    reports += [lockstep.on_step(why(S + k * 50 * MS, WARN, 'shifted')) for k in range(1, 20)]
    reports += [lockstep.on_step(why(2 * S, ERROR, 'braking')), lockstep.on_step(why(3 * S))]
    first, second, third = (health for health in reports if health)
    assert [h.level for h in (first, second, third)] == [OK, ERROR, OK]
    assert (first.stamp_ns, second.message) == (S, MESSAGES[ERROR])
    counts = {'rung.braking': 1, 'rung.shifted': 19, 'rung.solved': 1, 'gate.rejections': 3}
    assert second.values == counts


def test_the_state_is_named_first_when_several_inputs_are_stale(realtime):
    assert realtime.fault(9 * S) == 'state_stale'
    assert realtime.describe(9 * S).count('limit') == len(LIMITS)
