"""The node over real DDS: a test controller answers states, the plant drives."""

import importlib.util
import math
import subprocess
import sys
import time
from contextlib import contextmanager
from dataclasses import replace

import numpy as np
import pytest
import rclpy
from drives import ahead, load
from rclpy.experimental import EventsExecutor
from rclpy.node import Node
from rclpy.task import Future
from scipy.integrate import trapezoid
from tyre_files import property_file
from wait_until import wait_until

from msgs_yaml import contract, decode, encode
from msgs_yaml.types import Command, Reference, StopPlan
from node_runtime import ros
from node_runtime.parameters import ParameterError
from vehicle_plant import parameters as plant_parameters
from vehicle_plant import road_friction, robot_description
from vehicle_plant.plant_node import PlantNode
from vehicle_plant.simulator import START_NS, STEP_NS, TICK_NS, Simulator

pytestmark = pytest.mark.usefixtures('domain')
CLOCKS_DIFFER_S = 0.01  # the node starts from the wall clock and goes on with the steady one
SECONDS = 120
BEHIND_S = 0.1  # of 1.5 s; at three times or a third of the pace it is 0.7 s and more
ICE = [2.0, 0.0, 90.0, 0.0, 90.0, 9.0, 2.0, 9.0]


class Controller(Node):
    """Answers the state at every boundary; keeps every byte that it receives."""

    def __init__(self, mode, answer):
        super().__init__('controller', use_global_arguments=False)
        self.declare_parameter('mode', mode)
        self.answer = answer
        self.received = {name: [] for name in ('odometry', 'actuators', 'imu', 'wheels')}
        self.arrived_ns = []  # wall time of every odometry
        self.clocks, self.healths, self.descriptions = [], [], []
        self.answered_ns = 0
        self.command_pub = ros.publisher(self, '/controller/command')
        for name in self.received:
            ros.subscribe(self, f'/vehicle/{name}', self.keep(name), raw=True)
        ros.subscribe(self, '/clock', lambda msg: self.clocks.append(decode.clock(msg)))
        ros.subscribe(self, '/diagnostics', lambda msg: self.healths.extend(decode.health(msg)))
        ros.subscribe(self, '/robot_description', lambda msg: self.descriptions.append(msg.data))

    def keep(self, name):
        def on_message(raw):
            self.received[name].append(bytes(raw))
            if name == 'odometry':
                self.arrived_ns.append(time.time_ns())
                self.on_state(decode.stamp_ns_of(raw))

        return on_message

    def on_state(self, stamp_ns):
        if stamp_ns // TICK_NS == self.answered_ns // TICK_NS:
            return
        command = self.answer(stamp_ns)
        self.answered_ns = stamp_ns
        if command:
            self.command_pub.publish(command)

    def has_heard_the_end(self, plant):
        """Return whether the health at the end has arrived, which is sent last."""
        return self.healths[-1].stamp_ns == plant.mode.stepper.car.stamp_ns

    def state(self, which):
        return decode.odometry(
            ros.deserialize('/vehicle/odometry', self.received['odometry'][which])
        )

    def stamps(self, name):
        return [decode.stamp_ns_of(raw) for raw in self.received[name]]


def arguments(mode='lockstep', **settings):
    values = {'mode': mode, 'start.from': 'parameters'} | settings
    return [
        '--ros-args',
        *(w for name, value in values.items() for w in ('-p', f'{name}:={value}')),
    ]


@contextmanager
def parameters(mode='lockstep', **settings):
    """Give nodes of this process the parameters of a plant."""
    rclpy.init(args=arguments(mode, **settings))
    try:
        yield
    finally:
        rclpy.shutdown()


def spin(nodes, until):
    """Spin nodes of this process."""
    executor = EventsExecutor()
    for node in nodes:
        executor.add_node(node)
    try:
        wait_until(
            until,
            SECONDS,
            'the plant goes on',
            pause=lambda: executor.spin_until_future_complete(Future(), timeout_sec=0.05),
        )
    finally:
        for node in nodes:
            executor.remove_node(node)
            node.destroy_node()


def run(answer, mode='lockstep', before=lambda controller: None, **settings):
    """Drive until the plant ends; return its exit code, and the controller with what it received.

    Settings are parameters of the plant, `answer(stamp_ns)` are the commands.
    """
    with parameters(mode, **settings):
        controller = Controller(mode, answer)
        before(controller)
        plant = PlantNode()
        plant.finished = False
        plant.start()
        spin([plant, controller], lambda: plant.finished and controller.has_heard_the_end(plant))
        return plant.exit_code, controller


def drive_process(answer, mode, **settings):
    """Drive as `run` does, with a plant in a process of its own."""
    command = [sys.executable, '-m', 'vehicle_plant.plant_node', *arguments(mode, **settings)]
    with parameters(mode), subprocess.Popen(command) as plant:
        try:
            controller = Controller(mode, answer)
            spin([controller], lambda: plant.poll() is not None)
        finally:
            plant.kill()
        return plant.returncode, controller


