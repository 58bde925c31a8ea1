"""How fast are a drive in process, its ticks and the node graph? Figures of docs/performance.md.

    .venv/bin/python bench/loop.py [--scaling] [--ring] [--cars PLANT CAR CAR ...]

Nothing else should run. Without options it times drives of `SCENARIO` in process; --scaling adds
how a tick grows with the length of the path and the number of obstacles, --ring a recorded drive of
the node graph in lockstep. Writes a page. --cars compares car files on a plant instead.
"""

import argparse
import gc
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from itertools import islice, product
from pathlib import Path

import numpy as np
import pandas as pd
import yaml
from tables import machine, markdown, number

from bags.evaluation import bag_summary
from bags.storage import read
from experiments import simulation
from experiments.families import scenario_document
from mpcc_controller.driving.controller import Controller
from mpcc_controller.driving.records import TickInputs, TickRecord
from msgs_yaml import conversions
from msgs_yaml.types import Obstacle, Obstacles, Reference, RoadEdges, VehicleState
from scenario_publisher import scenario
from scenario_publisher.scenario import Scenario

SCENARIO = 'double_lane_change'
CONTROLLERS = ('mpcc', 'mpcc_no_ca', 'frenet')
TICK_S = 0.05
MS = 1e3
WARM_TICKS = 5  # at the start, before code and data are in the caches of the processor
REPEATS = 10  # drives per controller and kind
PARALLEL_S = 4.0  # how long the drives beside each other go on
PATH_LENGTHS_M = (100.0, 1000.0, 20_000.0)
POSE_M = 0.5  # between two poses of these paths: 40,000 on the longest
MEASURED_TICKS = 40
KINDS = {
    'explained': 'a drive with all that would be recorded',
    'brief': 'without predictions and values of the plan',
    'evaluated': 'brief, as the metrics take it',
}
QUANTILES = {'median': 0.5, 'p99': 0.99, 'max': 1.0}
SPEED_MPS, HALF_WIDTH_M, START_NS = 15.0, 5.0, 10**9
OBSTACLES = (1, 5, 10, 20, 50)
LORRY_DISCS = tuple(2.1 * k for k in range(8))  # m
TURN_M, TURN_RADIUS_M, TURNS, SPACING_M = 60.0, 80.0, 8, 20.0
CROWD_TICKS = 300
GRADE = 'automotive'  # of sensors


def answered(controller: Controller, record: TickRecord) -> tuple[float, ...]:
    """Explain the answer of a tick; return its times [s], () where it solved not once."""
    began = time.perf_counter()
    controller.report(record)
    explain_s = time.perf_counter() - began
    if record.attempt is None:
        return ()
    solve_s = record.attempt.solution.solve_s
    return record.computing_s, record.attempt.prepare_s, solve_s, explain_s


def tick_times(rows: list[tuple[float, ...]]) -> pd.DataFrame:
    """Return the parts of ticks [ms] from their times [s].

    total     from the decoded state to the command
    prepare   projection, initial guess, numbers of the stages, bounds
    rest      delay compensation, choice, set-points, gate
    outside   what is no solver
    explain   after the command: /controller/prediction and /controller/why
    """
    columns = ['total', 'prepare', 'solve', 'explain']
    times = MS * pd.DataFrame([row for row in rows if row][WARM_TICKS:], columns=columns)
    outside = times.total - times.solve
    times = times.assign(rest=outside - times.prepare, outside=outside)
    return times[['total', 'prepare', 'solve', 'rest', 'outside', 'explain']]


def cpu_s(call: Callable[[], object]) -> float:
    """Return the processor time of a call [s]."""
    gc.collect()
    began = time.process_time()
    call()
    return time.process_time() - began


def measure_drives() -> list[str]:
    """Return the tables of drives and ticks of every controller."""
    drives, ticks = [], []
    for name in CONTROLLERS:
        setup = simulation.prepare(SCENARIO, name)
        driven_s = float(simulation.run(setup)['/vehicle/odometry'].t_s[-1])
        calls = (
            lambda setup=setup: simulation.run(setup),
            lambda setup=setup: simulation.run(setup, explain=False),
            lambda setup=setup: simulation.drive(setup),
        )
        # alternately: what disturbs the machine disturbs all of them
        seconds = np.median([[cpu_s(call) for call in calls] for _ in range(REPEATS)], axis=0)
        drives.append((name, *map(number, MS * seconds), *map(number, driven_s / seconds)))
        every = []
        for _ in range(REPEATS):
            steps = simulation.steps(setup)
            every.append(tick_times([answered(s.controller, s.record) for s in steps]))
        spread = (
            pd.concat(every)
            .quantile([*QUANTILES.values()])
            .rename(columns={'explain': 'explain, after it'})
        )
        ticks += [(f'{name}: {part}', *map(number, spread[part])) for part in spread]
    heads = [*(f'{kind}, cpu ms' for kind in KINDS), *(f'{kind}, x real time' for kind in KINDS)]
    return [
        markdown(f'A drive of {SCENARIO} in process, per core', ('controller', *heads), drives),
        markdown('State to command in process', ('part', *(f'{q} ms' for q in QUANTILES)), ticks),
    ]


