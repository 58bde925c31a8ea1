"""How long are ticks that compare several plans, with four obstacles and the circles of mpcc_road?

    .venv/bin/python bench/candidates.py [--draws N] [--most N]

Drives slaloms of the library in process, twice: once with the clock on the wall, once with that of
the processor, which counts the work of all threads, as if there were one core. Between these two
lies a tick on two free cores; other programs disturb the first alone.
"""

import argparse
import time
from dataclasses import replace
from typing import NamedTuple

import closed_loops
import machine
import numpy as np
from rich.console import Console
from tables import TextTable, number, show

from mpcc_controller import car_file
from mpcc_controller.driving.controller import Controller
from scenario_publisher.families import draw

CONTROLLER, FAMILY, SEED = 'mpcc_road', 'slalom', 1
WARM_TICKS = 5  # at the start, before code and data are in the caches of the processor
CLOCKS = {'wall': time.perf_counter, 'processor': time.process_time}
MS = 1e3


class TickTime(NamedTuple):
    """One tick."""

    plans: int  # compared
    obstacles: int  # in the problem
    prepare_s: float  # projection, guesses, stage parameters
    total_s: float  # from the state to the command


def measure(params, draws: int, clock) -> list[TickTime]:
    """Return the ticks of the draws by one clock."""
    ticks = []
    for index in range(draws):
        controller = Controller(params, car_file.load(params), clock=clock)
        scn = draw.draw(FAMILY, SEED, index).scenario()
        records = list(closed_loops.drive(scn, controller))
        for record in records[WARM_TICKS:]:
            attempt = record.attempt
            if attempt is not None:
                compared = attempt.candidates
                plans = len(compared.choice.outcomes) if compared else 1
                count = len(attempt.problem.parameters.obstacles)
                ticks.append(TickTime(plans, count, attempt.prepare_s, record.computing_s))
    return ticks


def rows(name: str, ticks: list[TickTime]) -> list[tuple[str, ...]]:
    """Return a row per number of plans, and one of all ticks."""
    table = []
    for plans in (*sorted({tick.plans for tick in ticks}), None):
        chosen = [tick for tick in ticks if plans in (tick.plans, None)]
        total = MS * np.array([tick.total_s for tick in chosen])
        prepare = MS * np.median([tick.prepare_s for tick in chosen])
        times = (np.median(total), np.percentile(total, 99), np.max(total))
        label = f'{name}, {plans} plans' if plans else f'{name}, all'
        table.append((label, str(len(chosen)), number(prepare), *map(number, times)))
    return table


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.partition('\n')[0])
    parser.add_argument('--draws', type=int, default=5, metavar='N', help='slaloms (default: 5)')
    parser.add_argument('--most', type=int, default=4, metavar='N', help='plans (default: 4)')
    args = parser.parse_args()
    params = closed_loops.controller_params(CONTROLLER)
    params = replace(params, candidates=replace(params.candidates, most=args.most))
    before, table = machine.cpu_times(), []
    for name, clock in CLOCKS.items():
        table += rows(name, measure(params, args.draws, clock))
    columns = ('clock', 'ticks', 'prepare [ms]', 'median [ms]', 'p99 [ms]', 'max [ms]')
    show(Console(), TextTable('Ticks of mpcc_road in slaloms of four obstacles', columns, table))
    after = machine.cpu_times()
    if before and after:
        used = after.since(before)
        print(f'processors: {used.busy_s:.0f} s used, {used.stolen_s:.0f} s by other machines')


if __name__ == '__main__':
    main()
