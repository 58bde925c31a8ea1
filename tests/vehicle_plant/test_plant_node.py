"""The node over real DDS: a test controller answers states, the plant drives."""

import math
import os
import subprocess
import sys
import time
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pytest
import rclpy
from rclpy.context import Context
from rclpy.experimental import EventsExecutor
from rclpy.node import Node
from rclpy.task import Future

from msgs_yaml import contract, decode, encode, ros, spin_node
from msgs_yaml.types import Command, Reference
from vehicle_plant import parameters, road
from vehicle_plant.simulator import START_NS, STEP_NS, TICK_NS, Simulator, Start

pytestmark = pytest.mark.ros
SLOWEST_S = 30.0


class Controller(Node):
    """Answers the state at every boundary; keeps every byte that it receives."""

    def __init__(self, context, mode, answer):
        super().__init__('controller', context=context)
        self.declare_parameter('mode', mode)
        self.answer = answer
        self.received = {name: [] for name in ('odometry', 'actuators', 'imu', 'wheels')}
        self.clocks, self.healths = [], []
        self.answered_ns = 0
        self.command_pub = ros.publisher(self, '/controller/command')
        for name in self.received:
            ros.subscribe(self, f'/vehicle/{name}', self.keep(name), raw=True)
        ros.subscribe(self, '/clock', lambda msg: self.clocks.append(decode.clock(msg)))
        ros.subscribe(self, '/diagnostics', lambda msg: self.healths.append(decode.health(msg)))

    def keep(self, name):
        def on_message(raw):
            self.received[name].append(bytes(raw))
            if name == 'odometry':
                self.on_state(decode.stamp_ns_of(raw))

        return on_message

    def on_state(self, stamp_ns):
        if stamp_ns // TICK_NS == self.answered_ns // TICK_NS:
            return
        self.answered_ns = stamp_ns
        command = self.answer(stamp_ns)
        if command:
            self.command_pub.publish(command)

    def state(self, which):
        return decode.odometry(ros.message('/vehicle/odometry', self.received['odometry'][which]))

    def stamps(self, name):
        return [decode.stamp_ns_of(raw) for raw in self.received[name]]


class Run(NamedTuple):
    exit_code: int
    controller: Controller
    log: str


@pytest.fixture
def run(monkeypatch):
    monkeypatch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')

    def started(domain, answer, mode='lockstep', before=None, **settings):
        context = Context()
        rclpy.init(context=context, domain_id=domain)
        controller = Controller(context, mode, answer)
        if before:
            before(controller)
        executor = EventsExecutor(context=context)
        executor.add_node(controller)
        values = {'mode': mode, 'start.from': 'parameters'} | settings
        arguments = [part for k, v in values.items() for part in ('-p', f'{k}:={v}')]
        plant = subprocess.Popen(
            [sys.executable, '-m', 'vehicle_plant.plant_node', '--ros-args', *arguments],
            env=os.environ | {'ROS_DOMAIN_ID': str(domain)},
            stderr=subprocess.PIPE,
            text=True,
        )
        try:
            deadline = time.monotonic() + SLOWEST_S
            while plant.poll() is None and time.monotonic() < deadline:
                executor.spin_until_future_complete(Future(), timeout_sec=0.1)
            plant.terminate()
            _, log = plant.communicate(timeout=10)
            return Run(plant.returncode, controller, log)
        finally:
            plant.kill()
            executor.remove_node(controller)
            controller.destroy_node()
            rclpy.shutdown(context=context)

    return started


def weave(stamp_ns):
    t = (stamp_ns - START_NS) / 1e9
    return encode.command(Command(stamp_ns, 0.03 * math.sin(3 * t), 0.0, -200.0, 300.0))


def test_lockstep_sends_every_millisecond_once_and_ends_at_the_finish_line(run, params):
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


def test_on_request_imu_and_wheels_come_with_every_step(run):
    done = run(23, weave, **{'stop.x_m': 5.0, 'imu_wheels_period_ms': 1})
    odometry = done.controller.stamps('odometry')
    assert len(odometry) > 200
    assert done.controller.stamps('imu') == done.controller.stamps('wheels') == odometry


def contract_ratio(fast, slow):
    topics = contract.load().topics
    return round(topics[fast].rate_hz['lockstep'] / topics[slow].rate_hz['lockstep'])


def test_lockstep_twice_gives_the_same_bytes(run):
    first, second = (run(21, weave, **{'stop.x_m': 15.0}).controller.received for _ in range(2))
    assert first == second
    assert len(first['odometry']) > 500


def test_controller_that_falls_silent_is_braked_for_and_named_by_the_exit_code(run):
    def silent_after_half_a_second(stamp_ns):
        return weave(stamp_ns) if stamp_ns < START_NS + 10 * TICK_NS else None

    done = run(22, silent_after_half_a_second, lockstep_timeout_s=1.0)
    assert done.exit_code == 3, done.log
    last = done.controller.state(-1)
    assert abs(last.vx) < 0.1
    assert done.controller.healths[-1].level == 2


