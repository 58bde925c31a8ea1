"""Simulate scenarios drawn at random and check every run: a program and its parts.

    python tests/closed_loop/drive_draws.py --seed 7 --draws 1000 --workers 2
    python tests/closed_loop/drive_draws.py --seed 7 --only 417 --keep DIR

The first simulates 1,000 of them and prints a summary; the second repeats one of them and writes
its scenario and report into DIR. Without either it simulates the draw numbers that it reads from
its input, and prints one line of JSON each: so it is used by test_random_scenarios.
"""

import argparse
import collections
import json
import os
import queue
import sys
import tempfile
import time
import traceback
from concurrent.futures import ThreadPoolExecutor, as_completed
from pathlib import Path
from typing import Any

os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')
os.environ.setdefault('MPLBACKEND', 'Agg')

sys.path.insert(0, str(Path(__file__).parents[1] / 'helpers'))
import independent_evaluation
import numpy as np
import random_scenarios
from draw_driver import Driver
from evaluated_drives import compare_drives
from independent_evaluation import Body, Motion
from random_scenarios import Draw

from bags.evaluation import metrics
from bags.evaluation.drive import drive_from_columns
from experiments import simulation
from msgs_yaml import conformance, encode
from msgs_yaml.types import Actuators, Command, Imu, VehicleState, Wheels
from vehicle_plant.gate import Gate
from vehicle_plant.state import SetPoints

TICK_S = 0.05
GRAVITY = 9.81
NEAREST = 1e-3  # m, between two evaluations of one number
# m and deg; each evaluation samples the outline at points of its own
NEAR = {'beyond_edge_m': 0.1, 'peak_sideslip_deg': 0.01}
VERDICTS = ('completed', 'collided', 'left_road', 'lost', 'spun')
ROUNDING = 1e-6  # relative, of a command on its limit
REPORT_EVERY = 60  # draws: figures and report take up to 9 s
ENCODE = {
    '/scenario/reference': encode.reference,
    '/scenario/road_edges': encode.road_edges,
    '/scenario/obstacles': encode.obstacles,
    '/controller/prediction': encode.prediction,
    '/controller/why': encode.why,
}
ENCODE_ROWS = {
    '/vehicle/odometry': (VehicleState, encode.odometry),
    '/vehicle/actuators': (Actuators, encode.actuators),
    '/vehicle/imu': (Imu, encode.imu),
    '/vehicle/wheels': (Wheels, encode.wheels),
    '/controller/command': (Command, encode.command),
}


def check(seed: int, index: int, keep: Path | None = None) -> dict[str, Any]:
    """Simulate one draw; return `index`, `findings` (a list of texts) and numbers of the run."""
    began = time.process_time()
    result = {'index': index, 'controller': None, 'findings': []}
    try:
        draw = random_scenarios.draw(seed, index)
        result['controller'] = draw.controller
        with tempfile.TemporaryDirectory() as folder:
            out = keep or Path(folder)
            file = out / f'draw_{index}.yaml'
            file.write_text(draw.text)
            result |= _simulate(draw, file, out if keep or not index % REPORT_EVERY else None)
    except Exception:
        result['findings'] = [traceback.format_exc()]
    return result | {'cpu_s': round(time.process_time() - began, 3)}


def _simulate(draw: Draw, file: Path, report: Path | None) -> dict[str, Any]:
    setup = simulation.prepare(str(file), draw.controller)
    scn = setup.scn
    scn = scn._replace(start=draw.start or scn.start, stop=scn.stop._replace(time=draw.time_s))
    setup = setup._replace(scn=scn)
    params, plant = setup.params, setup.plant
    columns = simulation.run(setup)
    drive = drive_from_columns(columns, simulation.run_info(setup), setup.controller)
    values = metrics.compute_metrics(drive)
    json.dumps(values, allow_nan=False)
    if report:
        written = compare_drives({setup.controller: drive}, report / 'report')
        json.loads(written.file.read_text(), parse_constant=_refuse_constant)
    second = _evaluate(scn, columns['/vehicle/odometry'], params, plant)
    findings = [
        *_finite(columns),
        *_commands(columns, params, setup.vehicle),
        *_plant_gate(columns['/controller/command'], plant, setup.friction),
        *_contract(columns),
        *_compare_evaluations(second, values, params),
    ]
    whys = [report.values for report in columns['/controller/why'].values]
    return {
        'findings': findings,
        'ticks': len(whys),
        'beyond_schema': draw.start is not None,
        'rejections': max(why.get('gate.rejections', 0) for why in whys),
        'reasons': dict(collections.Counter(f'{why["rung"]}: {why["reason"]}' for why in whys)),
        'unsure': [key for key in VERDICTS if getattr(second, key) is None],
        **{
            key: values.get(key)
            for key in ('completed', 'collided', 'left_road', 'lost', 'fallbacks')
        },
    }


