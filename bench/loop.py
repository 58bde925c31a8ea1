"""How fast are a drive in process, its ticks and the node graph? Figures of docs/performance.md.

    .venv/bin/python bench/loop.py [--repeats N] [--scaling] [--ring] [--out bench/loop.md]

Nothing else should run. Without options it times drives of `SCENARIO` in process; --scaling adds
how a tick grows with the length of the path, --ring a recorded drive of the node graph in lockstep.
Writes a page.
"""

import argparse
import gc
import os
import subprocess
import sys
import tempfile
import time
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import NamedTuple

import closed_loops
import machine
import numpy as np
from tables import markdown, number

from bags.evaluation import bag_summary
from bags.storage import read
from experiments import simulation
from mpcc_controller.driving.controller import Controller
from mpcc_controller.driving.records import TickInputs, TickRecord
from msgs_yaml import conversions
from msgs_yaml.types import Obstacle, Obstacles, Reference, RoadEdges, VehicleState
from scenario_publisher import scenario

SCENARIO = 'double_lane_change'
CONTROLLERS = ('mpcc', 'mpcc_no_ca', 'frenet')
TICK_S = 0.05
MS = 1e3
WARM_TICKS = 5  # at the start, before code and data are in the caches of the processor
PARALLEL_S = 4.0  # how long the drives beside each other go on
PATH_LENGTHS_M = (100.0, 1000.0, 20_000.0)
POSE_M = 0.5  # between two poses of these paths: 40,000 on the longest
MEASURED_TICKS = 40
KINDS = (
    'explained: a drive with all that would be recorded; brief: without predictions and values of '
    'the plan; evaluated: brief, as the metrics take it.'
)
SPEED_MPS, HALF_WIDTH_M, START_NS = 15.0, 5.0, 10**9


class TickTimes(NamedTuple):
    """The parts of ticks, each (n,) [ms]; `total` is from the decoded state to the command."""

    total: np.ndarray
    prepare: np.ndarray  # projection, initial guess, numbers of the stages, bounds
    solve: np.ndarray
    rest: np.ndarray  # delay compensation, choice, set-points, gate
    explain: np.ndarray  # after the command: /controller/prediction and /controller/why

    @property
    def outside(self) -> np.ndarray:
        """The part that is no solver [ms]."""
        return self.total - self.solve


def tick_times(records: list[tuple[TickRecord, float]]) -> TickTimes:
    """Return the times of ticks that solved once, from their records and explaining times [s]."""
    rows = [
        (r.computing_s, r.attempt.prepare_s, r.attempt.solution.solve_s, explain_s)
        for r, explain_s in records
        if r.attempt is not None
    ]
    total, prepare, solve, explain = MS * np.array(rows[WARM_TICKS:]).T
    return TickTimes(total, prepare, solve, total - prepare - solve, explain)


def watched_drive(scn: scenario.Scenario, controller: Controller) -> TickTimes:
    """Return the times of the ticks of one drive, explained."""
    records = []
    for record in closed_loops.drive(scn, controller):
        began = time.perf_counter()
        controller.report(record)
        records.append((record, time.perf_counter() - began))
    return tick_times(records)


def cpu_of(call) -> tuple[float, object]:
    """Return the processor time [s] of a call, and its result."""
    gc.collect()
    began = time.process_time()
    result = call()
    return time.process_time() - began, result


