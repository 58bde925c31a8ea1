"""Is 20 Hz held on the wall clock, with all nodes and the recorder running on this machine?

    .venv/bin/python bench/realtime.py [--ticks 10000] [--controller mpcc] [--set NODE.param=value]
                                       [--bag DIR] [--json bench/realtime.json] [--fifo]

Drives along a winding road, left and right by turns, past obstacles: 10,000 ticks take 500 s.
Nothing else should run: every other process shows in the percentiles. With --fifo it shows less:
every node gets real-time priority, which the user must have the right to give. Writes the JSON and
a table beside it (.md). Exit code 1 when a target is missed.
"""

import argparse
import json
import math
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import NamedTuple

import machine
from rich.console import Console

from bags.commands import timing
from bags.evaluation import tick_timing
from bags.storage import read

TICK_S = 0.05
MIN_SHARE = 0.98  # of the requested ticks: the car may be a little slower than planned
SPEED_MPS = 10.0
RADIUS_M = 80.0
TURN_M = math.pi / 2 * RADIUS_M  # a quarter of a circle, then one to the other side
OBSTACLES_M = (100.0, 250.0)
START_S, MARGIN_M = 60.0, 60.0
MOST_S = 600.0  # that a scenario may take
# SCHED_FIFO: nodes with deadlines before nodes that only have to keep up
FIFO = {'controller': 20, 'plant': 20, 'scenario': 10, 'recorder': 10}
SCENARIO = """
schema: 1
name: winding
description: Left and right by turns, past two obstacles.
sampling: {{path_m: 5.0, edges_m: 5.0}}
road:
  centre_line:
    start: {{x_m: 0.0, y_m: 0.0, yaw_rad: 0.0}}
    segments:
{segments}
  edges:
    left: {{offset_m: 5.0}}
    right: {{offset_m: -5.0}}
path:
  start: {{x_m: 0.0, y_m: 0.0, yaw_rad: 0.0}}
  segments:
{segments}
speed: {{constant_mps: {speed_mps}}}
friction: 1.0
start: {{progress_m: 0.0}}
stop: {{progress_m: {stop_m}, time_s: {time_s}}}
obstacles:
  - {{station_m: {obstacles_m[0]}, offset_m: 2.8, radius_m: 1.0}}
  - {{station_m: {obstacles_m[1]}, offset_m: -2.8, radius_m: 1.0}}
"""


class Target(NamedTuple):
    """One measured value and its limit."""

    name: str
    measured: float | None  # None where the bag has no such value
    most: float

    @property
    def status(self) -> str:
        """Whether the target is met, as text."""
        if self.measured is None:
            return 'UNKNOWN'
        return 'ok' if self.measured <= self.most else 'MISSED'

    @property
    def text(self) -> str:
        """The measured value as text."""
        return number(self.measured, 3)


def number(value: float | None, decimals: int) -> str:
    """Return a number as text, a dash for none."""
    return '-' if value is None else f'{value:.{decimals}f}'


def scenario(ticks: int) -> str:
    """Return a scenario that takes that many ticks, and a little more."""
    stop_m = ticks * TICK_S * SPEED_MPS
    turns = math.ceil((max(stop_m, *OBSTACLES_M) + MARGIN_M) / TURN_M)
    arcs = [{'length_m': TURN_M, 'curvature_1pm': (-1) ** k / RADIUS_M} for k in range(turns)]
    return SCENARIO.format(
        segments='\n'.join(f'    - arc: {json.dumps(arc)}' for arc in arcs),
        obstacles_m=OBSTACLES_M,
        speed_mps=SPEED_MPS,
        stop_m=stop_m,
        time_s=min(2 * ticks * TICK_S, MOST_S),
    )


def fifo_settings() -> list[str]:
    """Return the settings that give every node its priority; SystemExit where the user may not."""
    before = os.sched_getscheduler(0), os.sched_getparam(0)
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(max(FIFO.values())))
    except OSError as error:
        raise SystemExit(f'--fifo: {error}; docs/promises.md says how to allow it') from None
    os.sched_setscheduler(0, *before)
    return [f'{node}.realtime.priority={priority}' for node, priority in FIFO.items()]


def drive(options: argparse.Namespace, folder: Path) -> Path:
    """Drive once; return the bag. Raises CalledProcessError when the run does not complete."""
    file = folder / 'winding.yaml'
    file.write_text(scenario(options.ticks))
    command = [sys.executable, '-m', 'experiments.cli', 'run', str(file), '--mode', 'realtime']
    command += ['--controller', options.controller, '--out', str(folder)]
    command += ['--time-limit', str(2 * options.ticks * TICK_S + START_S)]
    command += [part for one in options.settings for part in ('--set', one)]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    return folder / 'winding' / Path(options.controller).stem