def weave(stamp_ns):
    """Return a command that steers to and fro and pulls a little."""
    t = (stamp_ns - START_NS) / 1e9
    return encode.command(Command(stamp_ns, 0.03 * math.sin(3 * t), 0.0, -200.0, 300.0))


def brake(stamp_ns):
    return encode.command(Command(stamp_ns, 0.0, 0.0, -4000.0, -1500.0))


def test_lockstep_sends_what_the_core_computes_every_millisecond_once_twice_the_same(
    tmp_path, capfd
):
    """With car, tyre and road selected by parameters; to the finish line."""
    tyre_file = tmp_path / 'my.tir'
    tyre_file.write_text(property_file('tyre_book.yaml'))
    settings = {'patches.corners_m': ICE, 'patches.friction': [0.2], 'stop.x_m': 8.0}
    settings |= {'plant_params': 'vw_gti.yaml', 'tyre_set': tyre_file}
    runs = [run(brake, **settings) for _ in range(2)]
    (code, controller), (_, again) = runs
    assert code == 0
    log = capfd.readouterr().err
    assert log.count('finish line crossed') == 2
    # where it is not installed, the log says so
    assert ('tf2_msgs is not installed' in log) != bool(importlib.util.find_spec('tf2_msgs'))
    assert controller.received == again.received

    odometry = controller.stamps('odometry')
    ticks = (odometry[-1] - START_NS) // TICK_NS
    assert odometry == list(range(START_NS, START_NS + ticks * TICK_NS + 1, STEP_NS))
    assert controller.stamps('actuators') == odometry
    rates = contract.load().topics
    slower = [rates[f'/vehicle/{name}'].rate_hz['lockstep'] for name in ('odometry', 'imu')]
    tenths = odometry[:: round(slower[0] / slower[1])]
    assert controller.stamps('imu') == controller.stamps('wheels') == tenths
    assert controller.clocks == [START_NS + i * TICK_NS for i in range(ticks + 1)]
    assert controller.healths[-1].level == 0
    assert controller.descriptions == [robot_description.urdf(load('vw_gti.yaml').car)]

    plant = replace(load('vw_gti.yaml'), tyre=plant_parameters.load_tyre(str(tyre_file)))
    ice = road_friction.patch_array(ICE, [0.2])
    car = Simulator(plant, 1.0, ahead(20.0), patches=ice)
    for i in range(ticks):
        car.advance(decode.command(brake(START_NS + i * TICK_NS)), 50)
    last = controller.state(-1)
    assert (last[:3], last[4:]) == (car.state[:3], car.state[4:])
    assert last.psi < -1e-4  # towards the side with grip


@pytest.mark.parametrize(
    ('answered', 'settings', 'code', 'level'),
    [
        pytest.param(10, {'lockstep_timeout_s': 0.5}, 3, 2, id='silent'),
        pytest.param(10, {'lockstep_timeout_s': 0.5, 'stop.time_s': 0.5}, 2, 0, id='silent at end'),
        pytest.param(99, {'stop.time_s': 0.5}, 2, 0, id='time limit'),
    ],
)
def test_a_run_that_fails_has_its_exit_code(answered, settings, code, level):
    """A silent controller is braked for; a last state that nobody answers keeps nobody."""

    def silent_later(stamp_ns):
        return weave(stamp_ns) if stamp_ns < START_NS + answered * TICK_NS else None

    exit_code, controller = run(silent_later, **settings)
    assert (exit_code, controller.healths[-1].level) == (code, level)
    if code == 3:
        assert abs(controller.state(-1).vx) < 0.1
    else:
        assert controller.stamps('odometry')[-1] == START_NS + 10 * TICK_NS


def run_until_silent(delta):
    """Return exit code and controller of a run whose commands end; their plans steer by delta."""
    pubs = []

    def silent_later(stamp_ns):
        t = 0.05 * np.arange(4, 40)
        plan = StopPlan(stamp_ns, t, delta + 0 * t, -2000 - 0 * t, -1000 - 0 * t)
        if stamp_ns >= START_NS + 10 * TICK_NS:
            return None
        pubs[0].publish(encode.stop_plan(plan))
        return encode.command(Command(stamp_ns, 0.0, 0.0, 0.0, 0.0))

    def with_plans(controller):
        pubs.append(ros.publisher(controller, '/controller/stop_plan'))

    return run(silent_later, before=with_plans, lockstep_timeout_s=1.0)


def test_the_log_says_once_why_a_plan_is_refused(capfd):
    exit_code, controller = run_until_silent(0.6)
    assert (exit_code, controller.healths[-1].level) == (3, 2)
    reason = 'the plan is refused: steer is 0.6 rad, allowed -0.49 to 0.49'
    assert controller.healths[-1].message.endswith(reason)
    assert capfd.readouterr().err.count(reason) == 1


