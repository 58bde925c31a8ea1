"""How much memory does a controller need, and does it grow?

A closed loop in process drives laps of a scenario until so many ticks have been answered; the plant
starts anew with each lap, the controller goes on. Resident memory comes from /proc/self; it
includes Python, CasADi, the compiled problem, and the plant, which a controller node does not have
(its share is told). What the node has and this has not is rclpy: see docs/safety.md.

    .venv/bin/python bench/memory.py [--ticks 20000] [--scenario double_lane_change]
"""

import argparse
import sys
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

from experiments.configuration import inputs
from mpcc_controller import car_file
from mpcc_controller.driving.controller import Controller
from mpcc_controller.driving.tick import TickInputs
from mpcc_controller.parameters import ControllerParams
from msgs_yaml import conversions, encode, share
from msgs_yaml.conversions import NS_PER_S
from node_runtime import parameters
from scenario_publisher import scenario
from vehicle_plant import parameters as plant_parameters
from vehicle_plant.initial_state import Start
from vehicle_plant.run_end import RunEnd
from vehicle_plant.simulator import Simulator
from vehicle_plant.stepping import LockstepStepper

WARM_UP = 0.1  # share of the ticks after which nothing may grow any more
MOST_MB = 250.0
MOST_GROWTH_MB = 1.0


class Memory(NamedTuple):
    """Resident memory of this process [MB]."""

    now: float
    peak: float


def memory() -> Memory:
    """Return the resident memory from /proc/self/status."""
    lines = Path('/proc/self/status').read_text().splitlines()
    kb = {line.split(':')[0]: line.split()[1] for line in lines if line.startswith('Vm')}
    return Memory(int(kb['VmRSS']) / 1e3, int(kb['VmHWM']) / 1e3)


def controller_params(name: str) -> ControllerParams:
    """Return the parameters of the MPCC with one of its solvers."""
    params = parameters.load(ControllerParams, share.path('mpcc_controller', 'config', 'mpcc.yaml'))
    return replace(params, solver=replace(params.solver, name=name)) if name else params


def laps(controller, scn, plant):
    """Drive the scenario again and again; yield after every answered tick."""
    while True:
        car = Simulator(plant, scn.friction, Start(*scn.start))
        side = LockstepStepper(car, RunEnd(inputs.stop_params(scn), car.now))
        controller.reset(car.actuators)
        controller.set_reference(conversions.reference_as_received(scn.reference))
        controller.set_edges(scn.edges)
        while not side.outcome:
            t = (car.stamp_ns - scn.reference.stamp_ns) / NS_PER_S
            controller.set_obstacles(scenario.obstacles_at(scn, t, car.stamp_ns))
            record = controller.step(TickInputs(conversions.odometry_as_received(car.state)))
            command, (prediction, why) = record.command, controller.report(record)
            # as the node: messages are made, too
            encode.command(command), encode.prediction(prediction), encode.why(why)
            side.tick(command)
            yield


def main() -> int:
    """Print the figures; return 1 when memory grows or is too much."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--ticks', type=int, default=20000)
    parser.add_argument('--scenario', default='double_lane_change')
    parser.add_argument(
        '--solver', default='', help='fatrop, ipopt or riccati; default: from the file'
    )
    arguments = parser.parse_args()
    bare = memory().now
    scn, plant = scenario.load(arguments.scenario), plant_parameters.load()
    Simulator(plant, scn.friction, Start(*scn.start))
    with_plant = memory().now
    params = controller_params(arguments.solver)
    controller = Controller(params, car_file.load(params))
    print(f'libraries loaded {bare:.1f} MB, plant {with_plant - bare:+.1f} MB', end=', ')
    print(f'controller {memory().now - with_plant:+.1f} MB ({params.solver.name})')
    marks = {max(1, round(arguments.ticks * share)) for share in (WARM_UP, 0.25, 0.5, 0.75, 1.0)}
    seen = {0: memory()}
    drive = laps(controller, scn, plant)
    for tick in range(1, arguments.ticks + 1):
        next(drive)
        if tick in marks:
            seen[tick] = memory()
    for tick, (now, peak) in seen.items():
        print(f'after {tick:>6} ticks: {now:6.1f} MB, peak {peak:6.1f} MB')
    first, *_, last = (seen[tick] for tick in sorted(marks))
    growth = last.now - first.now
    print(f'growth over the last {1 - WARM_UP:.0%} of the ticks: {growth:+.2f} MB')
    return int(last.peak > MOST_MB or growth > MOST_GROWTH_MB)


if __name__ == '__main__':
    sys.exit(main())