def count_drives(_: int) -> float:
    """Return the drives per second of this process, without explaining."""
    setup = simulation.prepare(SCENARIO, CONTROLLERS[0])
    simulation.run(setup, explain=False)
    count, began = 0, time.perf_counter()
    while time.perf_counter() - began < PARALLEL_S:
        simulation.run(setup, explain=False)
        count += 1
    return count / (time.perf_counter() - began)


def measure_parallel() -> str:
    """Return the table of the drives per second of one process and of one per core."""
    rates = {}
    for workers in sorted({1, len(os.sched_getaffinity(0))}):
        with ProcessPoolExecutor(workers) as pool:
            rates[workers] = sum(pool.map(count_drives, range(workers)))
    rows = [(workers, number(rate), number(rate / rates[1])) for workers, rate in rates.items()]
    columns = ('processes', 'drives per second', 'speed-up')
    return markdown('Processes beside each other', columns, rows)


def measure_lengths() -> str:
    """Return the table of tick times in the middle of straight paths of several lengths."""
    setup = simulation.prepare(SCENARIO, CONTROLLERS[0])
    shown, rows = ['total', 'solve', 'outside', 'explain'], []
    for length_m in PATH_LENGTHS_M:
        x = np.arange(0.0, length_m, POSE_M)
        controller = Controller(setup.params, setup.vehicle)
        controller.set_reference(Reference(START_NS, x, 0.0 * x, 0.0 * x, x / SPEED_MPS))
        left, right = (np.column_stack((x, 0.0 * x + y)) for y in (HALF_WIDTH_M, -HALF_WIDTH_M))
        controller.set_edges(RoadEdges(START_NS, left, right))
        middle_m = length_m / 2
        obstacle = Obstacle(id=1, X=middle_m + 30.0, Y=1.8, vX=0.0, vY=0.0, r_obs=1.0)
        controller.set_obstacles(Obstacles(START_NS, (obstacle,)))
        times = []
        for tick in range(MEASURED_TICKS):
            t = tick * TICK_S
            X, stamp_ns = middle_m - 20.0 + SPEED_MPS * t, conversions.add_seconds(START_NS, t)
            state = VehicleState(stamp_ns, X, 0.0, 0.0, SPEED_MPS, 0.0, 0.0)
            times.append(answered(controller, controller.step(TickInputs(state))))
        medians = tick_times(times)[shown].median()
        rows.append((f'{length_m:g}', len(x), *map(number, medians)))
    columns = ('path_m', 'poses', *(f'{name}_ms' for name in shown))
    return markdown('A tick by the length of the path, medians', columns, rows)


def crowded(count: int, discs_m: tuple[float, ...]) -> Scenario:
    """Return a winding road with one slower vehicle ahead, the others in turn coming or parked."""
    lane, lengths = scenario_document.LANE, TURNS * TURN_M
    look = {'radius_m': scenario_document.CAR_RADIUS, 'discs_m': discs_m, 'motion': 'along_road'}
    places = [{'station_m': 40.0, 'offset_m': 0.0, 'along_mps': 0.7 * SPEED_MPS}]
    for k in range(1, count):
        station_m = 30.0 + SPACING_M * k / 2
        comes, parks = {'offset_m': lane, 'along_mps': -SPEED_MPS}, {'offset_m': -lane}
        places.append({'station_m': station_m, **(comes if k % 2 else parks)})
    turns = (scenario_document.arc(TURN_M, (-1) ** k / TURN_RADIUS_M) for k in range(TURNS))
    parts = scenario_document.document(
        description=f'{count} obstacles of {len(discs_m)} discs on a winding road.',
        length=lengths + 200.0,
        speed=SPEED_MPS,
        segments=[*turns, scenario_document.straight(200.0)],
        obstacles=[{**look, **place} for place in places],
    )
    return scenario.parse(yaml.safe_dump(parts), 'crowded.yaml')


