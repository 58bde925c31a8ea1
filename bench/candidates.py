"""How long are ticks that compare several plans, with four obstacles and the circles of mpcc_road?

    .venv/bin/python bench/candidates.py [--draws N] [--most N]
    .venv/bin/python bench/candidates.py --realtime [--draws N] [--most N] [--set NODE.param=value]
                                                     [--fifo]

Drives slaloms of the library in process, twice: once with the clock on the wall, once with that of
the processor, which counts the work of all threads, as if there were one core. Between these two
lies a tick on two free cores; other programs disturb the first alone.

With --realtime the nodes drive them on the wall clock, all on this machine, recorded; the times are
those of the messages, from the state that was sent to the command that was sent. Nothing else
should run; with --fifo the nodes have real-time priority. Exit code 1 when a target is missed.
"""

import argparse
import subprocess
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import closed_loops
import machine
import numpy as np
from realtime import fifo_settings
from rich.console import Console
from tables import TextTable, number, show

from bags.commands import timing
from bags.evaluation import tick_timing
from bags.storage import read
from mpcc_controller import car_file
from mpcc_controller.driving.controller import Controller
from scenario_publisher.families import draw

CONTROLLER, FAMILY, SEED = 'mpcc_road', 'slalom', 1
WARM_TICKS = 5  # at the start, before code and data are in the caches of the processor
CLOCKS = {'wall': time.perf_counter, 'processor': time.process_time}
MS = 1e3
MOST_P99_MS, MOST_MS = 5.0, 12.0  # from state to command, of ticks that compare plans
START_S = 60.0  # until the nodes are ready, at most


class TickTime(NamedTuple):
    """One tick."""

    plans: int  # compared
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
                ticks.append(TickTime(plans, attempt.prepare_s, record.computing_s))
    return ticks


def measure_realtime(
    draws: int, settings: list[str], folder: Path, console: Console
) -> list[TickTime]:
    """Return the ticks of the draws, driven by the nodes on the wall clock.

    A car that stops or crashes has ticks, too. Raises BagError when nothing was recorded.
    """
    ticks = []
    for index in range(draws):
        drawn = draw.draw(FAMILY, SEED, index)
        file = folder / f'{FAMILY}_{index}.yaml'
        file.write_text(drawn.text)
        limit_s = START_S + 2 * drawn.scenario().stop.time
        command = [sys.executable, '-m', 'experiments.cli', 'run', str(file), '--mode', 'realtime']
        command += ['--controller', CONTROLLER, '--out', str(folder), '--time-limit', str(limit_s)]
        command += [part for one in settings for part in ('--set', one)]
        code = subprocess.run(command, check=False, stdout=subprocess.DEVNULL).returncode
        bag = read.load(folder / drawn.scenario().name / CONTROLLER)
        console.print(f'{FAMILY} {index}{", not completed" if code else ""}')
        timing.show(tick_timing.timing_report(bag), console)
        ticks += ticks_of(bag)
    return ticks


def ticks_of(bag: read.Bag) -> list[TickTime]:
    """Return the ticks of a recorded run that were solved."""
    latency = tick_timing.command_latency(bag)
    total_s = dict(zip(latency.stamp_ns.tolist(), latency.latency_s.tolist()))
    return [
        TickTime(
            why.values.get('candidates.count', 1),
            why.values['time.prepare_ms'] / MS,
            total_s[why.stamp_ns],
        )
        for why in tick_timing.controller_reports(bag)
        if why.stamp_ns in total_s and 'time.prepare_ms' in why.values
    ]


def is_fast_enough(ticks: list[TickTime]) -> bool:
    """Print the targets; return whether they are met."""
    times = MS * np.array([tick.total_s for tick in ticks if tick.plans > 1])
    if not times.size:
        print('no tick compared plans: the targets say nothing')
        return False
    found = {'p99': (np.percentile(times, 99), MOST_P99_MS), 'max': (np.max(times), MOST_MS)}
    for name, (value, most) in found.items():
        met = 'ok' if value <= most else 'MISSED'
        print(f'ticks that compare plans, {name}: {value:.2f} ms, at most {most:g}: {met}')
    return all(value <= most for value, most in found.values())


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


def main() -> int:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.partition('\n')[0])
    parser.add_argument('--draws', type=int, default=5, metavar='N', help='slaloms (default: 5)')
    parser.add_argument('--most', type=int, default=4, metavar='N', help='plans (default: 4)')
    parser.add_argument('--realtime', action='store_true', help='nodes on the wall clock')
    parser.add_argument('--set', action='append', default=[], dest='settings', metavar='NODE.p=v')
    parser.add_argument('--fifo', action='store_true', help='real-time priority for every node')
    args = parser.parse_args()
    if (args.settings or args.fifo) and not args.realtime:
        parser.error('--set and --fifo go with --realtime')
    before, table, console = machine.cpu_times(), [], Console()
    if args.realtime:
        settings = [f'controller.candidates.most={args.most}', *args.settings]
        settings = fifo_settings() + settings if args.fifo else settings
        with tempfile.TemporaryDirectory() as folder:
            ticks = measure_realtime(args.draws, settings, Path(folder), console)
        table = rows('state to command', ticks)
    else:
        params = closed_loops.controller_params(CONTROLLER)
        params = replace(params, candidates=replace(params.candidates, most=args.most))
        for name, clock in CLOCKS.items():
            table += rows(name, measure(params, args.draws, clock))
    columns = ('clock', 'ticks', 'prepare [ms]', 'median [ms]', 'p99 [ms]', 'max [ms]')
    show(console, TextTable('Ticks of mpcc_road in slaloms of four obstacles', columns, table))
    after = machine.cpu_times()
    if before and after:
        used = after.since(before)
        print(f'processors: {used.busy_s:.0f} s used, {used.stolen_s:.0f} s by other machines')
    return 0 if not args.realtime or is_fast_enough(ticks) else 1


if __name__ == '__main__':
    sys.exit(main())
