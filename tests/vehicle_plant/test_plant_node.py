"""The node in this process: what it sends, how its run ends, what it says of mistakes.

In a process of its own, over DDS and on the wall clock: tests/ros.
"""

import importlib.util
import math
from dataclasses import replace

import node_bench
import numpy as np
import pytest
import rclpy
from drives import ahead, load
from node_ring import BEGIN_NS
from tyre_files import property_file
from wait_until import wait_until

from msgs_yaml import contract, decode, encode
from msgs_yaml.types import Command, Reference, StopPlan
from node_runtime import ros
from node_runtime.parameters import ParameterError
from vehicle_plant import parameters, road_friction, robot_description
from vehicle_plant.simulator import START_NS, STEP_NS, TICK_NS, Simulator

pytestmark = pytest.mark.ros
STATE, COMMAND = '/vehicle/odometry', '/controller/command'
SENT = (STATE, '/vehicle/actuators', '/vehicle/imu', '/vehicle/wheels')
ICE = [2.0, 0.0, 90.0, 0.0, 90.0, 9.0, 2.0, 9.0]
MOST = 100_000  # messages and timers of a run


class Drive:
    """A run of a plant in lockstep: every byte that it sends, and a controller's answers."""

    def __init__(self, bench, answer):
        """`answer(stamp_ns)` is the command to the first state of a tick, None for none."""
        self.bench, self.answer, self.answered_ns = bench, answer, 0
        self.sent = {topic: [] for topic in SENT}
        self.clocks, self.healths = [], []
        listeners = bench.bus.listeners
        for topic, kept in self.sent.items():
            listeners[topic] = [lambda raw, kept=kept: kept.append(bytes(raw))]
        listeners['/clock'] = [self.read('/clock', decode.clock, self.clocks.append)]
        listeners['/diagnostics'] = [self.read('/diagnostics', decode.health, self.healths.extend)]
        ros.publisher(bench.vehicle, COMMAND)  # the plant waits for one
        ros.subscribe(bench.vehicle, STATE, self.on_state, raw=True)

    def read(self, topic, decoded, keep):
        return lambda raw: keep(decoded(ros.deserialize(topic, raw)))

    def on_state(self, raw):
        stamp_ns = decode.stamp_ns_of(raw)
        if stamp_ns // TICK_NS == self.answered_ns // TICK_NS:
            return
        command = self.answer(stamp_ns)
        if command:
            self.answered_ns = stamp_ns
            self.send(COMMAND, command)

    def send(self, topic, message):
        node_bench.send(self.bench.node, topic, message)

    def state(self, which):
        return decode.odometry(ros.deserialize(STATE, self.sent[STATE][which]))

    def stamps(self, name):
        return [decode.stamp_ns_of(raw) for raw in self.sent[f'/vehicle/{name}']]


def run(answer, before=lambda drive: None, **settings):
    """Drive until the plant ends; return its exit code and the drive.

    Settings are parameters of the plant; `before(drive)` is called at the start.
    """
    given = {'start.from': 'parameters'} | settings
    with node_bench.running('plant', 'lockstep', **given) as bench:
        drive = Drive(bench, answer)
        before(drive)
        for _ in range(MOST):
            if getattr(bench.node, 'finished', False):
                return bench.node.exit_code, drive
            bench.bus.spin_once()
    raise AssertionError('the plant goes on')


def description(drive):
    """Return what the plant says of the car to whoever comes late, over DDS."""
    texts, node = [], drive.bench.vehicle
    ros.subscribe(node, '/robot_description', lambda message: texts.append(message.data))

    def work():
        rclpy.spin_once(node, timeout_sec=0.05)

    return wait_until(lambda: texts, 60.0, 'there is no description', pause=work)


def weave(stamp_ns):
    """Return a command that steers to and fro and pulls a little."""
    t = (stamp_ns - START_NS) / 1e9
    return encode.command(Command(stamp_ns, 0.03 * math.sin(3 * t), 0.0, -200.0, 300.0))


def brake(stamp_ns):
    return encode.command(Command(stamp_ns, 0.0, 0.0, -4000.0, -1500.0))


