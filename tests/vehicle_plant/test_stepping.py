"""When the plant advances, when a run ends, what a silent controller brings about; its health."""

from dataclasses import replace

import numpy as np
import pytest
from drives import ahead

from msgs_yaml import encode
from msgs_yaml.decode import DecodeError
from msgs_yaml.types import Command, Reference, StopPlan
from node_runtime import ros
from node_runtime.input_monitor import ERROR, OK, STALE, WARN
from vehicle_plant import health, initial_state, parameters, plant_node
from vehicle_plant.health import HealthMonitor
from vehicle_plant.parameters import StopParams
from vehicle_plant.run_end import CONTROLLER_GONE, FAILED, FINISHED, RunEnd
from vehicle_plant.simulator import START_NS, STEP_NS, TICK_NS, TICK_STEPS, Simulator
from vehicle_plant.stepping import (
    BRAKING,
    FOLLOWING,
    HOLDING,
    LockstepStepper,
    RealtimeStepper,
)

FAR = StopParams(
    x_m=1000.0, y_m=0.0, yaw_rad=0.0, armed_after_m=0.0, time_s=60.0, standstill_s=None
)


def stepper(kind, params, speed=20.0, **stop):
    car = Simulator(params, 1.0, ahead(speed))
    return kind(car, RunEnd(replace(FAR, **stop), car.now))


def coast(stamp_ns):
    return Command(stamp_ns, 0.0, 0.0, 0.0, 0.0)


def run(loop, ticks, delta=0.0, Fxf=0.0, Fxr=0.0):
    """Return how a run in lockstep under one command ends within some ticks."""
    for _ in range(ticks):
        loop.tick(Command(loop.car.stamp_ns, delta, 0.0, Fxf, Fxr))
        if loop.outcome:
            break
    return loop.outcome


def seconds(outcome):
    return (outcome.stamp_ns - START_NS) / 1e9


def test_lockstep_waits_for_the_command_to_its_own_stamp(params):
    loop = stepper(LockstepStepper, params)
    assert loop.is_due(START_NS)
    assert not loop.is_due(START_NS + TICK_NS)
    assert len(loop.tick(coast(START_NS)).rows) == TICK_STEPS
    assert not loop.is_due(START_NS)
    assert loop.is_due(START_NS + TICK_NS)
    # an unreadable one advances time, too
    assert len(loop.tick(None).rows) == TICK_STEPS


SLANTED = {'x_m': 30.0, 'y_m': 5.0, 'yaw_rad': 0.5}
BRAKED = {'Fxf': -3000.0, 'Fxr': -1500.0}


@pytest.mark.parametrize(
    ('stop', 'speed', 'forces', 'outcome', 'end_s'),
    [
        ({'x_m': 30.0}, 20.0, {}, (FINISHED, 'finish line crossed after 1.51'), 1.51),
        (SLANTED, 20.0, {}, (FINISHED, 'finish line crossed'), 1.65),
        ({'x_m': 30.0, 'yaw_rad': 3.14159}, 20.0, {}, None, 0.0),
        ({'x_m': 30.0, 'armed_after_m': 40.0}, 20.0, {}, None, 0.0),
        ({'x_m': 30.0, 'armed_after_m': 29.0}, 20.0, {}, (FINISHED, ''), 1.51),
        ({'time_s': 1.0}, 20.0, {}, (FAILED, 'finish line not reached within 1 s'), 1.0),
        ({}, 2.0, BRAKED, (FAILED, 'the car stands still'), 2.05),
        ({'standstill_s': 2.0}, 2.0, BRAKED, (FAILED, 'the car stands still'), 3.05),
        ({}, 0.0, {}, None, 0.0),  # has not moved
    ],
)
def test_a_run_ends(params, stop, speed, forces, outcome, end_s):
    end = run(stepper(LockstepStepper, params, speed, **stop), 80, **forces)
    if outcome is None:
        assert end is None
    else:
        assert end.exit_code == outcome[0]
        assert end.message.startswith(outcome[1])
        assert seconds(end) == pytest.approx(end_s, abs=0.1 if forces else 0.02)