def targets(found: dict) -> list[Target]:
    """Return the figures that are asked for."""
    ticks, period_ms = found['ticks'], TICK_S * 1e3
    interval_ms = found['interval_ms']['mean']
    off = None if interval_ms is None else 100 * abs(interval_ms - period_ms) / period_ms
    missed = 1e3 * ticks['missed'] / ticks['count'] if ticks['count'] else None
    parts = found['parts_ms']
    return [
        Target('missed ticks per 1000', missed, 1.0),
        Target('mean interval off 50 ms [%]', off, 1.0),
        Target('state to command, p99 [ms]', parts['total'].get('p99'), 15.0),
        Target('transport, p99 [ms]', parts['transport'].get('p99'), 3.0),
    ]


def page(found: dict, checked: list[Target], noted: dict) -> str:
    """Return the figures as Markdown."""
    names = list(tick_timing.QUANTILES)
    rows = {**found['parts_ms'], 'between two commands': found['interval_ms']}
    rows['state sent after its stamp'] = found['state_sent_after_its_stamp_ms']
    ticks = found['ticks']
    about = ', '.join(f'{key} {value}' for key, value in noted['machine'].items())
    lines = [
        '# 20 Hz on the wall clock',
        '',
        f'`python bench/realtime.py{noted["flag"]}`, all nodes and the recorder on one machine',
        f'({about});',
        f'settings: {", ".join(noted["settings"]) or "none"}. {ticks["count"]} ticks, '
        f'{ticks["missed"]} missed, {ticks["blind"]} commands without a state.',
        describe_cpu_times(noted['processors']),
        '',
        '| target | found | at most | |',
        '|---|---|---|---|',
        *(f'| {t.name} | {t.text} | {t.most:g} | {t.status} |' for t in checked),
        '',
        f'| ms | {" | ".join(names)} |',
        f'|---|{"---|" * len(names)}',
    ]
    for row, values in rows.items():
        lines.append(
            f'| {row} | {" | ".join(number((values or {}).get(name), 2) for name in names)} |'
        )
    return '\n'.join(lines) + '\n'


def describe_cpu_times(spent: dict | None) -> str:
    """Return the busy and stolen processor times as a sentence."""
    if spent is None:
        return 'How busy the processors were is not known.'
    return (
        f'The processors were busy for {spent["busy_s"]:.0f} s meanwhile, everything counted; '
        f'{spent["stolen_s"]:.1f} s more were wanted and not given by the host of this machine.'
    )


def main() -> int:
    """Drive, print the tables, write the figures."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--ticks', type=int, default=10_000, help='of 50 ms')
    parser.add_argument('--controller', default='mpcc', help='a name, or a YAML file')
    parser.add_argument('--set', action='append', default=[], dest='settings', metavar='NODE.p=v')
    parser.add_argument('--bag', type=Path, help='look at this bag instead of driving')
    parser.add_argument('--fifo', action='store_true', help='real-time priority for every node')
    parser.add_argument('--json', type=Path, help='file to write (realtime[_fifo].json)')
    options = parser.parse_args()
    file = options.json or Path(__file__).with_name(
        'realtime_fifo.json' if options.fifo else 'realtime.json'
    )
    if options.fifo and options.bag:
        parser.error('--fifo is about a drive, and --bag makes none')
    if options.fifo:
        options.settings = fifo_settings() + options.settings  # what is set by hand counts
    before = machine.cpu_times()
    with tempfile.TemporaryDirectory() as folder:
        bag = options.bag or drive(options, Path(folder))
        beside = None if options.bag or not before else machine.cpu_times().since(before)._asdict()
        found = tick_timing.timing_report(read.load(bag))
    timing.show(found, Console())
    if found['ticks']['count'] < MIN_SHARE * options.ticks and not options.bag:
        raise SystemExit(f'only {found["ticks"]["count"]} ticks: the car did not get there')
    checked = targets(found)
    for target in checked:
        print(f'{target.name:<30}{target.text:>8}  at most {target.most:g}: {target.status}')
    noted = {
        'flag': ' --fifo' if options.fifo else '',
        'settings': options.settings,
        'machine': machine.named(),
        'processors': beside,
    }
    print(describe_cpu_times(beside))
    file.write_text(json.dumps({**found, **noted}, indent=2) + '\n')
    file.with_suffix('.md').write_text(page(found, checked, noted))
    return 0 if all(target.status == 'ok' for target in checked) else 1


if __name__ == '__main__':
    sys.exit(main())
