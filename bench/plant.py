"""The plant: time per 1 ms step, or its node on the wall clock, CPU and punctuality: docs/plant.md.

    .venv/bin/python bench/plant.py [--node]

`step_us` is the compiled integrator in bursts of 50 steps, as the node calls it in lockstep; the
target is 15. With --node a second process drives the node: it sends a command every 50 ms and takes
the odometry. The node's process notes when each step begins; `deviation` is by how much the time
between two differs from 1 ms. Nothing else should run: every other process shows in the
percentiles.
"""

import argparse
import json
import math
import os
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import rclpy
from rclpy.context import Context
from rclpy.experimental import EventsExecutor
from rclpy.node import Node

from msgs_yaml import decode, encode
from msgs_yaml.types import Command
from node_runtime import ros, spin_node
from vehicle_plant import integrator, modes_node, parameters, plant_node, road_friction
from vehicle_plant.initial_state import Start, rolling_state
from vehicle_plant.simulator import TICK_STEPS, Simulator

BURSTS = 400
NS_PER_MS = 1e6
TICK_S = 0.05
TARGETS = {
    'step_us': 15.0,
    'cpu_percent_of_a_core': 35.0,
    'deviation_p50_ms': 0.2,
    'deviation_p99_ms': 2.0,
}
DRIVE_S, LATEST_S = 20.0, 60.0
DOMAIN = 24  # of ROS


def per_step_us(call, steps: int, repeats: int) -> list[float]:
    """Return the time per step of each repeat."""
    times = []
    for _ in range(repeats):
        begin = time.perf_counter()
        call()
        times.append((time.perf_counter() - begin) / steps * 1e6)
    return times


def measure() -> dict[str, float]:
    """Drive a swerve in bursts of 50 steps, as the node does; and the bare integrator."""
    params = parameters.load()
    p = integrator.parameter_vector(params, 1.0)
    x = rolling_state(params, Start(0.0, 0.0, 0.0, 25.0))
    swerve = np.column_stack([0.1 * np.sin(np.arange(TICK_STEPS + 1) / 10)] + [np.zeros(51)] * 2)
    car = Simulator(params, 1.0, Start(0.0, 0.0, 0.0, 25.0))
    strips = [
        [i, 0.0, i + 1.0, 0.0, i + 1.0, 4.0, float(i), 4.0]
        for i in range(road_friction.MAX_PATCHES)
    ]
    some = road_friction.patch_array(np.ravel(strips), [0.5] * road_friction.MAX_PATCHES)
    bare = per_step_us(lambda: integrator.advance(x, swerve, p), TICK_STEPS, BURSTS)
    patchy = per_step_us(lambda: integrator.advance(x, swerve, p, patches=some), TICK_STEPS, BURSTS)
    burst = per_step_us(lambda: car.advance(None, TICK_STEPS), TICK_STEPS, BURSTS)
    single = per_step_us(lambda: car.advance(None, 1), 1, BURSTS)
    return {
        'step_us': statistics.median(bare),
        'step_p99_us': float(np.percentile(bare, 99)),
        'step_with_16_patches_us': statistics.median(patchy),
        'simulator_burst_us': statistics.median(burst),
        'simulator_burst_p99_us': float(np.percentile(burst, 99)),
        'simulator_single_step_us': statistics.median(single),
    }


class Driver(Node):
    """Weaves."""

    def __init__(self, context):
        super().__init__('controller', context=context)
        self.declare_parameter('mode', 'realtime')
        self.raw = None
        self.pub = ros.publisher(self, '/controller/command')
        self.sub = ros.subscribe(self, '/vehicle/odometry', self.on_odometry, raw=True)
        self.timer = self.create_timer(TICK_S, self.on_tick)

    def on_odometry(self, raw):
        """Keep the newest state."""
        self.raw = raw

    def on_tick(self):
        """Answer the newest state."""
        if self.raw:
            stamp_ns = decode.stamp_ns_of(self.raw)
            steer = 0.03 * math.sin(stamp_ns / 1e9)
            self.pub.publish(encode.command(Command(stamp_ns, steer, 0.0, 0.0, 300.0)))