def _refuse_constant(word):
    raise ValueError(f'comparison.json holds {word}')


def _evaluate(scn, odometry, params, plant):
    car = plant.car
    body = Body(
        car.body.cog_to_front_m + car.outline.front_overhang_m,
        car.body.cog_to_rear_m + car.outline.rear_overhang_m,
        car.outline.width_m,
        params.body.circle_radius_m,
        tuple(params.body.circle_offsets_m),
    )
    o = odometry
    motion = Motion(o.stamp_ns, o.x_m, o.y_m, o.yaw_rad, o.vx_mps, o.vy_mps)
    return independent_evaluation.evaluate(scn, motion, body)


def _finite(columns):
    for topic, table in columns.items():
        if hasattr(table, 'values'):
            continue
        for name, column in vars(table).items():
            if not np.all(np.isfinite(column)):
                yield f'{topic}: {name} is not finite'


def _commands(columns, params, vehicle):
    """Yield the limits of the controller's parameters that the commands violate."""
    command = columns['/controller/command']
    limits, car = params.limits, vehicle.car
    force = command.front_x_n + command.rear_x_n
    steer_step = np.diff(command.steer_rad, prepend=0.0)
    force_step = np.diff(force, prepend=0.0)
    weight, wheelbase = car.mass_kg * GRAVITY, car.cog_to_front_m + car.cog_to_rear_m
    front = (weight * car.cog_to_rear_m - car.cog_height_m * force) / wheelbase
    rear = (weight * car.cog_to_front_m + car.cog_height_m * force) / wheelbase
    believed = params.model.friction
    of_grip = {
        'front force over friction': command.front_x_n / (vehicle.tyre.front_friction * front),
        'rear force over friction': command.rear_x_n / (vehicle.tyre.rear_friction * rear),
    }
    bounds = {
        'steer': (command.steer_rad, -limits.steer_rad, limits.steer_rad),
        'steer rate': (steer_step / TICK_S, -limits.steer_rate_radps, limits.steer_rate_radps),
        'force': (force, -limits.brake_n, limits.drive_n),
        'force rate': (force_step / TICK_S, -limits.force_rate_nps, limits.force_rate_nps),
        **{name: (share, -believed, believed) for name, share in of_grip.items()},
    }
    for name, (values, low, high) in bounds.items():
        spare = ROUNDING * (high - low)
        bad = np.flatnonzero(~((low - spare <= values) & (values <= high + spare)))
        if bad.size:
            yield f'command {bad[0]}: {name} is {values[bad[0]]:.9g}, allowed {low:g} to {high:g}'
    if not np.all(np.diff(command.stamp_ns) == round(TICK_S * 1e9)):
        yield 'commands do not come once per tick'


def _plant_gate(command, plant, friction):
    """Yield the commands that the plant rejects."""
    gate = Gate(plant, friction, SetPoints(0.0, 0.0, 0.0), int(command.stamp_ns[0]))
    for k, row in enumerate(zip(*command)):
        stamp_ns, _, delta, d_delta, front, rear = row
        sent = Command(int(stamp_ns), delta, d_delta, front, rear)
        verdict = gate.check(sent, sent.stamp_ns, round(TICK_S * 1e9))
        if not verdict.accepted:
            yield f'command {k}: refused by the plant: {verdict.reason}'


def _contract(columns):
    """Yield the fields that violate the contract of the topics, with the first such message.

    Of tables the rows with the minimum or maximum of a column are checked.
    """
    breaches = {}
    for topic, value in _messages(columns):
        for breach in conformance.check(topic, value):
            breaches.setdefault((topic, breach.field), str(breach))
    yield from breaches.values()


def _messages(columns):
    for topic, encoded in ENCODE.items():
        yield from ((topic, encoded(value)) for value in columns[topic].values)
    for topic, (form, encoded) in ENCODE_ROWS.items():
        stamps, _, *fields = columns[topic]
        flat = np.column_stack(fields)
        for k in sorted({*np.argmin(flat, axis=0), *np.argmax(flat, axis=0)}):
            row = [tuple(map(float, f[k])) if f.ndim > 1 else float(f[k]) for f in fields]
            yield topic, encoded(form(int(stamps[k]), *row))


