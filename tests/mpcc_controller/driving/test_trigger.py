"""Which states are answered."""

import pytest

from mpcc_controller.driving import trigger

TICK, MS = 50_000_000, 1_000_000
START = 1_000_000_000


def lockstep_at(stamp):
    made = trigger.make('lockstep', 0.05)
    made.on_actuators(stamp)
    return made


def test_lockstep_waits_for_obstacles_of_the_same_instant():
    made = lockstep_at(START)
    assert made.on_state(START)
    made.on_obstacles(START - TICK)
    assert made.due() == trigger.NOTHING
    made.on_obstacles(START)
    assert made.due() == (True, False, True)
    assert made.due() == trigger.NOTHING


def test_lockstep_does_not_mind_which_arrives_first():
    made = lockstep_at(START)
    made.on_obstacles(START)
    assert made.due() == trigger.NOTHING
    made.on_state(START)
    assert made.due().step


def test_lockstep_starts_with_the_actuators_of_the_first_state():
    made = trigger.make('lockstep', 0.05)
    made.on_state(START)
    made.on_obstacles(START)
    assert made.due() == trigger.NOTHING
    made.on_actuators(START)
    assert made.due() == (True, False, True)


def test_lockstep_passes_over_states_between_ticks():
    made = lockstep_at(START)
    assert not made.on_state(START + 7 * MS)
    assert made.on_state(START + TICK)


def test_a_state_sent_again_gets_the_same_answer_again():
    made = lockstep_at(START)
    for wanted in (True, False):
        made.on_state(START)
        made.on_obstacles(START)
        assert made.due() == (wanted, not wanted, wanted)


def test_ticks_after_the_first_are_no_restart():
    made = lockstep_at(START)
    for k in range(3):
        made.on_state(START + k * TICK)
        made.on_obstacles(START + k * TICK)
        assert made.due() == (True, False, k == 0)


def test_when_time_goes_back_the_controller_starts_anew():
    made = lockstep_at(START)
    for stamp in (START + TICK, START):
        made.on_state(stamp)
        made.on_obstacles(stamp)
        made.on_actuators(stamp)
        assert made.due().restart


def test_realtime_answers_the_first_state_of_each_tick():
    made = trigger.make('realtime', 0.05)
    made.on_actuators(START)
    answered = []
    for k in range(0, 160, 3):
        if made.on_state(START + k * MS) and made.due().step:
            answered.append(k)
    assert answered == [0, 51, 102, 150]


def test_realtime_waits_for_the_actuators_and_knows_the_age_of_its_state():
    made = trigger.make('realtime', 0.05)
    assert made.on_state(START)
    assert made.due() == trigger.NOTHING
    made.on_actuators(START - MS)
    assert made.due() == (True, False, True)
    assert made.age_s(START + 4 * MS) == pytest.approx(0.004)
    assert lockstep_at(START).age_s(START + 4 * MS) == 0


def test_on_the_wall_clock_a_state_that_comes_late_or_twice_is_not_answered():
    made = trigger.make('realtime', 0.05)
    made.on_actuators(START)
    made.on_state(START + TICK)
    assert made.due() == (True, False, True)
    for stamp in (START, START + TICK - MS, START + TICK, START + TICK + 49 * MS):
        assert not made.on_state(stamp)
    assert made.on_state(START + 2 * TICK)
    assert made.due() == (True, False, False)


def test_after_a_command_without_a_state_the_next_one_starts_from_fresh_actuators():
    made = trigger.make('realtime', 0.05)
    made.on_actuators(START)
    made.on_state(START)
    made.due()
    assert not made.is_next(START + TICK - 1)
    assert made.is_next(START + TICK)
    made.on_lost(START + 4 * TICK + MS)
    assert not made.is_next(START + 5 * TICK)
    assert not made.on_state(START + 4 * TICK + 2 * MS)
    assert made.on_state(START + 5 * TICK)
    assert made.due() == trigger.NOTHING
    made.on_actuators(START + 5 * TICK)
    assert made.due() == (True, False, True)


@pytest.mark.parametrize('mode', ['lockstep', 'realtime'])
def test_actuators_that_were_of_no_use_are_waited_for_anew(mode):
    made = trigger.make(mode, 0.05)

    def hear(stamp):
        made.on_state(stamp)
        made.on_obstacles(stamp)

    hear(START)
    made.on_actuators(START)
    assert made.due() == (True, False, True)
    made.on_lost(START)
    hear(START + TICK)
    assert made.due() == trigger.NOTHING
    made.on_actuators(START + TICK)
    assert made.due() == (True, False, True)
