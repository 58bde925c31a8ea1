"""Which states start a step of the controller."""

import pytest

from mpcc_controller.driving import trigger

TICK, MS = 50_000_000, 1_000_000
START = 1_000_000_000


def lockstep_at(stamp):
    state_trigger = trigger.make('lockstep', 0.05)
    state_trigger.on_actuators(stamp)
    return state_trigger


def test_lockstep_waits_for_obstacles_of_the_same_instant():
    state_trigger = lockstep_at(START)
    assert state_trigger.on_state(START)
    state_trigger.on_obstacles(START - TICK)
    assert state_trigger.due() == trigger.NOTHING
    state_trigger.on_obstacles(START)
    assert state_trigger.due() == (True, False, True)
    assert state_trigger.due() == trigger.NOTHING


def test_lockstep_accepts_state_and_obstacles_in_either_order():
    state_trigger = lockstep_at(START)
    state_trigger.on_obstacles(START)
    assert state_trigger.due() == trigger.NOTHING
    state_trigger.on_state(START)
    assert state_trigger.due().step


def test_lockstep_starts_with_the_actuators_of_the_first_state():
    state_trigger = trigger.make('lockstep', 0.05)
    state_trigger.on_state(START)
    state_trigger.on_obstacles(START)
    assert state_trigger.due() == trigger.NOTHING
    state_trigger.on_actuators(START)
    assert state_trigger.due() == (True, False, True)


def test_lockstep_answers_later_states_with_their_actuators_where_these_come():
    state_trigger = lockstep_at(START)
    for k, comes in enumerate((True, True, False)):
        stamp = START + k * TICK
        state_trigger.with_states = comes
        state_trigger.on_state(stamp)
        state_trigger.on_obstacles(stamp)
        if comes and k:
            assert state_trigger.waits_for_actuators
            assert state_trigger.due() == trigger.NOTHING
            state_trigger.on_actuators(stamp)
        assert not state_trigger.waits_for_actuators
        assert state_trigger.due() == (True, False, k == 0)


def test_lockstep_ignores_states_between_ticks():
    state_trigger = lockstep_at(START)
    assert not state_trigger.on_state(START + 7 * MS)
    assert state_trigger.on_state(START + TICK)


def test_a_repeated_state_repeats_the_answer():
    state_trigger = lockstep_at(START)
    for wanted in (True, False):
        state_trigger.on_state(START)
        state_trigger.on_obstacles(START)
        assert state_trigger.due() == (wanted, not wanted, wanted)


def test_ticks_after_the_first_are_no_restart():
    state_trigger = lockstep_at(START)
    for k in range(3):
        state_trigger.on_state(START + k * TICK)
        state_trigger.on_obstacles(START + k * TICK)
        assert state_trigger.due() == (True, False, k == 0)


def test_when_time_goes_back_the_controller_restarts():
    state_trigger = lockstep_at(START)
    for stamp in (START + TICK, START):
        state_trigger.on_state(stamp)
        state_trigger.on_obstacles(stamp)
        state_trigger.on_actuators(stamp)
        assert state_trigger.due().restart


def test_realtime_answers_the_first_state_of_each_tick():
    state_trigger = trigger.make('realtime', 0.05)
    state_trigger.on_actuators(START)
    answered = []
    for k in range(0, 160, 3):
        if state_trigger.on_state(START + k * MS) and state_trigger.due().step:
            answered.append(k)
    assert answered == [0, 51, 102, 150]


def test_realtime_waits_for_the_actuators_and_returns_the_age_of_its_state():
    state_trigger = trigger.make('realtime', 0.05)
    assert state_trigger.on_state(START)
    assert state_trigger.due() == trigger.NOTHING
    state_trigger.on_actuators(START - MS)
    assert state_trigger.due() == (True, False, True)
    assert state_trigger.age_s(START + 4 * MS) == pytest.approx(0.004)
    assert lockstep_at(START).age_s(START + 4 * MS) == 0


def test_in_realtime_a_late_or_repeated_state_is_not_answered():
    state_trigger = trigger.make('realtime', 0.05)
    state_trigger.on_actuators(START)
    state_trigger.on_state(START + TICK)
    assert state_trigger.due() == (True, False, True)
    for stamp in (START, START + TICK - MS, START + TICK, START + TICK + 49 * MS):
        assert not state_trigger.on_state(stamp)
    assert state_trigger.on_state(START + 2 * TICK)
    assert state_trigger.due() == (True, False, False)


def test_after_a_command_without_a_state_the_next_one_starts_from_fresh_actuators():
    state_trigger = trigger.make('realtime', 0.05)
    state_trigger.on_actuators(START)
    state_trigger.on_state(START)
    state_trigger.due()
    assert not state_trigger.is_next(START + TICK - 1)
    assert state_trigger.is_next(START + TICK)
    state_trigger.on_lost(START + 4 * TICK + MS)
    assert not state_trigger.is_next(START + 5 * TICK)
    assert not state_trigger.on_state(START + 4 * TICK + 2 * MS)
    assert state_trigger.on_state(START + 5 * TICK)
    assert state_trigger.due() == trigger.NOTHING
    state_trigger.on_actuators(START + 5 * TICK)
    assert state_trigger.due() == (True, False, True)


@pytest.mark.parametrize('mode', ['lockstep', 'realtime'])
def test_after_a_lost_state_the_trigger_waits_for_new_actuators(mode):
    state_trigger = trigger.make(mode, 0.05)

    def receive(stamp):
        state_trigger.on_state(stamp)
        state_trigger.on_obstacles(stamp)

    receive(START)
    state_trigger.on_actuators(START)
    assert state_trigger.due() == (True, False, True)
    state_trigger.on_lost(START)
    receive(START + TICK)
    assert state_trigger.due() == trigger.NOTHING
    state_trigger.on_actuators(START + TICK)
    assert state_trigger.due() == (True, False, True)
