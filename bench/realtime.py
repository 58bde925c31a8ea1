"""Is 20 Hz held on the wall clock by all nodes? Rows of docs/performance.md, docs/promises.md.

    .venv/bin/python bench/realtime.py [--ticks 10000] [--controller mpcc] [--set NODE.param=value]
                                       [--out bench/realtime.md] [--fifo]

Drives along a winding road, left and right by turns, past obstacles: 10,000 ticks take 500 s.
Nothing else should run: every other process shows in the percentiles. With --fifo it shows less:
every node gets real-time priority, which the user must have the right to give. Writes a page; exit
code 1 when a target is missed.
"""

import argparse
import math
import os
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
import yaml
from tables import cpu_times, machine, markdown

from bags.evaluation import bag_summary
from bags.storage import read
from experiments.families.scenario_document import document

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


def scenario(ticks: int) -> str:
    """Return a scenario that takes that many ticks, and a little more."""
    stop_m = ticks * TICK_S * SPEED_MPS
    turns = math.ceil((max(stop_m, *OBSTACLES_M) + MARGIN_M) / TURN_M)
    arcs = [{'length_m': TURN_M, 'curvature_1pm': (-1) ** k / RADIUS_M} for k in range(turns)]
    parts = document(
        description='Left and right by turns, past two obstacles.',
        length=stop_m,
        speed=SPEED_MPS,
        segments=[{'arc': arc} for arc in arcs],
        obstacles=[
            {'station_m': station, 'offset_m': offset, 'radius_m': 1.0}
            for station, offset in zip(OBSTACLES_M, (2.8, -2.8))
        ],
        left=5.0,
        right=-5.0,
    )
    parts['stop']['time_s'] = min(2 * ticks * TICK_S, MOST_S)
    parts |= {'name': 'winding', 'sampling': {'path_m': 5.0, 'edges_m': 5.0}}
    return yaml.safe_dump(parts)


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


def targets(found: dict) -> list[tuple[str, float | None, float]]:
    """Return what is asked for: its name, what was measured (None: nothing), what is allowed."""
    ticks, period_ms = found['ticks'], TICK_S * 1e3
    interval_ms = found['interval_ms']['mean']
    off = None if interval_ms is None else 100 * abs(interval_ms - period_ms) / period_ms
    missed = 1e3 * ticks['missed'] / ticks['count'] if ticks['count'] else None
    parts = found['parts_ms']
    return [
        ('missed ticks per 1000', missed, 1.0),
        ('mean interval off 50 ms [%]', off, 1.0),
        ('state to command, p99 [ms]', parts['total'].get('p99'), 15.0),
        ('transport, p99 [ms]', parts['transport'].get('p99'), 3.0),
    ]


def page(found: dict, options: argparse.Namespace, spent: np.ndarray) -> str:
    """Return the figures as Markdown."""

    def text(value, decimals):
        return '-' if value is None else f'{value:.{decimals}f}'

    ticks = found['ticks']
    about = ', '.join(f'{key} {value}' for key, value in machine().items())
    busy_s, stolen_s = spent
    head = (
        f'`python bench/realtime.py{" --fifo" if options.fifo else ""}`, all nodes and the '
        f'recorder on one machine\n({about});\nsettings: {", ".join(options.settings) or "none"}. '
        f'{ticks["count"]} ticks, {ticks["missed"]} missed, {ticks["blind"]} commands without a '
        'state.\n'
        f'The processors were busy for {busy_s:.0f} s meanwhile, everything counted; '
        f'{stolen_s:.1f} s more were wanted and not given by the host of this machine.\n'
    )
    names = list(bag_summary.QUANTILES)
    rows = {**found['parts_ms'], 'between two commands': found['interval_ms']}
    rows['state sent after its stamp'] = found['state_sent_after_its_stamp_ms']
    checked = [
        (name, text(value, 3), f'{most:g}', status(value, most))
        for name, value, most in targets(found)
    ]
    spread = [
        (row, *(text((values or {}).get(name), 2) for name in names))
        for row, values in rows.items()
    ]
    tables = (
        markdown('Targets', ('target', 'found', 'at most', ''), checked),
        markdown('Times', ('ms', *names), spread),
    )
    return '\n'.join(('# 20 Hz on the wall clock\n', head, *tables))


def status(value: float | None, most: float) -> str:
    """Return whether a target is met, as text."""
    return 'UNKNOWN' if value is None else 'ok' if value <= most else 'MISSED'


def main() -> int:
    """Drive, print the tables, write the figures."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--ticks', type=int, default=10_000, help='of 50 ms')
    parser.add_argument('--controller', default='mpcc', help='a name, or a YAML file')
    parser.add_argument('--set', action='append', default=[], dest='settings', metavar='NODE.p=v')
    parser.add_argument('--fifo', action='store_true', help='real-time priority for every node')
    parser.add_argument('--out', type=Path, help='file to write (realtime[_fifo].md)')
    options = parser.parse_args()
    if options.fifo:
        options.settings = fifo_settings() + options.settings  # what is set by hand counts
    before = cpu_times()
    with tempfile.TemporaryDirectory() as folder:
        bag = drive(options, Path(folder))
        spent = cpu_times() - before
        found = bag_summary.timing_report(read.load(bag))
    if found['ticks']['count'] < MIN_SHARE * options.ticks:
        raise SystemExit(f'only {found["ticks"]["count"]} ticks: the car did not get there')
    text = page(found, options, spent)
    print(text)
    name = 'realtime_fifo.md' if options.fifo else 'realtime.md'
    (options.out or Path(__file__).with_name(name)).write_text(text)
    return 0 if all(status(value, most) == 'ok' for _, value, most in targets(found)) else 1


if __name__ == '__main__':
    sys.exit(main())