def _compare_evaluations(second, values, params):
    """Yield the differences between the metrics and the independent evaluation."""
    pairs = [('min_outline_gap_m', second.outline, values['min_outline_gap_m'])]
    pairs += [
        (f'min_v2o_per_obstacle_m.{number}', gap, values['min_v2o_per_obstacle_m'].get(str(number)))
        for number, gap in second.v2o.items()
    ]
    pairs += [
        (f'min_v2e_per_edge_m.{side}', gap, values['min_v2e_per_edge_m'][side])
        for side, gap in second.v2e.items()
    ]
    least = min((gap for gap in second.v2o.values() if gap is not None), default=None)
    pairs += [('min_v2o_m', least, values['min_v2o_m'])]
    pairs += [('min_v2e_m', min(second.v2e.values()), values['min_v2e_m'])]
    pairs += [('peak_sideslip_deg', second.sideslip, values['peak_sideslip_deg'])]
    if second.left_road:
        pairs += [('beyond_edge_m', second.beyond, values['beyond_edge_m'])]
    for name, own, other in pairs:
        if (own is None) != (other is None) or (
            own is not None and abs(own - other) > NEAR.get(name, NEAREST)
        ):
            yield f'{name} is {other}, the independent evaluation has {own}'
    verdicts = {**values, 'spun': values['lost_how'] == 'spun'}
    for name in VERDICTS:
        own = getattr(second, name)
        if own is not None and verdicts[name] is not own:
            yield f'{name} is {verdicts[name]}, the independent evaluation has {own}'
    gaps = [(least, params.safety.obstacle_m), (min(second.v2e.values()), params.safety.edge_m)]
    gaps = [gap - safe for gap, safe in gaps if gap is not None]
    if abs(min(gaps)) > NEAREST and values['entered_unsafe_area'] is not (min(gaps) < 0.0):
        yield f'entered_unsafe_area is {values["entered_unsafe_area"]}, the gap is {min(gaps)}'


def main(arguments: list[str] | None = None) -> int:
    """Run the program and return its exit code: 1 with findings."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--seed', type=int, required=True)
    parser.add_argument(
        '--draws', type=int, help='simulate the draws from 0 to this, and summarise'
    )
    parser.add_argument('--only', type=int, help='simulate this draw')
    parser.add_argument('--keep', type=Path, help='a folder for its scenario and report')
    parser.add_argument('--workers', type=int, default=1)
    args = parser.parse_args(arguments)
    if args.only is not None:
        if args.keep:
            args.keep.mkdir(parents=True, exist_ok=True)
        result = check(args.seed, args.only, args.keep)
        print(json.dumps(result, indent=2).replace('\\n', '\n'))
        return bool(result['findings'])
    if args.draws is None:
        _serve(args.seed)
        return 0
    return _series(args.seed, args.draws, args.workers)


def _serve(seed):
    # output of libraries must not mix with the answers
    answers = os.fdopen(os.dup(sys.stdout.fileno()), 'w')
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())
    for line in sys.stdin:
        print(json.dumps(check(seed, int(line))), file=answers, flush=True)


def _series(seed, draws, workers):
    began, results = time.monotonic(), []
    drivers = queue.SimpleQueue()
    for _ in range(workers):
        drivers.put(Driver(seed))

    def driven(index):
        driver = drivers.get()
        try:
            return driver.drive(index)
        finally:
            drivers.put(driver)

    with ThreadPoolExecutor(workers) as pool:
        for future in as_completed([pool.submit(driven, k) for k in range(draws)]):
            result = future.result()
            results.append(result)
            for text in result['findings']:
                print(f'draw {result["index"]} ({result.get("controller")}): {text}', flush=True)
    for _ in range(workers):
        drivers.get().end()
    minutes = (time.monotonic() - began) / 60.0
    cpu_s = sum(one.get('cpu_s', 0.0) for one in results)
    driven = [one for one in results if 'ticks' in one]
    print(f'seed {seed}: {draws} draws, {minutes:.1f} min, {cpu_s:.0f} s of processor')
    print(f'with findings: {sum(bool(one["findings"]) for one in results)}')
    print(f'ticks: {sum(one["ticks"] for one in driven)}')
    for key in ('completed', 'collided', 'left_road', 'lost', 'beyond_schema', 'rejections'):
        count = sum(bool(one[key]) for one in driven)
        print(f'{key}: {count} ({100.0 * count / max(1, len(driven)):.1f} %)')
    unsure = collections.Counter(key for one in driven for key in one['unsure'])
    print(f'undecided in the independent evaluation: {dict(unsure)}')
    reasons = collections.Counter()
    for one in driven:
        reasons.update(one['reasons'])
    for reason, count in reasons.most_common():
        print(f'  {count:6d} ticks {reason}')
    return int(any(one['findings'] for one in results))


if __name__ == '__main__':
    sys.exit(main())
