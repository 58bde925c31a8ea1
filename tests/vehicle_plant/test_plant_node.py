"""The node over real DDS: a test controller answers states, the plant drives."""

import math
import time

import numpy as np
import pytest
from plant_process import Controller, run, weave

from msgs_yaml import contract, decode
from vehicle_plant.simulator import START_NS, STEP_NS, TICK_NS, Simulator, Start

pytestmark = pytest.mark.ros


def test_lockstep_sends_every_millisecond_once_and_ends_at_the_finish_line(params):
    done = run(20, weave, **{'stop.x_m': 25.0})
    assert done.exit_code == 0, done.log
    assert 'finish line crossed' in done.log
    odometry = done.controller.stamps('odometry')
    ticks = (odometry[-1] - START_NS) // TICK_NS
    assert odometry == list(range(START_NS, START_NS + ticks * TICK_NS + 1, STEP_NS))
    assert done.controller.stamps('actuators') == odometry
    tenths = odometry[:: contract_ratio('/vehicle/odometry', '/vehicle/imu')]
    assert done.controller.stamps('imu') == tenths
    assert done.controller.stamps('wheels') == tenths
    assert done.controller.clocks == [START_NS + i * TICK_NS for i in range(ticks + 1)]
    assert done.controller.healths[-1].level == 0

    # what was sent is what the core computes
    car = Simulator(params, 1.0, Start(0.0, 0.0, 0.0, 20.0))
    for i in range(ticks):
        car.advance(decode.command(weave(START_NS + i * TICK_NS)), 50)
    last = done.controller.state(-1)
    assert last[:3] == car.state[:3]
    assert last[4:] == car.state[4:]


def contract_ratio(fast, slow):
    topics = contract.load().topics
    return round(topics[fast].rate_hz['lockstep'] / topics[slow].rate_hz['lockstep'])


def test_lockstep_twice_gives_the_same_bytes():
    first, second = (run(21, weave, **{'stop.x_m': 15.0}).controller.received for _ in range(2))
    assert first == second
    assert len(first['odometry']) > 500


def test_controller_that_falls_silent_is_braked_for_and_named_by_the_exit_code():
    def silent_after_half_a_second(stamp_ns):
        return weave(stamp_ns) if stamp_ns < START_NS + 10 * TICK_NS else None

    done = run(22, silent_after_half_a_second, lockstep_timeout_s=1.0)
    assert done.exit_code == 3, done.log
    last = done.controller.state(-1)
    assert abs(last.vx) < 0.1
    assert done.controller.healths[-1].level == 2


def test_late_controller_gets_the_first_state_again():
    asked = []

    def answers_late(stamp_ns):
        asked.append(stamp_ns)
        return weave(stamp_ns)

    def deaf_at_first(controller):
        controller.on_state = lambda stamp_ns: (
            controller.received['odometry'].__len__() > 1
            and Controller.on_state(controller, stamp_ns)
        )

    done = run(23, answers_late, before=deaf_at_first, **{'stop.x_m': 5.0})
    assert done.exit_code == 0, done.log
    assert done.controller.stamps('odometry')[:3] == [START_NS, START_NS, START_NS + STEP_NS]


def test_run_that_takes_too_long_fails():
    done = run(24, weave, **{'stop.time_s': 0.5})
    assert done.exit_code == 2, done.log


def test_command_that_is_not_finite_is_refused_and_the_last_one_held():
    def broken_once(stamp_ns):
        msg = weave(stamp_ns)
        if stamp_ns == START_NS + 4 * TICK_NS:
            msg.position[0] = math.nan
        return msg

    done = run(25, broken_once, **{'stop.x_m': 25.0})
    assert done.exit_code == 0, done.log
    assert done.controller.healths[-1].values['commands_rejected'] == 1
    assert done.controller.healths[-1].level == 1


def test_realtime_keeps_pace_with_the_wall_clock():
    begun = time.monotonic()
    done = run(28, weave, mode='realtime', **{'stop.x_m': 30.0})
    assert done.exit_code == 0, done.log
    assert time.monotonic() - begun > 1.5
    stamps = np.unique(done.controller.stamps('odometry'))
    # best effort and a slow test controller: most arrive, none between the milliseconds
    assert (np.diff(stamps) % STEP_NS == 0).all()
    assert abs(time.time_ns() - stamps[-1]) < 20e9
