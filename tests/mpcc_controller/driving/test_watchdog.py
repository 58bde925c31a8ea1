"""What too old an input brings about: a reason to brake, and a line of health."""

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
def awake():
    made = watchdog.make('realtime', HealthMonitor('controller'), AGES)
    for name in INPUTS:
        assert made.offer(name, S, S) == ''
    return made


def keep(made, now_ns, *but):
    for name in INPUTS:
        if name not in but:
            made.offer(name, now_ns, now_ns)


@pytest.mark.parametrize(
    ('name', 'limit_ns'),
    [(STATE, 100 * MS), (REFERENCE, S), (EDGES, S), (OBSTACLES, 200 * MS)],
)
def test_each_input_has_its_limit_and_its_reason(awake, name, limit_ns):
    keep(awake, S + limit_ns, name)
    assert awake.fault(S + limit_ns) == ''
    keep(awake, S + limit_ns + 1, name)
    assert awake.fault(S + limit_ns + 1) == f'{name}_stale'
    assert awake.is_state_lost(S + limit_ns + 1) == (name == STATE)
    assert awake.describe(S + limit_ns + 1).startswith(f'{name} is {limit_ns // MS} ms old')
    keep(awake, S + limit_ns + 2)
    assert awake.fault(S + limit_ns + 2) == awake.describe(S + limit_ns + 2) == ''


def test_the_state_comes_first_when_several_are_too_old(awake):
    assert awake.fault(9 * S) == 'state_stale'
    assert awake.describe(9 * S).count('limit') == len(INPUTS)


def test_what_is_turned_down_does_not_make_an_input_younger(awake):
    assert 'in the past' in awake.offer(OBSTACLES, 0, S + 300 * MS)
    assert awake.refuse(OBSTACLES, 'it has NaN') == 'it has NaN'
    keep(awake, S + 300 * MS, OBSTACLES)
    assert awake.fault(S + 300 * MS) == 'obstacles_stale'
    health = awake.on_timer(S + 300 * MS, '')
    assert health.values['age.obstacles_refused'] == 2
    assert health.values['age.obstacles_reason'] == 'it has NaN'


def test_health_is_told_once_per_second_also_without_steps(awake):
    beats = [awake.on_timer(S + k * 20 * MS, '') for k in range(101)]
    assert [k for k, health in enumerate(beats) if health] == [0, 50, 100]


def test_health_names_what_is_old_and_counts_the_rungs(awake):
    assert awake.on_step(why(S)) is None
    keep(awake, S + 150 * MS, OBSTACLES)
    health = awake.on_timer(S + 150 * MS, '')
    assert (health.name, health.level) == ('controller', WARN)
    assert health.message == 'obstacles is 150 ms old, limit 200 ms'
    assert health.values['rung.solved'] == 1
    assert health.values['gate.rejections'] == 3
    assert health.values['age.obstacles_ms'] == 150.0
    keep(awake, 2 * S + 150 * MS)
    # the warning is held; its cause is gone
    held = awake.on_timer(2 * S + 150 * MS, '')
    assert held.level == WARN
    assert held.message == 'obstacles was 150 ms old 1.0 s ago, limit 200 ms'
    keep(awake, 4 * S)
    well = awake.on_timer(4 * S, '')
    assert (well.level, well.message) == (OK, MESSAGES[OK])


def test_a_bad_step_is_remembered_for_two_seconds(awake):
    awake.on_step(why(S, ERROR))
    levels = []
    for second in (1, 2, 3):
        keep(awake, second * S)
        levels.append(awake.on_timer(second * S, '').level)
    assert levels == [ERROR, ERROR, OK]


def test_before_the_first_step_health_says_what_is_waited_for():
    made = watchdog.make('realtime', HealthMonitor('controller'), AGES)
    assert made.fault(S) == ''
    assert not made.is_state_lost(S)
    health = made.on_timer(S, 'waiting for path')
    assert (health.level, health.message) == (STALE, 'waiting for path')


def test_in_lockstep_nothing_ages():
    made = watchdog.make('lockstep', HealthMonitor('controller'), AGES)
    assert made.offer(STATE, 0, 99 * S) == made.fault(99 * S) == made.describe(99 * S) == ''
    assert not made.is_state_lost(99 * S)
    assert made.refuse(STATE, 'it has NaN') == 'it has NaN'
    assert made.on_timer(99 * S, '') is None
    health = made.on_step(why(S))
    assert (health.stamp_ns, health.level) == (S, OK)
    assert made.on_step(why(S + 50 * MS)) is None


TICK = 50_000_000


def step_report(k, rung='solved', level=OK):
    return Why(1_000_000_000 + k * TICK, level, '', {'rung': rung, 'gate.rejections': 0})


def test_health_is_told_once_per_second_with_the_worst_of_it():
    monitor = HealthMonitor('controller')
    said = [monitor.on_step(step_report(0))]
    said += [monitor.on_step(step_report(k, 'shifted', WARN)) for k in range(1, 20)]
    said += [monitor.on_step(step_report(20, 'braking', ERROR)), monitor.on_step(step_report(40))]
    told = [health for health in said if health]
    assert [health.level for health in told] == [OK, ERROR, OK]
    assert told[1].message == MESSAGES[ERROR]
    assert told[1].values == {
        'rung.braking': 1,
        'rung.shifted': 19,
        'rung.solved': 1,
        'gate.rejections': 0,
    }