def inside(out: Path) -> int:
    """Be the node, and leave behind when its steps began."""
    on_step = modes_node.RealtimeMode.on_step
    begun, cpu, steppers, stamps = [], [], [], []

    def noted(mode):
        begun.append(time.monotonic_ns())
        cpu.append(time.process_time())
        steppers[:] = [mode.stepper]
        stamps.append(mode.stepper.car.stamp_ns)
        on_step(mode)

    modes_node.RealtimeMode.on_step = noted
    exit_code = plant_node.main()
    (stepper,), first_ns = steppers, stamps[0]
    found = {
        'begun_ns': begun,
        'cpu_s': cpu[-1] - cpu[0],
        'missed_steps': stepper.missed_steps,
        'longest_gap': stepper.longest_gap,
        'refused': stepper.car.gate.rejected,
        'driven_ms': (stepper.car.stamp_ns - first_ns) / NS_PER_MS,
    }
    out.write_text(json.dumps(found))
    return exit_code


def run_node() -> dict:
    """Run both processes; return what the node left behind."""
    os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder, 'steps.json')
        settings = {'mode': 'realtime', 'start.from': 'parameters', 'stop.time_s': DRIVE_S}
        settings['stop.x_m'] = 10_000.0
        given = [part for name, value in settings.items() for part in ('-p', f'{name}:={value}')]
        command = [sys.executable, __file__, '--inside', str(out), '--ros-args', *given]
        context = Context()
        rclpy.init(context=context, domain_id=DOMAIN)
        node = Driver(context)
        executor = EventsExecutor(context=context)
        executor.add_node(node)
        plant = subprocess.Popen(command, env=os.environ | {'ROS_DOMAIN_ID': str(DOMAIN)})
        try:
            end = time.monotonic() + DRIVE_S + LATEST_S
            while plant.poll() is None and time.monotonic() < end:
                executor.spin_until_future_complete(rclpy.task.Future(), timeout_sec=0.2)
        finally:
            if plant.poll() is None:
                plant.terminate()
            plant.wait(timeout=LATEST_S)
            spin_node.shut_down(node, context=context)
        return json.loads(out.read_text())


def figures(found: dict) -> dict[str, float]:
    """Return what the table shows."""
    begun = np.array(found['begun_ns']) / NS_PER_MS
    elapsed_ms = begun[-1] - begun[0]
    deviation = np.abs(np.diff(begun) - 1.0)
    return {
        'cpu_percent_of_a_core': 100 * found['cpu_s'] * 1e3 / elapsed_ms,
        'deviation_p50_ms': float(np.percentile(deviation, 50)),
        'deviation_p99_ms': float(np.percentile(deviation, 99)),
        'deviation_max_ms': float(deviation.max()),
        'wakeups_per_s': len(begun) / elapsed_ms * 1e3,
        'missed_steps': found['missed_steps'],
        'longest_gap_steps': found['longest_gap'],
        'steps_driven_per_ms': found['driven_ms'] / elapsed_ms,
        'commands_refused': found['refused'],
        'seconds': elapsed_ms / 1e3,
    }


def main() -> int:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--node', action='store_true', help='the node instead of its steps')
    parser.add_argument('--inside', type=Path, help=argparse.SUPPRESS)
    options, rest = parser.parse_known_args()
    if options.inside:
        sys.argv[1:] = rest  # what the node reads
        return inside(options.inside)
    for name, value in (figures(run_node()) if options.node else measure()).items():
        target = f'{TARGETS[name]:10.1f}' if name in TARGETS else ''
        print(f'{name:<28}{value:12.3f}{target}')
    return 0


if __name__ == '__main__':
    sys.exit(main())
