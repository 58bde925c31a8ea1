"""What the plant says of itself: causes by weight, remembered for a while."""

import pytest

from msgs_yaml.types import Command
from node_runtime.input_monitor import ERROR, OK, STALE, WARN
from vehicle_plant import health
from vehicle_plant.initial_state import Start
from vehicle_plant.parameters import StopParams
from vehicle_plant.run_end import RunEnd
from vehicle_plant.simulator import START_NS, STEP_NS, TICK_NS, Simulator
from vehicle_plant.stepping import LockstepStepper, RealtimeStepper, StartHold

FAR = StopParams(
    x_m=1000.0, y_m=0.0, yaw_rad=0.0, armed_after_m=0.0, time_s=60.0, standstill_s=None
)
S = 1_000_000_000


@pytest.fixture
def stepper(params):
    car = Simulator(params, 1.0, Start(0.0, 0.0, 0.0, 20.0))
    return RealtimeStepper(car, RunEnd(FAR, car.now))


def coast(stamp_ns, delta=0.0):
    return Command(stamp_ns, delta, 0.0, 0.0, 0.0)


def advance(stepper, ticks, commanded=True):
    for _ in range(ticks):
        if commanded:
            stepper.command(coast(stepper.car.stamp_ns))
        for _ in range(TICK_NS // STEP_NS):
            stepper.advance_to(stepper.car.stamp_ns + STEP_NS)
    return stepper.car.stamp_ns


def test_a_run_that_goes_well_says_how_old_commands_are(stepper):
    monitor = health.HealthMonitor(stepper)
    assert monitor.health(START_NS).level == OK
    status = monitor.health(advance(stepper, 10))
    assert (status.name, status.level, status.message) == ('plant', OK, 'running')
    assert status.values['age.command_ms'] == 0.0
    assert status.values['age.command_limit_ms'] == 100.0
    assert not status.values['controller_gone']


def test_a_command_ages_from_the_instant_at_which_it_is_due(stepper):
    stepper.command(coast(START_NS))
    monitor, levels = health.HealthMonitor(stepper), []
    for after_ms in (50, 100, 101, 150, 151):
        stepper.advance_to(START_NS + after_ms * STEP_NS)
        monitor.health(stepper.car.stamp_ns)
        levels.append(stepper.command_monitor.held_level)
    assert levels == [OK, OK, WARN, WARN, ERROR]
    assert stepper.controller_gone


def test_silence_is_an_error_that_is_remembered_after_commands_came_again(stepper):
    monitor = health.HealthMonitor(stepper)
    advance(stepper, 4)
    gone = monitor.health(advance(stepper, 4, commanded=False))
    assert (gone.level, gone.message) == (ERROR, 'no command comes, braking straight')
    assert gone.values['age.command_stale'] == 1
    again = monitor.health(advance(stepper, 4))
    assert (again.level, again.values['controller_gone']) == (ERROR, False)
    assert monitor.health(advance(stepper, 45)).level == OK


def test_a_command_that_is_late_is_a_warning(stepper):
    monitor = health.HealthMonitor(stepper)
    advance(stepper, 1)
    advance(stepper, 1, commanded=False)
    assert monitor.health(stepper.car.stamp_ns).level == OK
    stepper.advance_to(stepper.car.stamp_ns + STEP_NS)
    late = monitor.health(stepper.car.stamp_ns)
    assert (late.level, late.message) == (WARN, 'commands come late')


def test_a_refusal_is_a_warning_for_two_seconds_and_counted_for_ever(stepper):
    monitor = health.HealthMonitor(stepper)
    stepper.command(coast(START_NS, delta=9.0))
    stepper.reject('breaks the contract')
    now_ns = advance(stepper, 4)
    first = monitor.health(now_ns)
    assert (first.level, first.message) == (WARN, 'commands refused: breaks the contract')
    assert first.values['commands_rejected'] == first.values['age.command_refused'] == 2
    assert monitor.health(advance(stepper, 30)).level == WARN
    last = monitor.health(advance(stepper, 15))
    assert (last.level, last.values['commands_rejected']) == (OK, 2)


def test_a_refusal_is_named_beside_steps_that_came_late_after_it(stepper):
    monitor = health.HealthMonitor(stepper)
    stepper.command(coast(START_NS))
    stepper.reject('name is wheel')
    stepper.advance_to(START_NS + STEP_NS)
    monitor.health(stepper.car.stamp_ns)
    stepper.advance_to(START_NS + 5 * STEP_NS)
    status = monitor.health(stepper.car.stamp_ns)
    late = 'steps came late and were caught up'
    assert (status.level, status.message) == (WARN, f'commands refused: name is wheel; {late}')


def test_silence_comes_before_the_refusals_that_led_to_it(stepper):
    monitor = health.HealthMonitor(stepper)
    advance(stepper, 1)
    for _ in range(4):
        stepper.reject('name is wheel')
        advance(stepper, 1, commanded=False)
    status = monitor.health(stepper.car.stamp_ns)
    silent = 'no command comes, braking straight'
    assert (status.level, status.message) == (ERROR, f'{silent}; commands refused: name is wheel')


def test_steps_that_came_late_are_a_warning(stepper):
    monitor = health.HealthMonitor(stepper)
    stepper.command(coast(START_NS))
    stepper.advance_to(START_NS + 5 * STEP_NS)
    status = monitor.health(stepper.car.stamp_ns)
    assert (status.level, status.values['missed_steps']) == (WARN, 4)


def test_in_lockstep_there_are_no_ages(params):
    car = Simulator(params, 1.0, Start(0.0, 0.0, 0.0, 20.0))
    status = health.HealthMonitor(LockstepStepper(car, RunEnd(FAR, car.now))).health(START_NS)
    assert status.level == OK
    assert not any(key.startswith('age.') for key in status.values)


def test_before_its_run_the_plant_says_what_it_waits_for():
    status = health.waiting(START_NS, 'waiting for a command')
    assert (status.level, status.message) == (STALE, 'waiting for a command')


def test_only_an_answer_to_the_start_lets_the_car_go():
    hold = StartHold()
    hold.record(START_NS)
    assert hold.is_answer(coast(START_NS))
    assert not hold.is_answer(coast(START_NS + 1))
    for k in range(1, 101):
        hold.record(START_NS + k * STEP_NS)
    assert not hold.is_answer(coast(START_NS)), 'too long ago'