def measure_drives(controller: str, repeats: int) -> dict:
    """Return processor time, real-time factors and tick times of drives of one controller."""
    setup = simulation.prepare(SCENARIO, controller)
    columns = simulation.run(setup)
    driven_s = float(columns['/vehicle/odometry'].t_s[-1])
    cpu_s = {'explained': [], 'brief': [], 'evaluated': []}
    calls = {
        'explained': lambda: simulation.run(setup),
        'brief': lambda: simulation.run(setup, explain=False),
        'evaluated': lambda: simulation.drive(setup),
    }
    for _ in range(repeats):  # alternately: what disturbs the machine disturbs all of them
        for name, call in calls.items():
            cpu_s[name].append(cpu_of(call)[0])
    ticks = [
        watched_drive(setup.scn, Controller(setup.params, setup.vehicle)) for _ in range(repeats)
    ]
    every = TickTimes(*(np.concatenate(part) for part in zip(*ticks)))
    factors = {name: driven_s / float(np.median(times)) for name, times in cpu_s.items()}
    return {
        'drive_s': driven_s,
        'drive_cpu_s': {name: float(np.median(times)) for name, times in cpu_s.items()},
        'real_time_factor': factors,
        'tick_ms': {**quantiles(every.total), 'by_part': parts(every)},
        'explain_ms': quantiles(every.explain),
    }


def parts(times: TickTimes) -> dict[str, dict[str, float]]:
    """Return the quantiles of every part before the command."""
    named = {name: getattr(times, name) for name in ('prepare', 'solve', 'rest', 'outside')}
    return {name: quantiles(values) for name, values in named.items()}


def quantiles(values: np.ndarray) -> dict[str, float]:
    """Return median, 99th percentile and maximum."""
    return {
        'median': float(np.median(values)),
        'p99': float(np.percentile(values, 99)),
        'max': float(np.max(values)),
    }


def count_drives(_: int = 0) -> float:
    """Return the drives per second of this process, without explaining."""
    setup = simulation.prepare(SCENARIO, CONTROLLERS[0])
    simulation.run(setup, explain=False)
    count, began = 0, time.perf_counter()
    while time.perf_counter() - began < PARALLEL_S:
        simulation.run(setup, explain=False)
        count += 1
    return count / (time.perf_counter() - began)


def measure_parallel() -> dict:
    """Return the drives per second of one process and of one per core, side by side."""
    cores = len(os.sched_getaffinity(0))
    rates = {}
    for workers in sorted({1, cores}):
        with ProcessPoolExecutor(workers) as pool:
            rates[workers] = sum(pool.map(count_drives, range(workers)))
    return {
        'drives_per_s': {str(workers): rate for workers, rate in rates.items()},
        'speed_up': rates[cores] / rates[1],
    }


def measure_lengths() -> list[dict]:
    """Return the tick times in the middle of straight paths of several lengths."""
    rows = []
    for length_m in PATH_LENGTHS_M:
        x = np.arange(0.0, length_m, POSE_M)
        controller = closed_loops.make_controller(closed_loops.controller_params('mpcc'), 1.0)
        controller.set_reference(Reference(START_NS, x, 0.0 * x, 0.0 * x, x / SPEED_MPS))
        left, right = (np.column_stack((x, 0.0 * x + y)) for y in (HALF_WIDTH_M, -HALF_WIDTH_M))
        controller.set_edges(RoadEdges(START_NS, left, right))
        middle_m = length_m / 2
        obstacle = Obstacle(id=1, X=middle_m + 30.0, Y=1.8, vX=0.0, vY=0.0, r_obs=1.0)
        controller.set_obstacles(Obstacles(START_NS, (obstacle,)))
        records = []
        for tick in range(MEASURED_TICKS):
            t = tick * TICK_S
            X = middle_m - 20.0 + SPEED_MPS * t
            stamp_ns = conversions.add_seconds(START_NS, t)
            state = VehicleState(stamp_ns, X, 0.0, 0.0, SPEED_MPS, 0.0, 0.0)
            record = controller.step(TickInputs(state))
            began = time.perf_counter()
            controller.report(record)
            records.append((record, time.perf_counter() - began))
        rows.append({'path_m': length_m, 'poses': len(x), **row(tick_times(records))})
    return rows


def row(times: TickTimes) -> dict[str, float]:
    """Return the medians of a row of the scaling tables [ms]."""
    named = ('total', 'solve', 'outside', 'explain')
    return {f'{name}_ms': float(np.median(getattr(times, name))) for name in named}