def test_late_controller_gets_the_first_state_again(run):
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


def test_run_that_takes_too_long_fails(run):
    done = run(24, weave, **{'stop.time_s': 0.5})
    assert done.exit_code == 2, done.log


def test_command_that_is_not_finite_is_refused_and_the_last_one_held(run):
    def broken_once(stamp_ns):
        msg = weave(stamp_ns)
        if stamp_ns == START_NS + 4 * TICK_NS:
            msg.position[0] = math.nan
        return msg

    done = run(25, broken_once, **{'stop.x_m': 25.0})
    assert done.exit_code == 0, done.log
    assert done.controller.healths[-1].values['commands_rejected'] == 1
    assert done.controller.healths[-1].level == 1


def test_car_starts_at_the_first_pose_of_the_path(run):
    path = Reference(
        START_NS,
        np.array([3.0, 13.0]),
        np.array([-2.0, -2.0]),
        np.array([0.0, 0.0]),
        np.array([0.0, 1.0]),
    )

    def with_path(controller):
        controller.reference_pub = ros.publisher(controller, '/scenario/reference')
        controller.reference_pub.publish(encode.reference(path))

    settings = {'start.from': 'reference', 'stop.time_s': 0.3}
    done = run(26, weave, before=with_path, **settings)
    first = done.controller.state(0)
    assert first == (START_NS, 3.0, -2.0, 0.0, 10.0, 0.0, 0.0)


def test_misspelt_parameter_stops_the_node(run):
    done = run(27, weave, **{'stop.xm': 3.0})
    assert done.exit_code == spin_node.EXIT_CONFIGURATION
    assert 'stop.xm' in done.log


def test_realtime_keeps_pace_with_the_wall_clock(run):
    begun = time.monotonic()
    done = run(28, weave, mode='realtime', **{'stop.x_m': 30.0})
    assert done.exit_code == 0, done.log
    assert time.monotonic() - begun > 1.5
    stamps = np.unique(done.controller.stamps('odometry'))
    # best effort and a slow test controller: most arrive, none between the milliseconds
    assert (np.diff(stamps) % STEP_NS == 0).all()
    assert abs(time.time_ns() - stamps[-1]) < 20e9


def test_another_car_on_another_tyre_and_a_road_with_ice(run, tmp_path):
    """Selected by parameters; what is sent is what the core computes for them."""
    tyre_file = tmp_path / 'my.tir'
    tyre_file.write_text(
        '[MODEL]\nFITTYP = 61\n[VERTICAL]\nFNOMIN = 4000\n'
        '[LONGITUDINAL_COEFFICIENTS]\nPCX1 = 1.6\nPDX1 = 1\nPKX1 = 16\nRBX1 = 8\nRCX1 = 0.9\n'
        '[LATERAL_COEFFICIENTS]\nPCY1 = 1.3\nPDY1 = 1\nPKY1 = -15\nPKY2 = 2\nRBY1 = 5\nRCY1 = 1\n'
    )
    ice = [2.0, 0.0, 90.0, 0.0, 90.0, 9.0, 2.0, 9.0]
    settings = {'patches.corners_m': ice, 'patches.friction': [0.2], 'stop.x_m': 8.0}

    def brake(stamp_ns):
        return encode.command(Command(stamp_ns, 0.0, 0.0, -4000.0, -1500.0))

    done = run(24, brake, plant_params='vw_gti.yaml', tyre_set=str(tyre_file), **settings)
    assert done.exit_code == 0, done.log
    plant = parameters.load(parameters.config('vw_gti.yaml'))
    plant = replace(plant, tyre=parameters.tyre(str(tyre_file)))
    car = Simulator(plant, 1.0, Start(0.0, 0.0, 0.0, 20.0), patches=road.patches(ice, [0.2]))
    ticks = (done.controller.stamps('odometry')[-1] - START_NS) // TICK_NS
    for i in range(ticks):
        car.advance(decode.command(brake(START_NS + i * TICK_NS)), 50)
    last = done.controller.state(-1)
    assert last[:3] == car.state[:3]
    assert last[4:] == car.state[4:]
    assert last.psi < -1e-4  # towards the side with grip


@pytest.mark.parametrize(
    'settings',
    [
        {'plant_params': 'nobody.yaml'},
        {'tyre_set': '/nowhere/my.tir'},
        {'patches.friction': [0.5]},
    ],
)
def test_car_tyre_or_road_that_is_not_there_stops_the_node(run, settings):
    done = run(23, weave, **settings)
    assert done.exit_code == spin_node.EXIT_CONFIGURATION
    (name,) = settings
    assert name.partition('.')[0] in done.log or str(settings[name]) in done.log