def measure_obstacles() -> str:
    """Return the table of tick times by the number of obstacles, of one and of several discs."""
    rows = []
    for discs_m in ((0.0,), LORRY_DISCS):
        for count in OBSTACLES:
            setup = simulation.prepare_scenario(crowded(count, discs_m), 'mpcc_road')
            steps = islice(simulation.steps(setup), CROWD_TICKS)
            ticks = tick_times([answered(s.controller, s.record) for s in steps])
            found = [ticks.total.quantile(q) for q in QUANTILES.values()]
            found += [ticks.outside.median(), ticks.explain.median()]
            rows.append((len(discs_m), count, len(ticks), *map(number, found)))
    columns = ('discs', 'obstacles', 'ticks', *(f'{q}_ms' for q in QUANTILES))
    columns += ('outside_ms', 'explain_ms')
    return markdown('A tick of mpcc_road by the number of obstacles', columns, rows)


def measure_sensors() -> str:
    """Return the table of drives in process by the true state and by sensors, alternately."""
    rows, sensors = [], {'plant': {'sensors': f'sensors_{GRADE}.yaml'}}
    for name in (CONTROLLERS[0], 'mpcc_road'):
        setups = [simulation.prepare(SCENARIO, name, settings) for settings in ({}, sensors)]
        calls = [partial(simulation.run, setup, explain=False) for setup in setups]
        times = np.median([[cpu_s(call) for call in calls] for _ in range(REPEATS)], axis=0)
        rows.append((name, *map(number, MS * times), number(times[1] / times[0])))
    heads = ('controller', 'true state, cpu ms', f'{GRADE} sensors, cpu ms', 'ratio')
    return markdown('A drive with sensors and estimator, brief', heads, rows)


def measure_ring() -> str:
    """Return the table of the wall time of the node graph in lockstep, recorded."""
    rows = []
    for sensors in ((), ('--sensors', GRADE)):
        with tempfile.TemporaryDirectory() as folder:
            command = [sys.executable, '-m', 'experiments.cli', 'run', SCENARIO, *sensors]
            command += ['--controller', CONTROLLERS[0], '--out', folder]
            began = time.perf_counter()
            subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
            wall_s = time.perf_counter() - began
            bag = read.load(Path(folder) / SCENARIO / CONTROLLERS[0])
            period_ms = bag_summary.timing_report(bag)['interval_ms']['mean']
        what = ' '.join(('mpcc', *sensors))
        rows.append((what, *map(number, (period_ms, TICK_S * MS / period_ms, wall_s))))
    heads = ('', 'mean wall time per tick, ms', 'x real time', '`experiments run`, s')
    return markdown('The node graph in lockstep, recorded', heads, rows)


def measure_cars(plant: str, cars: list[str]) -> str:
    """Return the table of ticks by car file on a plant, driven alternately."""
    setups, ticks = {}, []
    for key in product((CONTROLLERS[0], 'mpcc_road'), cars):
        settings = {'plant': {'plant_params': plant}, 'controller': {'car_file': key[1]}}
        setups[key] = simulation.prepare(SCENARIO, key[0], settings)
    for _, (key, setup) in product(range(REPEATS), setups.items()):
        for step in islice(simulation.steps(setup), WARM_TICKS, None):
            solution = step.record.attempt.solution
            ms, count = MS * solution.cpu_s, solution.iterations
            ticks.append((*key, MS * step.record.computing_s, ms, ms / max(count, 1), count))
    columns = ['total_ms', 'solve_cpu_ms', 'iteration_cpu_ms', 'iterations']
    driven = pd.DataFrame(ticks, columns=['controller', 'car', *columns])
    rows = [
        (*key, len(own), *map(number, own[columns].median()), number(own.iterations.mean()))
        for key, own in driven.groupby(['controller', 'car'], sort=False)
    ]
    heads = ('controller', 'car', 'ticks', *columns, 'iterations, mean')
    return markdown(f'Ticks on {plant}, medians', heads, rows)


def main() -> None:
    """Measure, print the tables, write the figures."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--scaling', action='store_true', help='ticks by path and obstacles')
    parser.add_argument('--ring', action='store_true', help='the node graph, too')
    text = 'plant file, and two or more car files on it'
    parser.add_argument('--cars', nargs='+', metavar=('PLANT', 'CAR'), help=text)
    options = parser.parse_args()
    if options.cars:
        if len(options.cars) < 3:
            parser.error('--cars: needs a plant file and at least two car files')
        print(measure_cars(options.cars[0], options.cars[1:]))
        return
    about = ', '.join(f'{key} {value}' for key, value in machine().items())
    tables = [*measure_drives(), measure_parallel(), measure_sensors()]
    tables += [measure_lengths(), measure_obstacles()] if options.scaling else []
    tables += [measure_ring()] if options.ring else []
    print('\n'.join(tables))
    kinds = '; '.join(f'{kind}: {meaning}' for kind, meaning in KINDS.items())
    head = f'# The loop around the maths\n\n`python bench/loop.py`: {about}.\n\n{kinds}.\n\n'
    Path(__file__).with_suffix('.md').write_text(head + '\n'.join(tables))


if __name__ == '__main__':
    main()
