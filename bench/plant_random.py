"""Random set-points on random friction: the motion of the plant stays finite and bounded.

`python bench/plant_random.py [--runs 10000] [--first 0] [--seconds 3] [--processes 1]`; ends with
exit code 1 and the seeds when a sequence breaks a bound.

Full lock, locked wheels, full throttle, from standstill or at speed; every other sequence ends with
full brakes on. A sequence is a function of its seed.
"""

import argparse
import sys
import time
from functools import cache, partial
from multiprocessing import Pool

import numpy as np

from msgs_yaml.types import WHEELS
from vehicle_plant import parameters
from vehicle_plant.manoeuvres import procedure, settings
from vehicle_plant.manoeuvres.procedure import TICK_S, Case, Run
from vehicle_plant.state import SetPoints, Trajectory

CHUNK = 50
SPEEDS = (0.0, 0.05, 1.0, 8.0, 25.0, 45.0)  # m/s, or anything up to the last
FRICTION = (0.1, 1.2)  # -, of the road
HELD_S = (0.05, 1.0)  # s, each set-point

# bounds far beyond normal driving, far inside what is impossible
FORCE_PER_GRIP = 1.4  # -, tyre force over friction times load: more at low load, camber
FORCE_N = 10.0  # N beside that, of a lifted tyre
LOAD_PER_WEIGHT = 1.1  # -, load of one wheel over the weight of the car
ROLL_RAD, PITCH_RAD, HEAVE_M = 0.15, 0.1, 0.08
EXTRA_MPS = 0.2  # m/s beyond what the engine can give: springs
SLIP = 1.01  # -, transient slip over its greatest value


def random_run(seed: int, plant, seconds: float) -> tuple[Run, float]:
    """Return a run and the friction of its road."""
    rng = np.random.default_rng(seed)
    car = plant.car
    lock, front, rear = car.steering.limit_rad, car.force.front, car.force.rear
    friction = float(rng.uniform(*FRICTION))
    speed = float(rng.choice(SPEEDS) if rng.random() < 1 / 2 else rng.uniform(0, SPEEDS[-1]))

    def draw(extremes, low, high):
        return float(rng.choice(extremes) if rng.random() < 1 / 2 else rng.uniform(low, high))

    ticks = round(seconds / TICK_S)
    held = []
    while len(held) < ticks:
        delta = draw((-lock, 0.0, lock), -lock, lock)
        Fxf = draw((-front.brake_n, 0.0), -front.brake_n, front.drive_n)
        Fxr = draw((-rear.brake_n, 0.0, rear.drive_n), -rear.brake_n, rear.drive_n)
        held += [SetPoints(delta, Fxf, Fxr)] * max(round(rng.uniform(*HELD_S) / TICK_S), 1)
    if seed % 2:
        stop = SetPoints(held[-1].delta, -front.brake_n, -rear.brake_n)
        held[ticks // 2 :] = [stop] * (len(held) - ticks // 2)
    run = Run(f'seed {seed}', speed, seconds, lambda t, _: held[round(t / TICK_S) - 1])
    return run, friction


def drive_random_run(seed: int, case: Case, seconds: float) -> list[str]:
    """Drive a sequence; return the bounds that it breaks."""
    run, friction = random_run(seed, case.plant, seconds)
    with np.errstate(all='ignore'):
        trajectory = procedure.drive(run, case._replace(friction=friction))
    return violated_bounds(trajectory, run, friction, case.plant)


def violated_bounds(trajectory: Trajectory, run: Run, friction: float, plant) -> list[str]:
    """Return a line for every bound that a trajectory exceeds."""
    if not np.isfinite(trajectory.rows).all():
        return ['a number is not finite']
    column, car = trajectory.column, plant.car
    weight = car.body.mass_kg * car.body.gravity_mps2
    speed = np.hypot(column('planar.vx'), column('planar.vy')).max()
    engine = run.seconds * (car.force.rear.drive_n + car.force.front.drive_n) / car.body.mass_kg
    extremes = {
        'speed': (speed, run.speed + engine + EXTRA_MPS),
        'roll': (np.abs(column('ride.phi')).max(), ROLL_RAD),
        'pitch': (np.abs(column('ride.theta')).max(), PITCH_RAD),
        'heave': (np.abs(column('ride.z')).max(), HEAVE_M),
        'steer': (np.abs(column('servos.steer.position')).max(), car.steering.limit_rad),
    }
    for w in WHEELS:
        Fx, Fy, Fz = (column(f'loads.{w}.{name}') for name in ('Fx', 'Fy', 'Fz'))
        excess = np.hypot(Fx, Fy) - FORCE_PER_GRIP * friction * Fz
        extremes[f'{w} force beyond grip'] = (excess.max(), FORCE_N)
        extremes[f'{w} load'] = (Fz.max(), LOAD_PER_WEIGHT * weight)
        extremes[f'{w} wind-up'] = (np.abs(column(f'wheels.{w}.windup')).max(), 1.0)
        for slip in ('kappa', 'tan_alpha'):
            greatest = np.abs(column(f'wheels.{w}.{slip}')).max()
            extremes[f'{w} {slip}'] = (greatest, SLIP * car.wheel.greatest_slip)
    exceeded = {name: pair for name, pair in extremes.items() if pair[0] > pair[1]}
    return [
        f'{name} is {value:.6g}, limit {limit:.6g}' for name, (value, limit) in exceeded.items()
    ]


@cache
def default_case() -> Case:
    """Return the default car; the sequences have their own friction."""
    return Case(parameters.load(), 1.0, settings.load())


def drive(seed: int, seconds: float) -> tuple[int, list[str]]:
    """Return the seed and the bounds that its sequence breaks."""
    return seed, drive_random_run(seed, default_case(), seconds)


def main() -> int:
    """Drive; return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--runs', type=int, default=10000, help='number of sequences')
    parser.add_argument('--first', type=int, default=0, help='seed of the first one')
    parser.add_argument('--seconds', type=float, default=3.0, help='length of each')
    parser.add_argument('--processes', type=int, default=1)
    options = parser.parse_args()
    begin, failed = time.perf_counter(), 0
    seeds = range(options.first, options.first + options.runs)
    with Pool(options.processes) as pool:
        results = pool.imap(partial(drive, seconds=options.seconds), seeds, chunksize=CHUNK)
        for seed, violations in results:
            failed += bool(violations)
            for line in violations:
                print(f'seed {seed}: {line}', flush=True)
    elapsed = time.perf_counter() - begin
    print(f'{options.runs} sequences of {options.seconds:g} s, {failed} failed, {elapsed:.0f} s')
    return 1 if failed else 0


if __name__ == '__main__':
    sys.exit(main())