def test_a_silent_controller_is_replaced_by_the_plan_of_its_last_command():
    exit_code, controller = run_until_silent(0.05)
    assert exit_code == 3
    actuators = [
        decode.actuators(ros.deserialize('/vehicle/actuators', raw))
        for raw in controller.received['actuators']
    ]
    steered = [a.stamp_ns for a in actuators if a.delta > 0.04]
    # the set-points of the plan hold from the 13th to the 48th tick; the servo lags by one
    assert START_NS + 12 * TICK_NS < steered[0] < START_NS + 15 * TICK_NS
    assert START_NS + 48 * TICK_NS < steered[-1] < START_NS + 52 * TICK_NS
    assert abs(controller.state(-1).vx) < 0.1


def test_a_late_controller_gets_the_first_state_again_and_answers_the_last_one():
    answers = []

    def deaf_at_first(controller):
        controller.on_state = lambda stamp_ns: (
            len(controller.received['odometry']) > 1 and Controller.on_state(controller, stamp_ns)
        )

    def answer(stamp_ns):
        answers.append(stamp_ns)
        return weave(stamp_ns)

    code, controller = run(answer, before=deaf_at_first, **{'stop.x_m': 5.0})
    assert code == 0
    stamps = controller.stamps('odometry')
    assert stamps[:3] == [START_NS, START_NS, START_NS + STEP_NS]
    assert answers == list(range(START_NS, stamps[-1] + 1, TICK_NS))


def with_nan(msg):
    msg.position[0] = math.nan


def misnamed(msg):
    msg.name[0] = 'wheel'


def too_far(msg):
    msg.position[0] = 0.6


@pytest.mark.parametrize(
    ('damage', 'kind', 'message'),
    [
        (with_nan, 'unreadable', ''),
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

    code, controller = run(broken, **{'stop.x_m': 12.0})
    log, health = capfd.readouterr().err, controller.healths[-1]
    assert code == 0
    assert log.count(f'/controller/command rejected ({kind})') == 1
    assert message in log
    assert (health.level, health.values['commands_rejected']) == (1, 7)
    assert health.message.startswith('commands refused: ')
    assert message in health.message


def test_car_starts_at_the_first_pose_of_the_path(capfd):
    X, t = np.array([3.0, 13.0]), np.array([0.0, 1.0])
    path = Reference(START_NS, X, np.full(2, -2.0), np.zeros(2), t)

    def with_path(controller):
        controller.reference_pub = ros.publisher(controller, '/scenario/reference')
        controller.reference_pub.publish(encode.reference(path))

    settings = {'start.from': 'reference', 'imu_wheels_period_ms': 1, 'publish_tf': False}
    _, controller = run(weave, before=with_path, **settings, **{'stop.time_s': 0.5})
    assert controller.state(0) == (START_NS, 3.0, -2.0, 0.0, 10.0, 0.0, 0.0)
    # on request imu and wheels come with every step
    odometry = controller.stamps('odometry')
    assert controller.stamps('imu') == controller.stamps('wheels') == odometry
    assert 'tf2_msgs' not in capfd.readouterr().err  # nobody asked for /tf


def start_plant():
    plant = PlantNode()
    try:
        plant.start()
    finally:
        plant.destroy_node()


@pytest.mark.parametrize(
    ('name', 'value', 'message'),
    [
        ('stop.xm', 3.0, 'stop.xm'),
        ('start.from', 'nowhere', 'start.from is .nowhere.; allowed'),
        ('friction', 0.0, 'friction: '),
        ('plant_params', 'nobody.yaml', 'nobody.yaml'),
        ('tyre_set', '/nowhere/my.tir', '/nowhere/my.tir'),
        ('patches.friction', [0.5], 'patches: '),
    ],
)
def test_a_parameter_that_makes_no_sense_stops_the_node(name, value, message):
    with parameters(**{name: value}), pytest.raises(ParameterError, match=message):
        start_plant()


@pytest.mark.alone
def test_realtime_keeps_pace_with_the_wall_clock():
    code, controller = drive_process(weave, mode='realtime', **{'stop.x_m': 30.0})
    assert code == 0
    states = [controller.state(k) for k in range(len(controller.arrived_ns))]
    stamps = np.array([state.stamp_ns for state in states])
    # best effort and a slow test controller: most arrive, none between the milliseconds
    assert (np.diff(stamps) % STEP_NS == 0).all()
    # the stamps follow the wall clock: no state is sent before its time, nor ever later
    late_s = (np.array(controller.arrived_ns) - stamps) / 1e9
    assert late_s.min() > -CLOCKS_DIFFER_S
    first, last = np.array_split(late_s, 2)
    assert abs(last.min() - first.min()) < BEHIND_S
    # and the car moves as long as its stamps say
    driven = [state for state in states if state.X > states[0].X]
    X, Y, vx, vy, t = np.array([(s.X, s.Y, s.vx, s.vy, s.stamp_ns / 1e9) for s in driven]).T
    assert t[-1] - t[0] > 1.0
    way_m = np.hypot(np.diff(X), np.diff(Y)).sum()
    assert trapezoid(np.hypot(vx, vy), t) == pytest.approx(way_m, rel=0.01)
