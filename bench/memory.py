"""How much memory does a controller need, and does it grow?

A closed loop in process drives laps of a scenario until so many ticks have been answered; the plant
starts anew with each lap, the controller goes on. Resident memory comes from /proc/self; it
includes Python, CasADi, the compiled problem, and the plant, which a controller node does not have
(its share is printed). What the node has and this has not is rclpy: see docs/safety.md.

    .venv/bin/python bench/memory.py [--ticks 20000] [--scenario double_lane_change]
"""

import argparse
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import closed_loops

from mpcc_controller import car_file
from mpcc_controller.driving.controller import Controller
from msgs_yaml import encode
from scenario_publisher import scenario
from scenario_publisher.scenario import Scenario
from vehicle_plant import parameters as plant_parameters
from vehicle_plant.initial_state import Start
from vehicle_plant.simulator import Simulator

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


def drive_laps(controller: Controller, scn: Scenario) -> Iterator[None]:
    """Drive the scenario again and again; yield after every answered tick."""
    while True:
        for record in closed_loops.drive(scn, controller):
            prediction, why = controller.report(record)
            # as the node: messages are made, too
            encode.command(record.command), encode.prediction(prediction), encode.why(why)
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
    scn = scenario.load(arguments.scenario)
    Simulator(plant_parameters.load(), scn.friction, Start(*scn.start))
    with_plant = memory().now
    params = closed_loops.controller_params('mpcc')
    if arguments.solver:
        params = closed_loops.with_solver(params, arguments.solver)
    controller = Controller(params, car_file.load(params))
    print(f'libraries loaded {bare:.1f} MB, plant {with_plant - bare:+.1f} MB', end=', ')
    print(f'controller {memory().now - with_plant:+.1f} MB ({params.solver.name})')
    marks = {max(1, round(arguments.ticks * share)) for share in (WARM_UP, 0.25, 0.5, 0.75, 1.0)}
    seen = {0: memory()}
    drive = drive_laps(controller, scn)
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
