"""When the plant advances, when a run ends, and what a silent controller brings about."""

from dataclasses import replace

import pytest

from msgs_yaml import encode
from msgs_yaml.decode import DecodeError
from msgs_yaml.types import Command
from node_runtime import ros
from vehicle_plant import initial_state, parameters, plant_node
from vehicle_plant.initial_state import Start
from vehicle_plant.parameters import StopParams
from vehicle_plant.run_end import CONTROLLER_GONE, FAILED, FINISHED, RunEnd
from vehicle_plant.simulator import START_NS, STEP_NS, TICK_NS, TICK_STEPS, Simulator
from vehicle_plant.stepping import LockstepStepper, RealtimeStepper

FAR = StopParams(
    x_m=1000.0, y_m=0.0, yaw_rad=0.0, armed_after_m=0.0, time_s=60.0, standstill_s=None
)


def stepper(kind, params, stop=FAR, speed=20.0):
    car = Simulator(params, 1.0, Start(0.0, 0.0, 0.0, speed))
    return kind(car, RunEnd(stop, car.now))


def coast(stamp_ns):
    return Command(stamp_ns, 0.0, 0.0, 0.0, 0.0)


def run(loop, ticks):
    for _ in range(ticks):
        loop.tick(coast(loop.car.stamp_ns))
        if loop.outcome:
            return loop.outcome
    return None


def test_lockstep_waits_for_the_command_to_its_own_stamp(params):
    loop = stepper(LockstepStepper, params)
    assert loop.is_due(START_NS)
    assert not loop.is_due(START_NS + TICK_NS)
    assert len(loop.tick(coast(START_NS)).rows) == TICK_STEPS
    assert not loop.is_due(START_NS)
    assert loop.is_due(START_NS + TICK_NS)


def test_finish_line_ends_the_run_at_the_millisecond(params):
    outcome = run(stepper(LockstepStepper, params, replace(FAR, x_m=30.0)), 100)
    assert outcome.exit_code == FINISHED
    assert (outcome.stamp_ns - START_NS) / 1e9 == pytest.approx(30.0 / 19.9, abs=0.02)


def test_finish_line_counts_only_in_its_direction_and_once_armed(params):
    assert (
        run(stepper(LockstepStepper, params, replace(FAR, x_m=30.0, yaw_rad=3.14159)), 60) is None
    )
    assert (
        run(stepper(LockstepStepper, params, replace(FAR, x_m=30.0, armed_after_m=40.0)), 60)
        is None
    )


def test_run_fails_when_its_time_is_up(params):
    outcome = run(stepper(LockstepStepper, params, replace(FAR, time_s=1.0)), 100)
    assert outcome.exit_code == FAILED
    assert outcome.stamp_ns == START_NS + 1_000_000_000


def test_run_fails_when_the_car_has_stopped_but_not_before_it_moved(params):
    loop = stepper(LockstepStepper, params, speed=0.0)
    assert run(loop, 40) is None
    loop = stepper(LockstepStepper, params, speed=2.0)
    for _ in range(80):
        loop.tick(Command(loop.car.stamp_ns, 0.0, 0.0, -4000.0, -2000.0))
        if loop.outcome:
            break
    assert loop.outcome.exit_code == FAILED
    assert 'stands still' in loop.outcome.message


def test_silent_controller_is_held_for_two_ticks_then_braked_straight(params):
    loop = stepper(LockstepStepper, params)
    for _ in range(10):
        loop.tick(Command(loop.car.stamp_ns, 0.03, 0.0, 0.0, 400.0))
    for _ in range(2):
        loop.tick_without_controller()
    assert loop.car.actuators.delta == pytest.approx(0.03, abs=1e-4)
    assert loop.car.actuators.Fxr == pytest.approx(400.0, abs=2.0)
    while not loop.outcome:
        loop.tick_without_controller()
    assert loop.outcome.exit_code == CONTROLLER_GONE
    assert abs(loop.car.state.vx) < 0.1
    assert abs(loop.car.actuators.delta) < 1e-4
    assert not loop.is_due(loop.car.stamp_ns)


def test_realtime_takes_the_steps_that_are_due_and_counts_the_late_ones(params):
    loop = stepper(RealtimeStepper, params)
    loop.command(coast(START_NS))
    assert loop.advance_to(START_NS) is None
    assert len(loop.advance_to(START_NS + STEP_NS).rows) == 1
    assert loop.missed_steps == 0
    assert len(loop.advance_to(START_NS + 5 * STEP_NS).rows) == 4
    assert (loop.missed_steps, loop.longest_gap) == (3, 4)
    assert loop.car.stamp_ns == START_NS + 5 * STEP_NS


