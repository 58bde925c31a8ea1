"""Error of the plant's 1 ms step and order of its integrator, manoeuvre by manoeuvre, as a table.

`python bench/plant_convergence.py [--friction F]`; the reference is a step of 0.1 ms.
"""

import argparse

from vehicle_plant import integrator, parameters
from vehicle_plant.manoeuvre import MANOEUVRES
from vehicle_plant.manoeuvres import procedure, settings, verification

STEPS_S = (2 * integrator.STEP_S, integrator.STEP_S)
MOVING = 0.9  # of the time of a stop: until then no brake has stuck


def cases(friction: float):
    """Yield the label, the runs and the case of each line of the table."""
    case = procedure.Case(parameters.load(), friction, settings.load())
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
        both = [verification.step_errors(run, case, STEPS_S) for run in runs]
        coarse, fine = both[0]
        for more_coarse, more_fine in both[1:]:
            coarse, fine = coarse.or_greater(more_coarse), fine.or_greater(more_fine)
        shown = ' | '.join(f'{value:.1e}' for value in fine)
        order = verification.convergence_order(coarse.acceleration, fine.acceleration)
        print(f'| {label} | {shown} | {order:.1f} |', flush=True)


if __name__ == '__main__':
    main()