def test_it_sends_what_the_core_computes_every_millisecond_once_twice_the_same(tmp_path, capfd):
    """With car, tyre and road selected by parameters; to the finish line."""
    tyre_file, texts = tmp_path / 'my.tir', []
    tyre_file.write_text(property_file('tyre_book.yaml'))
    settings = {'patches.corners_m': ICE, 'patches.friction': [0.2], 'stop.x_m': 8.0}
    settings |= {'plant_params': 'vw_gti.yaml', 'tyre_set': tyre_file}
    (code, drive), (_, again) = (
        run(brake, lambda drive: texts.extend(description(drive)), **settings) for _ in range(2)
    )
    assert code == 0
    log = capfd.readouterr().err
    assert log.count('finish line crossed') == 2
    # where it is not installed, the log says so
    assert ('tf2_msgs is not installed' in log) != bool(importlib.util.find_spec('tf2_msgs'))
    assert drive.sent == again.sent

    odometry = drive.stamps('odometry')
    ticks = (odometry[-1] - START_NS) // TICK_NS
    assert odometry == list(range(START_NS, START_NS + ticks * TICK_NS + 1, STEP_NS))
    assert drive.stamps('actuators') == odometry
    rates = contract.load().topics
    slower = [rates[f'/vehicle/{name}'].rate_hz['lockstep'] for name in ('odometry', 'imu')]
    tenths = odometry[:: round(slower[0] / slower[1])]
    assert drive.stamps('imu') == drive.stamps('wheels') == tenths
    assert drive.clocks == [START_NS + i * TICK_NS for i in range(ticks + 1)]
    assert drive.healths[-1].level == 0
    assert drive.bench.bus.now_ns < BEGIN_NS + 1_000_000_000  # the last answer ends it at once
    assert texts == [robot_description.urdf(load('vw_gti.yaml').car)] * 2

    plant = replace(load('vw_gti.yaml'), tyre=parameters.load_tyre(str(tyre_file)))
    car = Simulator(plant, 1.0, ahead(20.0), patches=road_friction.patch_array(ICE, [0.2]))
    for i in range(ticks):
        car.advance(decode.command(brake(START_NS + i * TICK_NS)), 50)
    last = drive.state(-1)
    assert (last[:3], last[4:]) == (car.state[:3], car.state[4:])
    assert last.psi < -1e-4  # towards the side with grip


def until(tick, answer=weave):
    """Return the answers of a controller that falls silent after some ticks."""
    return lambda stamp_ns: answer(stamp_ns) if stamp_ns < START_NS + tick * TICK_NS else None


def test_a_silent_controller_is_braked_for_and_the_run_fails_so():
    code, drive = run(until(10), lockstep_timeout_s=0.5)
    assert (code, drive.healths[-1].level) == (3, 2)
    assert abs(drive.state(-1).vx) < 0.1


def test_a_last_state_that_nobody_answers_keeps_nobody():
    code, drive = run(until(10), lockstep_timeout_s=0.5, **{'stop.time_s': 0.5})
    assert (code, drive.healths[-1].level) == (2, 0)
    assert drive.stamps('odometry')[-1] == START_NS + 10 * TICK_NS


def test_the_log_says_once_why_the_plan_of_a_silent_controller_is_refused(capfd):
    """Plans that are followed: test_stepping.py."""
    drives, t = [], 0.05 * np.arange(4, 40)

    def answer(stamp_ns):
        plan = StopPlan(stamp_ns, t, 0.6 + 0 * t, -2000 - 0 * t, -1000 - 0 * t)
        drives[0].send('/controller/stop_plan', encode.stop_plan(plan))
        return weave(stamp_ns)

    code, drive = run(until(10, answer), drives.append, lockstep_timeout_s=1.0)
    assert (code, drive.healths[-1].level) == (3, 2)
    reason = 'the plan is refused: steer is 0.6 rad, allowed -0.49 to 0.49'
    assert drive.healths[-1].message.endswith(reason)
    assert capfd.readouterr().err.count(reason) == 1