def test_realtime_catches_up_with_the_bits_of_one_stretch(params):
    late, whole = stepper(RealtimeStepper, params), stepper(RealtimeStepper, params)
    now_ns = START_NS + 130 * STEP_NS
    for loop in (late, whole):
        loop.command(Command(START_NS, 0.02, 0.0, -300.0, -200.0))
    track = whole.car.advance(None, 130)
    assert late.advance_to(now_ns).rows.tobytes() == track.rows.tobytes()
    assert (late.missed_steps, late.longest_gap) == (129, 130)


@pytest.mark.parametrize(
    ('changed', 'code', 'latest_s'),
    [({'x_m': 3.0}, FINISHED, 0.2), ({'time_s': 0.5}, FAILED, 0.5), ({}, CONTROLLER_GONE, 6.0)],
    ids=['line', 'time', 'standstill'],
)
def test_realtime_catches_up_no_further_than_the_end_of_the_run(params, changed, code, latest_s):
    """After minutes, as of a process that was stopped."""
    loop = stepper(RealtimeStepper, params, replace(FAR, **changed))
    loop.command(coast(START_NS))
    now_ns = START_NS + 600_000 * STEP_NS
    track = loop.advance_to(now_ns)
    assert loop.outcome.exit_code == code
    assert 0 <= loop.car.stamp_ns - loop.outcome.stamp_ns < TICK_NS
    assert (loop.outcome.stamp_ns - START_NS) / 1e9 <= latest_s
    assert (loop.missed_steps, loop.longest_gap) == (len(track.rows) - 1, 600_000)
    assert loop.advance_to(now_ns + STEP_NS) is None


def test_realtime_brakes_when_silent_and_follows_again_when_spoken_to(params):
    loop = stepper(RealtimeStepper, params)
    loop.command(Command(START_NS, 0.02, 0.0, 0.0, 0.0))
    now = START_NS
    for _ in range(150):
        now += STEP_NS
        loop.advance_to(now)
    assert not loop.controller_gone
    for _ in range(100):
        now += STEP_NS
        loop.advance_to(now)
    assert loop.controller_gone
    assert loop.car.actuators.Fxf < -2500
    loop.command(Command(now, 0.0, 0.0, 0.0, 0.0))
    assert not loop.controller_gone
    for _ in range(140):
        now += STEP_NS
        loop.advance_to(now)
    assert loop.car.actuators.Fxf > -1500


def test_realtime_ends_with_its_own_code_when_the_silent_controller_does_not_come_back(params):
    loop = stepper(RealtimeStepper, params, speed=5.0)
    loop.command(coast(START_NS))
    while not loop.outcome:
        loop.advance_to(loop.car.stamp_ns + 10 * STEP_NS)
        assert loop.car.stamp_ns < START_NS + 10_000_000_000
    assert loop.outcome.exit_code == CONTROLLER_GONE
    assert loop.controller_gone


def test_realtime_ends_within_hundredths_of_the_line_and_names_its_millisecond(params):
    """It looks every 10 steps; the crossing that it reports is that of the row."""
    loop = stepper(RealtimeStepper, params, replace(FAR, x_m=3.0))
    loop.command(coast(START_NS))
    rows = []
    while not loop.outcome:
        rows.append(loop.advance_to(loop.car.stamp_ns + STEP_NS))
    crossed = next(row for row in rows if row.column('planar.X')[0] >= 3.0)
    assert loop.outcome.exit_code == FINISHED
    assert loop.outcome.stamp_ns == crossed.stamp_ns[0]
    assert loop.car.stamp_ns - loop.outcome.stamp_ns < 10 * STEP_NS


def test_starts_are_taken_from_parameters_or_the_first_pose():
    import numpy as np

    from msgs_yaml.types import Reference

    path = Reference(
        1,
        np.array([1.0, 4.0, 9.0]),
        np.array([2.0, 6.0, 6.0]),
        np.array([0.9, 0.5, 0.0]),
        np.array([0.0, 0.25, 1.0]),
    )
    assert initial_state.start_from_reference(path)[:4] == (1.0, 2.0, 0.9, 20.0)
    raw, still = (ros.serialize(encode.reference(p)) for p in (path, path._replace(t=path.t * 0)))
    assert plant_node.read_start_path(raw).t.tolist() == path.t.tolist()
    with pytest.raises(DecodeError, match=r'no speed to start with.*start\.from: parameters'):
        plant_node.read_start_path(still)
    own = parameters.StartParams(
        x_m=1.0, y_m=2.0, yaw_rad=0.3, speed_mps=4.0, lateral_mps=None, yaw_rate_radps=-0.5
    )
    assert initial_state.start_from_parameters(own) == (1.0, 2.0, 0.3, 4.0, 0.0, -0.5)
