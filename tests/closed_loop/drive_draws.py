"""Drive scenarios that were drawn at random, and check every drive: a program and its parts.

    python tests/closed_loop/drive_draws.py --seed 7 --draws 1000 --workers 2
    python tests/closed_loop/drive_draws.py --seed 7 --only 417 --keep DIR

The first drives 1,000 of them and prints what came out; the second drives one of them again and
writes its scenario and its report into DIR. Without either it drives the numbers that it reads
from its input, one line of JSON each: so it is used by test_random_scenarios.
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

import independent_verdict
import numpy as np
import random_scenarios
from draw_driver import Driver
from independent_verdict import Body, Motion
from random_scenarios import Draw

from bags.evaluation import metrics
from bags.evaluation.drive import drive_from_columns
from bags.report.comparison import compare_drives
from experiments import simulation
from msgs_yaml import conformance, encode
from msgs_yaml.types import Actuators, Command, Imu, VehicleState, Wheels
from vehicle_plant.gate import Gate
from vehicle_plant.state import SetPoints

TICK_S = 0.05
GRAVITY = 9.81
NEAREST = 1e-3  # m: two judges of one number
# m and deg; of the outline each judge looks at points of its own
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
    """Drive one draw and return `index`, `findings` (a list of texts) and figures of the drive."""
    began = time.process_time()
    result = {'index': index, 'controller': None, 'findings': []}
    try:
        one = random_scenarios.draw(seed, index)
        result['controller'] = one.controller
        with tempfile.TemporaryDirectory() as folder:
            place = keep or Path(folder)
            file = place / f'draw_{index}.yaml'
            file.write_text(one.text)
            result |= _driven(one, file, place if keep or not index % REPORT_EVERY else None)
    except Exception:
        result['findings'] = [traceback.format_exc()]
    return result | {'cpu_s': round(time.process_time() - began, 3)}


def _driven(one: Draw, file: Path, report: Path | None) -> dict[str, Any]:
    setup = simulation.prepare(str(file), one.controller)
    scn = setup.scn
    scn = scn._replace(start=one.start or scn.start, stop=scn.stop._replace(time=one.time_s))
    setup = setup._replace(scn=scn)
    params, plant = setup.params, setup.plant
    columns = simulation.run(setup)
    drive = drive_from_columns(columns, simulation.run_info(setup), setup.controller)
    found = metrics.compute_metrics(drive)
    json.dumps(found, allow_nan=False)
    if report:
        written = compare_drives({setup.controller: drive}, report / 'report')
        json.loads(written.file.read_text(), parse_constant=_refuse_constant)
    judged = _judged(scn, columns['/vehicle/odometry'], params, plant)
    findings = [
        *_finite(columns),
        *_commands(columns, params, setup.vehicle),
        *_plant_gate(columns['/controller/command'], plant, setup.friction),
        *_contract(columns),
        *_verdicts(judged, found, params),
    ]
    whys = [one.values for one in columns['/controller/why'].values]
    return {
        'findings': findings,
        'ticks': len(whys),
        'beyond_schema': one.start is not None,
        'rejections': max(why.get('gate.rejections', 0) for why in whys),
        'reasons': dict(collections.Counter(f'{why["rung"]}: {why["reason"]}' for why in whys)),
        'unsure': [key for key in VERDICTS if getattr(judged, key) is None],
        **{
            key: found.get(key)
            for key in ('completed', 'collided', 'left_road', 'lost', 'fallbacks')
        },
    }


def _refuse_constant(word):
    raise ValueError(f'comparison.json holds {word}')


def _judged(scn, odometry, params, plant):
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
    return independent_verdict.judge(scn, motion, body)


def _finite(columns):
    for topic, table in columns.items():
        if hasattr(table, 'values'):
            continue
        for name, column in table._asdict().items():
            if not np.all(np.isfinite(column)):
                yield f'{topic}: {name} is not finite'


def _commands(columns, params, vehicle):
    """Say which limits of the controller's parameters the commands break."""
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
    """Say which commands the plant refuses."""
    gate = Gate(plant, friction, SetPoints(0.0, 0.0, 0.0), int(command.stamp_ns[0]))
    for k, row in enumerate(zip(*command)):
        stamp_ns, _, delta, d_delta, front, rear = row
        told = Command(int(stamp_ns), delta, d_delta, front, rear)
        verdict = gate.check(told, told.stamp_ns, round(TICK_S * 1e9))
        if not verdict.accepted:
            yield f'command {k}: refused by the plant: {verdict.reason}'


