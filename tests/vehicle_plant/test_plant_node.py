"""The node over real DDS: a test controller answers states, the plant drives."""

import math
import time

import numpy as np
import pytest
from plant_process import Controller, run, weave
from scipy.integrate import trapezoid

from msgs_yaml import contract, decode
from vehicle_plant.initial_state import Start
from vehicle_plant.simulator import START_NS, STEP_NS, TICK_NS, Simulator

pytestmark = pytest.mark.usefixtures('domain')
CLOCKS_DIFFER_S = 0.01  # the node starts from the wall clock and goes on with the steady one
BEHIND_S = 0.1  # of 1.5 s; at three times or a third of the pace it is 0.7 s and more


def test_lockstep_sends_every_millisecond_once_and_ends_at_the_finish_line(params):
    done = run(weave, **{'stop.x_m': 25.0})
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
    first, second = (run(weave, **{'stop.x_m': 15.0}).controller.received for _ in range(2))
    assert first == second
    assert len(first['odometry']) > 500


def test_controller_that_falls_silent_is_braked_for_and_named_by_the_exit_code():
    def silent_after_half_a_second(stamp_ns):
        return weave(stamp_ns) if stamp_ns < START_NS + 10 * TICK_NS else None

    done = run(silent_after_half_a_second, lockstep_timeout_s=1.0)
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

    done = run(answers_late, before=deaf_at_first, **{'stop.x_m': 5.0})
    assert done.exit_code == 0, done.log
    assert done.controller.stamps('odometry')[:3] == [START_NS, START_NS, START_NS + STEP_NS]


def test_the_last_state_is_answered_before_the_plant_ends():
    plants = []  # publishers of the state, at each answer

    def answers_late(stamp_ns):
        time.sleep(0.05)
        plants.append(controllers[0].count_publishers('/vehicle/odometry'))
        return weave(stamp_ns)

    controllers = []
    done = run(answers_late, before=controllers.append, **{'stop.x_m': 5.0})
    assert done.exit_code == 0, done.log
    assert set(plants) == {1}
    assert len(plants) == 1 + (done.controller.stamps('odometry')[-1] - START_NS) // TICK_NS


def test_a_last_state_that_nobody_answers_does_not_keep_the_plant():
    def silent_at_the_end(stamp_ns):
        return weave(stamp_ns) if stamp_ns < START_NS + 10 * TICK_NS else None

    done = run(silent_at_the_end, lockstep_timeout_s=1.0, **{'stop.time_s': 0.5})
    assert done.exit_code == 2, done.log
    assert done.controller.stamps('odometry')[-1] == START_NS + 10 * TICK_NS


def test_run_that_takes_too_long_fails():
    done = run(weave, **{'stop.time_s': 0.5})
    assert done.exit_code == 2, done.log


def test_command_that_is_not_finite_is_refused_and_the_last_one_held():
    def broken_once(stamp_ns):
        msg = weave(stamp_ns)
        if stamp_ns == START_NS + 4 * TICK_NS:
            msg.position[0] = math.nan
        return msg

    done = run(broken_once, **{'stop.x_m': 25.0})
    assert done.exit_code == 0, done.log
    assert done.controller.healths[-1].values['commands_rejected'] == 1
    assert done.controller.healths[-1].level == 1
    assert done.log.count('/controller/command rejected') == 1


def test_commands_with_wrong_names_are_logged_once_and_named_by_the_health():
    def misnamed(stamp_ns):
        msg = weave(stamp_ns)
        if START_NS < stamp_ns < START_NS + 12 * TICK_NS:
            msg.name[0] = 'wheel'
        return msg

    done = run(misnamed, **{'stop.x_m': 25.0})
    assert done.exit_code == 0, done.log
    assert done.log.count('/controller/command rejected (unreadable)') == 1
    assert 'name is 3 long: wheel' in done.log
    assert done.controller.healths[-1].message.startswith('commands refused: /controller/command')


@pytest.mark.alone
def test_realtime_keeps_pace_with_the_wall_clock():
    done = run(weave, mode='realtime', **{'stop.x_m': 30.0})
    assert done.exit_code == 0, done.log
    states = [done.controller.state(k) for k in range(len(done.controller.arrived_ns))]
    stamps = np.array([state.stamp_ns for state in states])
    # best effort and a slow test controller: most arrive, none between the milliseconds
    assert (np.diff(stamps) % STEP_NS == 0).all()
    # the stamps follow the wall clock: no state is sent before its time, nor ever later
    late_s = (np.array(done.controller.arrived_ns) - stamps) / 1e9
    assert late_s.min() > -CLOCKS_DIFFER_S
    first, last = np.array_split(late_s, 2)
    assert abs(last.min() - first.min()) < BEHIND_S
    # and the car moves as long as its stamps say
    driven = [state for state in states if state.X > states[0].X]
    X, Y, vx, vy, t = np.array([(s.X, s.Y, s.vx, s.vy, s.stamp_ns / 1e9) for s in driven]).T
    assert t[-1] - t[0] > 1.0
    way_m = np.hypot(np.diff(X), np.diff(Y)).sum()
    assert trapezoid(np.hypot(vx, vy), t) == pytest.approx(way_m, rel=0.01)
