"""The node of the plant in a process of its own, and a test controller that answers it."""

import math
import subprocess
import sys
import time
from typing import NamedTuple

import rclpy
from rclpy.context import Context
from rclpy.experimental import EventsExecutor
from rclpy.node import Node
from rclpy.task import Future
from wait_until import wait_until

from msgs_yaml import decode, encode
from msgs_yaml.types import Command
from node_runtime import ros, spin_node
from vehicle_plant.simulator import START_NS, TICK_NS

SLOWEST_S = 120.0


class Controller(Node):
    """Answers the state at every boundary; keeps every byte that it receives."""

    def __init__(self, context, mode, answer):
        super().__init__('controller', context=context)
        self.declare_parameter('mode', mode)
        self.answer = answer
        self.received = {name: [] for name in ('odometry', 'actuators', 'imu', 'wheels')}
        self.arrived_ns = []  # wall time of every odometry
        self.clocks, self.healths = [], []
        self.answered_ns = 0
        self.command_pub = ros.publisher(self, '/controller/command')
        for name in self.received:
            ros.subscribe(self, f'/vehicle/{name}', self.keep(name), raw=True)
        ros.subscribe(self, '/clock', lambda msg: self.clocks.append(decode.clock(msg)))
        ros.subscribe(self, '/diagnostics', lambda msg: self.healths.extend(decode.health(msg)))

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
        self.answered_ns = stamp_ns
        command = self.answer(stamp_ns)
        if command:
            self.command_pub.publish(command)

    def state(self, which):
        return decode.odometry(
            ros.deserialize('/vehicle/odometry', self.received['odometry'][which])
        )

    def stamps(self, name):
        return [decode.stamp_ns_of(raw) for raw in self.received[name]]


class Run(NamedTuple):
    """How the plant ended, and what the controller had received by then."""

    exit_code: int
    controller: Controller
    log: str


def run(answer, mode='lockstep', before=None, **settings):
    """Drive until the plant ends; settings are its parameters, `answer(stamp_ns)` the commands.

    Both nodes are in the domain of the environment: the test uses the fixture `domain`.
    """
    context = Context()
    rclpy.init(context=context)
    controller = Controller(context, mode, answer)
    if before:
        before(controller)
    executor = EventsExecutor(context=context)
    executor.add_node(controller)
    values = {'mode': mode, 'start.from': 'parameters'} | settings
    arguments = [part for k, v in values.items() for part in ('-p', f'{k}:={v}')]
    plant = subprocess.Popen(
        [sys.executable, '-m', 'vehicle_plant.plant_node', '--ros-args', *arguments],
        stderr=subprocess.PIPE,
        text=True,
    )
    try:
        wait_until(
            lambda: plant.poll() is not None,
            SLOWEST_S,
            'the plant goes on',
            pause=lambda: executor.spin_until_future_complete(Future(), timeout_sec=0.1),
        )
        _, log = plant.communicate(timeout=SLOWEST_S)
        return Run(plant.returncode, controller, log)
    finally:
        plant.kill()
        executor.remove_node(controller)
        spin_node.shut_down(controller, context=context)


def weave(stamp_ns):
    """Return a command that steers to and fro and pulls a little."""
    t = (stamp_ns - START_NS) / 1e9
    return encode.command(Command(stamp_ns, 0.03 * math.sin(3 * t), 0.0, -200.0, 300.0))