def _contract(columns):
    """Say which fields the contract of the topics refuses, with the first message that breaks it.

    Of tables the rows count in which a column is least or largest.
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


def _verdicts(judged, found, params):
    """Say where the two judges disagree."""
    pairs = [('min_outline_gap_m', judged.outline, found['min_outline_gap_m'])]
    pairs += [
        (f'min_v2o_per_obstacle_m.{number}', gap, found['min_v2o_per_obstacle_m'].get(str(number)))
        for number, gap in judged.v2o.items()
    ]
    pairs += [
        (f'min_v2e_per_edge_m.{side}', gap, found['min_v2e_per_edge_m'][side])
        for side, gap in judged.v2e.items()
    ]
    least = min((gap for gap in judged.v2o.values() if gap is not None), default=None)
    pairs += [('min_v2o_m', least, found['min_v2o_m'])]
    pairs += [('min_v2e_m', min(judged.v2e.values()), found['min_v2e_m'])]
    pairs += [('peak_sideslip_deg', judged.sideslip, found['peak_sideslip_deg'])]
    if judged.left_road:
        pairs += [('beyond_edge_m', judged.beyond, found['beyond_edge_m'])]
    for name, mine, theirs in pairs:
        if (mine is None) != (theirs is None) or (
            mine is not None and abs(mine - theirs) > NEAR.get(name, NEAREST)
        ):
            yield f'{name} is {theirs}, the second judge says {mine}'
    said = {**found, 'spun': found['lost_how'] == 'spun'}
    for name in VERDICTS:
        mine = getattr(judged, name)
        if mine is not None and said[name] is not mine:
            yield f'{name} is {said[name]}, the second judge says {mine}'
    gaps = [(least, params.safety.obstacle_m), (min(judged.v2e.values()), params.safety.edge_m)]
    gaps = [gap - safe for gap, safe in gaps if gap is not None]
    if abs(min(gaps)) > NEAREST and found['entered_unsafe_area'] is not (min(gaps) < 0.0):
        yield f'entered_unsafe_area is {found["entered_unsafe_area"]}, the gap is {min(gaps)}'


def main(arguments: list[str] | None = None) -> int:
    """Run the program and return its exit code: 1 when anything was found."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--seed', type=int, required=True)
    parser.add_argument('--draws', type=int, help='drive the draws from 0 to this, and sum up')
    parser.add_argument('--only', type=int, help='drive this draw')
    parser.add_argument('--keep', type=Path, help='a folder for its scenario and report')
    parser.add_argument('--workers', type=int, default=1)
    given = parser.parse_args(arguments)
    if given.only is not None:
        if given.keep:
            given.keep.mkdir(parents=True, exist_ok=True)
        result = check(given.seed, given.only, given.keep)
        print(json.dumps(result, indent=2).replace('\\n', '\n'))
        return bool(result['findings'])
    if given.draws is None:
        _serve(given.seed)
        return 0
    return _series(given.seed, given.draws, given.workers)


def _serve(seed):
    # what a library prints must not stand between the answers
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
            one = future.result()
            results.append(one)
            for text in one['findings']:
                print(f'draw {one["index"]} ({one.get("controller")}): {text}', flush=True)
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
    print(f'no verdict of the second judge: {dict(unsure)}')
    reasons = collections.Counter()
    for one in driven:
        reasons.update(one['reasons'])
    for reason, count in reasons.most_common():
        print(f'  {count:6d} ticks {reason}')
    return int(any(one['findings'] for one in results))


if __name__ == '__main__':
    sys.exit(main())
