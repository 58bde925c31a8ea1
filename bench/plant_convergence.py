"""Error of the plant's 1 ms step and order of its integrator, manoeuvre by manoeuvre, as a table.

`python bench/plant_convergence.py [--friction F]`; the reference is a step of 0.1 ms.
"""

import argparse
from typing import NamedTuple

import numpy as np

from msgs_yaml.types import WHEELS
from vehicle_plant import integrator, parameters
from vehicle_plant.manoeuvre import MANOEUVRES
from vehicle_plant.manoeuvres import procedure, settings
from vehicle_plant.manoeuvres.procedure import Case, Run
from vehicle_plant.state import Trajectory

REFERENCE_S = integrator.STEP_S / 10
STEPS_S = (2 * integrator.STEP_S, integrator.STEP_S)
MOVING = 0.9  # of the time of a stop: until then no brake has stuck


class StepError(NamedTuple):
    """Greatest differences to the reference over a run, or over several."""

    position: float  # m
    yaw_rate: float  # rad/s
    acceleration: float  # m/s^2, of the CoG, either component
    slip: float  # -, transient slip of any wheel, either component

    def maximum(self, other: 'StepError') -> 'StepError':
        """Return the greater of each."""
        return StepError(*map(max, self, other))


def step_errors(run: Run, case: Case, steps_s: tuple[float, ...]) -> list[StepError]:
    """Return the error of each step [s] relative to a step of a tenth of a millisecond."""
    reference = procedure.drive(run, case, step_s=REFERENCE_S)
    return [_difference(procedure.drive(run, case, step_s=h), reference) for h in steps_s]


def _difference(trajectory: Trajectory, reference: Trajectory) -> StepError:
    """Compare at the common instants; the reference has every millisecond."""
    rows = (trajectory.stamp_ns - reference.stamp_ns[0]) // np.diff(reference.stamp_ns[:2])

    def greatest(*names):
        differences = (trajectory.column(n) - reference.column(n)[rows] for n in names)
        return max(float(np.abs(difference).max()) for difference in differences)

    return StepError(
        greatest('planar.X', 'planar.Y'),
        greatest('planar.r'),
        greatest('acceleration.ax', 'acceleration.ay'),
        greatest(*(f'wheels.{w}.{slip}' for w in WHEELS for slip in ('kappa', 'tan_alpha'))),
    )


def convergence_order(coarse: float, fine: float) -> float:
    """Return the order of convergence of two errors whose steps differ by a factor of two."""
    return float(np.log2(coarse / fine))


def cases(friction: float):
    """Yield the label, the runs and the case of each line of the table."""
    case = Case(parameters.load(), friction, settings.load())
    for name, manoeuvre in MANOEUVRES.items():
        runs = manoeuvre.runs(case)
        if name == 'straight_braking':
            stop = manoeuvre.numbers(case, runs, [procedure.drive(runs[0], case)])['stopping_time']
            moving = case.settings.settle_s + MOVING * stop.value
            yield f'{name}, moving', [run._replace(seconds=moving) for run in runs], case
            yield f'{name}, to rest', runs, case
        else:
            yield name, runs, case


def main() -> None:
    """Print the table in Markdown."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--friction', type=float, default=1.0, help='road friction scale')
    options = parser.parse_args()
    print(
        '| manoeuvre | position [m] | yaw rate [rad/s] | acceleration [m/s²] | slip [-] | order |'
    )
    print('|---|---|---|---|---|---|')
    for label, runs, case in cases(options.friction):
        (coarse, fine), *others = [step_errors(run, case, STEPS_S) for run in runs]
        for other_coarse, other_fine in others:
            coarse, fine = coarse.maximum(other_coarse), fine.maximum(other_fine)
        values = ' | '.join(f'{value:.1e}' for value in fine)
        order = convergence_order(coarse.acceleration, fine.acceleration)
        print(f'| {label} | {values} | {order:.1f} |', flush=True)


if __name__ == '__main__':
    main()