def test_a_late_controller_gets_the_first_state_again_and_answers_the_last_one():
    asked = []

    def answer(stamp_ns):
        asked.append(stamp_ns)
        return weave(stamp_ns) if len(asked) > 1 else None

    code, drive = run(answer, **{'stop.x_m': 5.0})
    assert code == 0
    stamps = drive.stamps('odometry')
    assert stamps[:3] == [START_NS, START_NS, START_NS + STEP_NS]
    assert asked == [START_NS, *range(START_NS, stamps[-1] + 1, TICK_NS)]


def misnamed(msg):
    msg.name[0] = 'wheel'


def too_far(msg):
    msg.position[0] = 0.6


@pytest.mark.parametrize(
    ('damage', 'kind', 'message'),
    [
        (misnamed, 'unreadable', 'name is 3 long: wheel'),
        (too_far, 'out_of_range', 'steer is 0.6 rad'),
    ],
)
def test_refused_commands_are_logged_once_and_named_by_the_health(capfd, damage, kind, message):
    def broken(stamp_ns):
        msg = weave(stamp_ns)
        if START_NS < stamp_ns < START_NS + 8 * TICK_NS:
            damage(msg)
        return msg

    code, drive = run(broken, **{'stop.x_m': 12.0})
    log, health = capfd.readouterr().err, drive.healths[-1]
    assert code == 0
    assert log.count(f'{COMMAND} rejected ({kind})') == 1
    assert message in log
    assert (health.level, health.values['commands_rejected']) == (1, 7)
    assert health.message.startswith('commands refused: ')
    assert message in health.message


def test_car_starts_at_the_first_pose_of_the_path(capfd):
    X, t = np.array([3.0, 13.0]), np.array([0.0, 1.0])
    path = encode.reference(Reference(START_NS, X, np.full(2, -2.0), np.zeros(2), t))

    def with_path(drive):
        for _ in range(20):  # it waits for the path
            drive.bench.bus.spin_once()
        assert not drive.sent[STATE]
        drive.send('/scenario/reference', path)

    settings = {'start.from': 'reference', 'imu_wheels_period_ms': 1, 'publish_tf': False}
    _, drive = run(weave, with_path, **settings, **{'stop.time_s': 0.5})
    assert drive.state(0) == (START_NS, 3.0, -2.0, 0.0, 10.0, 0.0, 0.0)
    # on request imu and wheels come with every step
    assert drive.stamps('imu') == drive.stamps('wheels') == drive.stamps('odometry')
    assert 'tf2_msgs' not in capfd.readouterr().err  # nobody asked for /tf


@pytest.mark.parametrize(
    ('name', 'value', 'message'),
    [
        ('start.from', 'nowhere', 'start.from is .nowhere.; allowed'),
        ('plant_params', 'nobody.yaml', 'nobody.yaml'),
        ('tyre_set', '/nowhere/my.tir', '/nowhere/my.tir'),
        ('patches.friction', [0.5], 'patches: '),
    ],
)
def test_a_parameter_that_makes_no_sense_stops_the_node(name, value, message):
    with pytest.raises(ParameterError, match=message):
        run(weave, **{name: value})


def test_on_the_wall_clock_only_an_answer_to_a_state_of_the_last_two_seconds_starts_the_car():
    with node_bench.running('plant', 'realtime', **{'start.from': 'parameters'}) as bench:
        ros.publisher(bench.vehicle, COMMAND)  # the plant waits for one
        mode, spin = bench.node.mode, bench.bus.spin_once
        wait_until(lambda: mode.held_ns, 60.0, 'no state is held', pause=spin)
        first, begin_ns = mode.held_ns[0], bench.bus.now_ns
        node_bench.send(bench.node, COMMAND, node_bench.command(first + 1))
        assert mode.stepper is None
        wait_until(lambda: first not in mode.held_ns, 60.0, 'it is answerable', pause=spin)
        assert bench.bus.now_ns - begin_ns == pytest.approx(2e9, rel=0.05)
        node_bench.send(bench.node, COMMAND, node_bench.command(first))
        assert mode.stepper is None
        node_bench.send(bench.node, COMMAND, node_bench.command(mode.held_ns[-1]))
        assert mode.stepper is not None