ENDS = pytest.mark.parametrize(
    ('changed', 'code', 'latest_s'),
    [({'x_m': 3.0}, FINISHED, 0.2), ({'time_s': 0.5}, FAILED, 0.5), ({}, CONTROLLER_GONE, 6.0)],
    ids=['line', 'time', 'standstill'],
)


@ENDS
def test_a_run_whose_controller_stays_silent_ends(params, changed, code, latest_s):
    loop = stepper(LockstepStepper, params, **changed)
    run(loop, 1, 0.03, 0.0, 400.0)
    while not loop.outcome:
        loop.tick_without_controller()
    assert loop.outcome.exit_code == code
    assert seconds(loop.outcome) <= latest_s
    assert (abs(loop.car.state.vx) < 0.1) == (code == CONTROLLER_GONE)
    assert not loop.is_due(loop.car.stamp_ns)


def plan_after(stamp_ns, delta=0.05, ticks=20):
    """Return a plan that steers and brakes from the fourth tick after a command on."""
    t = 0.05 * np.arange(4, 4 + ticks)
    return StopPlan(stamp_ns, t, np.full(ticks, delta), -1500.0 - 100 * t, -900.0 + 0 * t)


def silent_in_lockstep(params, plan, ticks):
    """Return a stepper after a command, a silence of some ticks, and the rows meanwhile."""
    loop = stepper(LockstepStepper, params)
    run(loop, 1, 0.02)
    if plan is not None:
        loop.stop.keep(*plan)
    rows = [loop.tick_without_controller().rows for _ in range(ticks)]
    return loop, np.concatenate(rows)


def sent(plan, stamp_ns=START_NS):
    """Return what a plant keeps of a plan."""
    return stamp_ns, lambda: plan


def test_a_plan_is_followed_with_the_bits_of_commands_then_braked_straight(params):
    plan = plan_after(START_NS)
    loop, silent = silent_in_lockstep(params, sent(plan), 23)
    assert loop.stop.message == BRAKING
    told = stepper(LockstepStepper, params)
    run(told, 1, 0.02)
    held = [told.car.advance(None, TICK_STEPS).rows for _ in range(2)]
    points = zip(*(column.tolist() for column in plan[2:]))
    driven = [
        told.tick(Command(told.car.stamp_ns, delta, 0.0, Fxf, Fxr)).rows
        for delta, Fxf, Fxr in points
    ]
    told.car.brake_straight()
    driven.append(told.car.advance(None, TICK_STEPS).rows)
    assert silent.tobytes() == np.concatenate([*held, *driven]).tobytes()
    messages = [silent_in_lockstep(params, sent(plan), n)[0].stop.message for n in (2, 3, 22)]
    assert messages == [HOLDING, FOLLOWING, FOLLOWING]


def unreadable():
    raise DecodeError('no such joint')


REFUSED = f'{BRAKING}, the plan is refused:'


@pytest.mark.parametrize(
    ('plan', 'message'),
    [
        (None, BRAKING),
        (sent(plan_after(START_NS - TICK_NS), START_NS - TICK_NS), BRAKING),
        (sent(plan_after(START_NS + TICK_NS), START_NS + TICK_NS), BRAKING),
        ((START_NS, unreadable), f'{REFUSED} no such joint'),
        (
            sent(plan_after(START_NS, 0.6)),
            f'{REFUSED} steer is 0.6 rad, allowed -0.49 to 0.49',
        ),
        (
            sent(plan_after(START_NS)._replace(t=1.0 + np.arange(20))),
            f'{REFUSED} it begins 1 s after its command, allowed up to 0.35 s',
        ),
    ],
    ids=['none', 'older', 'newer', 'unreadable', 'impossible', 'late'],
)
def test_without_a_plan_that_can_be_followed_the_car_brakes_straight(params, plan, message):
    loop, rows = silent_in_lockstep(params, plan, 10)
    assert loop.stop.message == message
    straight = stepper(LockstepStepper, params)
    run(straight, 1, 0.02)
    held = straight.car.advance(None, 2 * TICK_STEPS).rows
    straight.car.brake_straight()
    braked = straight.car.advance(None, 8 * TICK_STEPS).rows
    assert rows.tobytes() == np.concatenate([held, braked]).tobytes()
    assert loop.car.gate.rejected == 0  # that counts commands


