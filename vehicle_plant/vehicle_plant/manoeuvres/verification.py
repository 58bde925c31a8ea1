"""What the integrator's step leaves of the truth: a manoeuvre against itself in shorter steps.

Nobody's driving: random set-points on random friction, and what must hold all the same.

Full lock, locked wheels, full throttle, from standstill or at speed; every other sequence ends with
full brakes on. A sequence is a function of its seed.
"""

from typing import NamedTuple

import numpy as np

from msgs_yaml.types import WHEELS
from vehicle_plant import integrator
from vehicle_plant.manoeuvres import procedure
from vehicle_plant.manoeuvres.procedure import TICK_S, Case, Run
from vehicle_plant.state import SetPoints, Trajectory

REFERENCE_S = integrator.STEP_S / 10


class StepError(NamedTuple):
    """Greatest differences over a run, or over several."""

    position: float  # m
    yaw_rate: float  # rad/s
    acceleration: float  # m/s^2, of the CoG, either way
    slip: float  # -, transient slip of any wheel, either way

    def or_greater(self, other: 'StepError') -> 'StepError':
        """Return the greater of each."""
        return StepError(*map(max, self, other))


def step_errors(run: Run, case: Case, steps_s: tuple[float, ...]) -> list[StepError]:
    """Return the error with each step against a tenth of a millisecond."""
    reference = procedure.drive(run, case, step_s=REFERENCE_S)
    return [_between(procedure.drive(run, case, step_s=h), reference) for h in steps_s]


def _between(track: Trajectory, reference: Trajectory) -> StepError:
    """Compare at the instants that both have; the reference has every millisecond."""
    rows = (track.stamp_ns - reference.stamp_ns[0]) // np.diff(reference.stamp_ns[:2])

    def greatest(*names):
        return max(float(np.abs(track.column(n) - reference.column(n)[rows]).max()) for n in names)

    return StepError(
        greatest('planar.X', 'planar.Y'),
        greatest('planar.r'),
        greatest('acceleration.ax', 'acceleration.ay'),
        greatest(*(f'wheels.{w}.{slip}' for w in WHEELS for slip in ('kappa', 'tan_alpha'))),
    )


def convergence_order(coarse: float, fine: float) -> float:
    """Return the order that two errors show whose steps differ by a factor of two."""
    return float(np.log2(coarse / fine))


SPEEDS = (0.0, 0.05, 1.0, 8.0, 25.0, 45.0)  # m/s, or anything up to the last


FRICTION = (0.1, 1.2)  # -, of the road
HELD_S = (0.05, 1.0)  # s, each set-point

# wide of anything a driver sees, far inside nonsense
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

    def target(extremes, low, high):
        return float(rng.choice(extremes) if rng.random() < 1 / 2 else rng.uniform(low, high))

    ticks = round(seconds / TICK_S)
    held = []
    while len(held) < ticks:
        delta = target((-lock, 0.0, lock), -lock, lock)
        Fxf = target((-front.brake_n, 0.0), -front.brake_n, front.drive_n)
        Fxr = target((-rear.brake_n, 0.0, rear.drive_n), -rear.brake_n, rear.drive_n)
        held += [SetPoints(delta, Fxf, Fxr)] * max(round(rng.uniform(*HELD_S) / TICK_S), 1)
    if seed % 2:
        stop = SetPoints(held[-1].delta, -front.brake_n, -rear.brake_n)
        held[ticks // 2 :] = [stop] * (len(held) - ticks // 2)
    run = Run(f'seed {seed}', speed, seconds, lambda t, _: held[round(t / TICK_S) - 1])
    return run, friction


def drive_random_run(seed: int, case: Case, seconds: float) -> list[str]:
    """Drive a sequence; return what it broke, nothing on a sound plant."""
    run, friction = random_run(seed, case.plant, seconds)
    with np.errstate(all='ignore'):
        track = procedure.drive(run, case._replace(friction=friction))
    return violated_bounds(track, run, friction, case.plant)


def violated_bounds(track: Trajectory, run: Run, friction: float, plant) -> list[str]:
    """Return a line for every limit that a track passes."""
    if not np.isfinite(track.rows).all():
        return ['a number is not finite']
    car = plant.car
    weight = car.body.mass_kg * car.body.gravity_mps2
    speed = np.hypot(track.column('planar.vx'), track.column('planar.vy')).max()
    engine = run.seconds * (car.force.rear.drive_n + car.force.front.drive_n) / car.body.mass_kg
    found = {
        'speed': (speed, run.speed + engine + EXTRA_MPS),
        'roll': (np.abs(track.column('ride.phi')).max(), ROLL_RAD),
        'pitch': (np.abs(track.column('ride.theta')).max(), PITCH_RAD),
        'heave': (np.abs(track.column('ride.z')).max(), HEAVE_M),
        'steer': (np.abs(track.column('servos.steer.position')).max(), car.steering.limit_rad),
    }
    for w in WHEELS:
        Fx, Fy, Fz = (track.column(f'loads.{w}.{name}') for name in ('Fx', 'Fy', 'Fz'))
        spare = np.hypot(Fx, Fy) - FORCE_PER_GRIP * friction * Fz
        found[f'{w} force beyond grip'] = (spare.max(), FORCE_N)
        found[f'{w} load'] = (Fz.max(), LOAD_PER_WEIGHT * weight)
        found[f'{w} wind-up'] = (np.abs(track.column(f'wheels.{w}.windup')).max(), 1.0)
        for slip in ('kappa', 'tan_alpha'):
            greatest = np.abs(track.column(f'wheels.{w}.{slip}')).max()
            found[f'{w} {slip}'] = (greatest, SLIP * car.wheel.greatest_slip)
    return [f'{k} is {v:.6g}, limit {most:.6g}' for k, (v, most) in found.items() if v > most]
