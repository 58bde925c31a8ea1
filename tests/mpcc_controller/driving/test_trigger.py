"""Which states start a step of the controller."""

import pytest

from mpcc_controller.driving import trigger

TICK, MS = 50_000_000, 1_000_000
START = 1_000_000_000
STEP, FIRST = (True, False, False), (True, False, True)
NOTHING = trigger.NOTHING


@pytest.fixture(params=['lockstep', 'realtime'])
def either(request):
    return trigger.make(request.param, 0.05)


@pytest.fixture
def lockstep():
    started = trigger.make('lockstep', 0.05)
    started.actuators = START
    return started


@pytest.fixture
def realtime():
    started = trigger.make('realtime', 0.05)
    started.actuators = START
    return started


def receive(started, stamp):
    """Return what is due after state and obstacles of an instant."""
    started.on_state(stamp)
    started.obstacles = stamp
    return started.due()


def test_lockstep_waits_for_obstacles_of_the_same_instant_in_either_order(lockstep):
    assert lockstep.on_state(START)
    lockstep.obstacles = START - TICK
    assert lockstep.due() == NOTHING
    lockstep.obstacles = START
    assert lockstep.due() == FIRST
    lockstep.obstacles = START + TICK
    assert lockstep.due() == NOTHING
    lockstep.on_state(START + TICK)
    assert lockstep.due() == STEP
    assert lockstep.due() == NOTHING


def test_lockstep_waits_for_predictions_of_the_same_instant_where_somebody_sends_them(lockstep):
    assert receive(lockstep, START) == FIRST
    lockstep.with_predictions = True
    assert receive(lockstep, START + TICK) == NOTHING
    lockstep.predictions = START + TICK
    assert lockstep.due() == STEP
    lockstep.with_predictions = False
    assert receive(lockstep, START + 2 * TICK) == STEP


def test_lockstep_answers_later_states_with_their_actuators_where_these_come(lockstep):
    for k, comes in enumerate((True, True, False)):
        lockstep.with_states = comes
        due = receive(lockstep, START + k * TICK)
        if comes and k:
            assert lockstep.waits_for_actuators
            assert due == NOTHING
            lockstep.actuators = START + k * TICK
            due = lockstep.due()
        assert not lockstep.waits_for_actuators
        assert due == (STEP if k else FIRST)


def test_when_time_goes_back_the_controller_restarts(lockstep):
    receive(lockstep, START)
    receive(lockstep, START + TICK)
    lockstep.actuators = START
    assert receive(lockstep, START) == FIRST


def test_realtime_answers_the_first_state_of_each_tick_and_none_that_is_late(realtime):
    answered = []
    for k in range(0, 160, 3):
        if realtime.on_state(START + k * MS) and realtime.due().step:
            answered.append(k)
    assert answered == [0, 51, 102, 150]
    assert realtime.age_s(START + 154 * MS) == pytest.approx(0.004)
    for ms in (0, 149, 150, 199):
        assert not realtime.on_state(START + ms * MS)
    assert realtime.on_state(START + 200 * MS)
    assert realtime.due() == STEP


def test_realtime_takes_actuators_of_about_the_time_of_the_first_state(realtime):
    realtime.on_state(START + TICK + MS)
    assert realtime.due() == NOTHING
    realtime.actuators = START + MS
    assert realtime.due() == FIRST


def test_after_a_command_without_a_state_the_next_one_starts_from_fresh_actuators(realtime):
    realtime.on_state(START)
    realtime.due()
    assert not realtime.is_next(START + TICK - 1)
    assert realtime.is_next(START + TICK)
    realtime.on_lost(START + 4 * TICK + MS)
    assert not realtime.is_next(START + 5 * TICK)
    assert not realtime.on_state(START + 4 * TICK + 2 * MS)
    assert realtime.on_state(START + 5 * TICK)
    assert realtime.due() == NOTHING
    realtime.actuators = START + 5 * TICK
    assert realtime.due() == FIRST


@pytest.mark.parametrize('end', ['lost', 'restart'])
def test_at_a_start_and_after_a_break_the_trigger_waits_for_new_actuators(either, end):
    for k in (0, 1):
        stamp = START + k * TICK
        assert receive(either, stamp) == NOTHING
        either.actuators = stamp
        assert either.due() == FIRST
        either.on_lost(stamp) if end == 'lost' else either.restart()