def step(loop, count):
    for _ in range(count):
        loop.advance_to(loop.car.stamp_ns + STEP_NS)


def tick(loop, count):
    for _ in range(count):
        loop.command(coast(loop.car.stamp_ns))
        step(loop, TICK_STEPS)


def silence(loop, ticks):
    step(loop, ticks * TICK_STEPS)


def catch_up(loop, steps):
    return loop.advance_to(loop.car.stamp_ns + steps * STEP_NS)


def test_realtime_catches_up_with_the_bits_of_one_stretch(params):
    late, whole = stepper(RealtimeStepper, params), stepper(RealtimeStepper, params)
    for loop in (late, whole):
        loop.command(Command(START_NS, 0.02, 0.0, -300.0, -200.0))
    track = whole.car.advance(None, 130)
    assert late.advance_to(START_NS) is None
    assert late.advance_to(START_NS + 130 * STEP_NS).rows.tobytes() == track.rows.tobytes()
    assert (late.missed_steps, late.longest_gap) == (129, 130)


@ENDS
def test_realtime_catches_up_no_further_than_the_end_of_the_run(params, changed, code, latest_s):
    """After minutes, as of a process that was stopped."""
    loop = stepper(RealtimeStepper, params, **changed)
    loop.command(coast(START_NS))
    now_ns = START_NS + 600_000 * STEP_NS
    track = loop.advance_to(now_ns)
    assert loop.outcome.exit_code == code
    assert 0 <= loop.car.stamp_ns - loop.outcome.stamp_ns < TICK_NS
    assert seconds(loop.outcome) <= latest_s
    assert (loop.missed_steps, loop.longest_gap) == (len(track.rows) - 1, 600_000)
    assert loop.advance_to(now_ns + STEP_NS) is None


def test_realtime_follows_a_plan_in_any_pieces_and_then_a_controller_that_returns(params):
    """Its command answers a state from before the set-points that are followed."""
    late, prompt = stepper(RealtimeStepper, params), stepper(RealtimeStepper, params)
    for loop in (late, prompt):
        loop.command(Command(START_NS, 0.02, 0.0, 0.0, 0.0))
        loop.stop.keep(*sent(plan_after(START_NS)))
        step(loop, 151)  # now it is silent
    assert prompt.stop.message == FOLLOWING
    step(prompt, 299)
    whole = late.advance_to(prompt.car.stamp_ns)
    assert whole.rows[-1] == pytest.approx(prompt.car.now.rows[0], rel=1e-9, abs=1e-9)
    assert prompt.car.actuators.delta == pytest.approx(0.05, abs=0.002)
    answered_ns = prompt.car.stamp_ns - 30 * STEP_NS
    prompt.command(coast(answered_ns))
    prompt.stop.keep(answered_ns, unreadable)
    assert (prompt.controller_gone, prompt.car.gate.rejected) == (False, 0)
    step(prompt, 140)
    assert prompt.car.actuators.delta == pytest.approx(0.0, abs=0.01)
    step(prompt, 100)  # silent again: the plan of the first silence is of no use any more
    assert prompt.stop.message == f'{REFUSED} no such joint'


def test_a_plan_that_is_due_later_is_awaited_under_the_held_command(params):
    """As of a command that takes effect 130 ms late: its first set-points are due after 330 ms."""
    plan = plan_after(START_NS)
    loop = stepper(RealtimeStepper, params)
    loop.command(Command(START_NS, 0.02, 0.0, 0.0, 0.0))
    loop.stop.keep(*sent(plan._replace(t=plan.t + 0.13)))
    step(loop, 151)
    assert (loop.controller_gone, loop.stop.message) == (True, HOLDING)
    step(loop, 129)  # until a tick before
    assert loop.car.actuators.delta == pytest.approx(0.02, abs=1e-4)
    step(loop, 1)
    assert loop.stop.message == FOLLOWING
    at_once, silent = silent_in_lockstep(params, sent(plan), 4)
    late, held = silent_in_lockstep(params, sent(plan._replace(t=plan.t + 0.03)), 4)
    assert len(held) == len(silent) == 4 * TICK_STEPS
    assert at_once.stop.message == late.stop.message == FOLLOWING