def measure_ring() -> dict:
    """Return the wall time per tick of the node graph in lockstep, recorded."""
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, '-m', 'experiments.cli', 'run', SCENARIO]
        command += ['--controller', CONTROLLERS[0], '--out', folder]
        began = time.perf_counter()
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
        wall_s = time.perf_counter() - began
        bag = read.load(Path(folder) / SCENARIO / CONTROLLERS[0])
        report = bag_summary.timing_report(bag)
    period_ms = report['interval_ms']['mean']
    return {
        'tick_wall_ms': report['interval_ms'],
        'real_time_factor': TICK_S * MS / period_ms,
        'command_wall_s': wall_s,
        'parts_ms': report['parts_ms'],
    }


def tables(results: dict) -> list[str]:
    """Return the figures as tables."""
    kinds, quantile_names = ('explained', 'brief', 'evaluated'), ('median', 'p99', 'max')
    drives = [
        (
            name,
            *(number(MS * value) for value in one['drive_cpu_s'].values()),
            *(number(value) for value in one['real_time_factor'].values()),
        )
        for name, one in results['drives'].items()
    ]
    ticks = [
        (f'{name}: {part}', *(number(values[q]) for q in quantile_names))
        for name, one in results['drives'].items()
        for part, values in {
            'total': one['tick_ms'],
            **one['tick_ms']['by_part'],
            'explain, after it': one['explain_ms'],
        }.items()
    ]
    rates = results['parallel']['drives_per_s']
    beside = [(n, number(rate), number(rate / rates['1'])) for n, rate in rates.items()]
    listed = [
        markdown(
            f'A drive of {SCENARIO} in process, per core',
            ('controller', *(f'{k}, cpu ms' for k in kinds), *(f'{k}, x real time' for k in kinds)),
            drives,
        ),
        markdown(
            'State to command in process', ('part', *(f'{q} ms' for q in quantile_names)), ticks
        ),
        markdown(
            'Processes beside each other', ('processes', 'drives per second', 'speed-up'), beside
        ),
    ]
    if 'lengths' in results:
        fields = tuple(results['lengths'][0])
        rows = [
            tuple(number(v) if f.endswith('_ms') else f'{v:g}' for f, v in one.items())
            for one in results['lengths']
        ]
        listed.append(markdown('A tick by the length of the path, medians', fields, rows))
    if 'ring' in results:
        ring = results['ring']
        rows = [('mean wall time per tick, ms', number(ring['tick_wall_ms']['mean']))]
        rows += [('x real time', number(ring['real_time_factor']))]
        rows += [('`experiments run`, s', number(ring['command_wall_s']))]
        listed.append(markdown('The node graph in lockstep, recorded', ('', 'mpcc'), rows))
    return listed


def main() -> None:
    """Measure, print the tables, write the figures."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--repeats', type=int, default=10, help='drives per controller and kind')
    parser.add_argument('--scaling', action='store_true', help='ticks by length of the path')
    parser.add_argument('--ring', action='store_true', help='the node graph, too')
    parser.add_argument('--out', type=Path, default=Path(__file__).with_suffix('.md'))
    options = parser.parse_args()
    results = {
        'machine': machine.named(),
        'drives': {name: measure_drives(name, options.repeats) for name in CONTROLLERS},
        'parallel': measure_parallel(),
    }
    if options.scaling:
        results |= {'lengths': measure_lengths()}
    if options.ring:
        results['ring'] = measure_ring()
    listed = tables(results)
    print('\n'.join(listed))
    about = ', '.join(f'{key} {value}' for key, value in results['machine'].items())
    head = f'# The loop around the maths\n\n`python bench/loop.py`: {about}.\n\n{KINDS}\n\n'
    options.out.write_text(head + '\n'.join(listed))


if __name__ == '__main__':
    main()