def test_the_plan_of_a_refused_command_does_not_replace_that_of_the_accepted_one(params):
    loop = stepper(RealtimeStepper, params)
    loop.command(Command(START_NS, 0.02, 0.0, 0.0, 0.0))
    loop.stop.keep(*sent(plan_after(START_NS)))
    for _ in range(3):
        step(loop, TICK_STEPS)
        stamp_ns = loop.car.stamp_ns
        loop.command(Command(stamp_ns, 1.0, 0.0, 0.0, 0.0))  # no car steers so far
        loop.stop.keep(*sent(plan_after(stamp_ns), stamp_ns))
    assert loop.car.gate.rejected == 3
    step(loop, TICK_STEPS)
    assert (loop.controller_gone, loop.stop.message) == (True, FOLLOWING)


def test_the_plan_of_the_first_command_counts_from_the_start_of_the_run(params):
    """That command answers a state of the held car from before the start."""
    sent_ns = START_NS - 30 * STEP_NS
    loop, told = stepper(RealtimeStepper, params), stepper(RealtimeStepper, params)
    loop.start(Command(sent_ns, 0.02, 0.0, 0.0, 0.0))
    loop.stop.keep(*sent(plan_after(sent_ns), sent_ns))
    told.command(Command(START_NS, 0.02, 0.0, 0.0, 0.0))
    told.stop.keep(*sent(plan_after(START_NS)))
    rows = [one.advance_to(START_NS + 500 * STEP_NS).rows for one in (loop, told)]
    assert loop.stop.message == FOLLOWING
    assert rows[0].tobytes() == rows[1].tobytes()


def test_realtime_ends_within_hundredths_of_the_line_and_names_its_millisecond(params):
    """It looks every 10 steps; the crossing that it reports is that of the row."""
    loop = stepper(RealtimeStepper, params, x_m=3.0)
    loop.command(coast(START_NS))
    rows = []
    while not loop.outcome:
        rows.append(loop.advance_to(loop.car.stamp_ns + STEP_NS))
    crossed = next(row for row in rows if row.column('planar.X')[0] >= 3.0)
    assert (loop.outcome.exit_code, loop.outcome.stamp_ns) == (FINISHED, crossed.stamp_ns[0])
    assert loop.car.stamp_ns - loop.outcome.stamp_ns < 10 * STEP_NS


def test_starts_are_taken_from_parameters_or_the_first_pose():
    X, Y, psi, t = np.array([(1.0, 4.0, 9.0), (2.0, 6.0, 6.0), (0.9, 0.5, 0.0), (0.0, 0.25, 1.0)])
    path = Reference(1, X, Y, psi, t)
    assert initial_state.start_from_reference(path) == (1.0, 2.0, 0.9, 20.0, 0.0, 0.0)
    raw, still = (ros.serialize(encode.reference(p)) for p in (path, path._replace(t=0 * t)))
    assert plant_node.read_start_path(raw).t.tolist() == path.t.tolist()
    with pytest.raises(DecodeError, match=r'no speed to start with.*start\.from: parameters'):
        plant_node.read_start_path(still)
    for share, speed in ((5.0, 100), (5.001, 100.02)):
        hasty = ros.serialize(encode.reference(path._replace(t=t / share)))
        if speed == 100:
            assert len(plant_node.read_start_path(hasty).t) == 3
        else:
            with pytest.raises(DecodeError, match=f'say a speed of {speed} m/s; allowed 0 to 100'):
                plant_node.read_start_path(hasty)
    own = parameters.StartParams(
        x_m=1.0, y_m=2.0, yaw_rad=0.3, speed_mps=4.0, lateral_mps=None, yaw_rate_radps=-0.5
    )
    assert initial_state.start_from_parameters(own) == (1.0, 2.0, 0.3, 4.0, 0.0, -0.5)


def refused(reason):
    return f'commands refused: {reason}'


SILENT, LATE = BRAKING, 'steps came late and were caught up'
too_far, reject = Command(START_NS, 9.0, 0.0, 0.0, 0.0), RealtimeStepper.reject
# what happens to a plant, one after the other, and its level and message after each
STORIES = {
    'well': [(tick, 10, OK, 'running')],
    'late command': [
        (tick, 1, OK, 'running'),
        (silence, 1, OK, 'running'),
        (step, 1, WARN, 'commands come late'),
    ],
    'silence is remembered after commands came again': [
        (silence, 4, ERROR, SILENT),
        (tick, 4, ERROR, SILENT),
        (tick, 45, OK, 'running'),
    ],
    'a refusal is remembered for two seconds': [
        (RealtimeStepper.command, too_far, WARN, refused('steer is 9 rad, allowed -0.49 to 0.49')),
        (reject, 'no steer', WARN, refused('no steer')),
        (tick, 34, WARN, refused('no steer')),
        (tick, 15, OK, 'running'),
    ],
    'late steps after a refusal': [
        (reject, 'no steer', WARN, refused('no steer')),
        (catch_up, 4, WARN, f'{refused("no steer")}; {LATE}'),
    ],
    'silence comes before the refusals that led to it': [
        (reject, 'no steer', WARN, refused('no steer')),
        (silence, 4, ERROR, f'{SILENT}; {refused("no steer")}'),
    ],
    'late steps': [(tick, 1, OK, 'running'), (catch_up, 4, WARN, LATE)],
}


@pytest.mark.parametrize('name', STORIES)
def test_health_names_every_cause_by_weight_and_remembers_it(params, name):
    loop = stepper(RealtimeStepper, params)
    monitor = HealthMonitor(loop)
    for happens, argument, level, message in STORIES[name]:
        happens(loop, argument)
        status = monitor.health(loop.car.stamp_ns)
        assert (status.name, status.level, status.message) == ('plant', level, message), happens


def test_a_command_ages_from_the_instant_at_which_it_is_due(params):
    loop, levels = stepper(RealtimeStepper, params), []
    loop.command(coast(START_NS))
    for after_ms in (50, 100, 101, 150, 151):
        loop.advance_to(START_NS + after_ms * STEP_NS)
        HealthMonitor(loop).health(loop.car.stamp_ns)
        levels.append(loop.command_monitor.held_level)
    assert levels == [OK, OK, WARN, WARN, ERROR]
    assert loop.controller_gone


def test_health_counts_what_it_names(params):
    loop = stepper(RealtimeStepper, params)
    loop.command(coast(START_NS))
    catch_up(loop, 5)
    loop.command(too_far._replace(stamp_ns=loop.car.stamp_ns))
    loop.reject('no steer')
    silence(loop, 1)
    values = HealthMonitor(loop).health(loop.car.stamp_ns).values
    expected = {
        'commands_rejected': 2,
        'last_rejection': 'no steer',
        'rejected.out_of_range': 1,
        'rejected.unreadable': 1,
        'missed_steps': 4,
        'longest_gap_steps': 5,
        'controller_gone': False,
        'age.command_ms': 5.0,
        'age.command_limit_ms': 100.0,
        'age.command_refused': 2,
    }
    assert {name: values[name] for name in expected} == expected
    silence(loop, 3)
    tick(loop, 1)
    values = HealthMonitor(loop).health(loop.car.stamp_ns).values
    assert (values['age.command_stale'], values['controller_gone']) == (1, False)


def test_in_lockstep_there_are_no_ages_and_nothing_is_missed(params):
    status = HealthMonitor(stepper(LockstepStepper, params)).health(START_NS)
    assert (status.level, status.values) == (
        OK,
        {
            'commands_rejected': 0,
            'last_rejection': 'none',
            'missed_steps': 0,
            'longest_gap_steps': 1,
            'controller_gone': False,
        },
    )


def test_before_its_run_the_plant_says_what_it_waits_for():
    status = health.waiting(START_NS, 'waiting for a command')
    assert (status.level, status.message) == (STALE, 'waiting for a command')
