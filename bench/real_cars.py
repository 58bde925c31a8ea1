"""Fit the controllers' car to the measured drives of four cars, and judge it on those held out.

    python bench/real_cars.py FOLDER --out DIR [--car volvo_v40]

FOLDER has a folder for each car with the files of bench/real_cars/frozen.yaml, which
docs/real_cars.md says how to obtain; ferrari_250lm.csv is one file, split at half of its time.
Every variant of the model is fitted and judged; DIR receives car files, figures, results.md.
"""

import argparse
from pathlib import Path

import numpy as np
import yaml
from tables import markdown

from experiments.measured import log_map, measured_log, report, single_track_fit, validation
from vehicle_plant import parameters

HERE = Path(__file__).parent / 'real_cars'
PUBLISHED = {'cog_to_front_m': 0.0}  # the place of the CoG, which none of these logs tells
VARIANTS = {  # what is fixed, and whether the steering gives way
    validation.PREDICTION: (PUBLISHED, False),
    'CoG fitted': ({}, False),
    'with steering compliance': (PUBLISHED, True),
}
PLANTS = {'volvo_v40': 'volvo_v40.yaml', 'vw_gti': 'vw_gti.yaml'}
LIMIT_MPS2 = 6.0


def load(folder: Path, car: str, files: dict, known: log_map.LogMap) -> tuple[list, list]:
    """Return the logs to fit and those held out."""
    if (folder / f'{car}.csv').is_file():
        log = measured_log.load(folder / f'{car}.csv', known)
        half = len(log.t) // 2
        parts = (slice(0, half), 'first half'), (slice(half, None), 'second half')
        halves = [
            log._replace(name=name, **{n: getattr(log, n)[rows] for n in log._fields[1:-1]})
            for rows, name in parts
        ]
        return halves[:1], halves[1:]
    return tuple(
        [measured_log.load(folder / name, known) for name in files[kind]]
        for kind in ('fit', 'held_out')
    )


def judge(car: str, folder: Path, files: dict, out: Path) -> str:
    """Fit every variant to a car's logs, and return the tables as Markdown."""
    known = log_map.load(HERE / f'{car}.yaml')
    logs, held_out = load(folder, car, files, known)
    fitted, manoeuvres, ahead = [], [], []
    plant_file = parameters.config_file(PLANTS[car]) if car in PLANTS else None
    plant = parameters.load(plant_file) if plant_file and plant_file.is_file() else None
    ours = validation.PREDICTION
    for name, (fixed, compliant) in VARIANTS.items():
        fit = single_track_fit.fit(logs, known.car, fixed, compliant)
        for key, value in fit.values.items():
            half = f'± {fit.half_widths[key]:.2g}' if key in fit.half_widths else 'fixed'
            told = 'not told' if key in fit.vague else ''
            fitted.append((name, key, f'{value:.5g}', half, told))
        vehicle = report.fitted_car(known.car, fit)
        first = name == ours
        stem = out / f'car_{car}{"" if first else "_" + name.replace(" ", "_")}'
        report.write_car(stem.with_suffix('.yaml'), known.car, fit, [log.name for log in logs])
        found = validation.validate(held_out, vehicle, fit, plant if first else None)
        if first:
            report.write(found, out / car, f'{car}, held out')
        for m in found.manoeuvres:
            models = m.numbers if first else {ours: m.numbers[ours]}
            for model, n in models.items():
                manoeuvres.append((m.log, name if model == ours else model, *_cells(n)))
        for e in found.errors.itertuples():
            if e.from_mps2 >= LIMIT_MPS2 and (first or e.model == ours):
                numbers = f'{e.vy:.2f}', f'{np.degrees(e.r):.1f}', f'{e.position:.2f}'
                label = name if e.model == ours else e.model
                ahead.append((label, f'{e.ahead_s:g} s', str(e.starts), *numbers))
    head = ('log', 'model', 'yaw rate', 'ay', 'vy')
    head += ('r peaks', 'late [ms]', 'ay peaks', 'slip peaks [deg]')
    title = 'held-out manoeuvre from its first state: rms over range, peaks'
    parts = [f'## {car}', markdown('fit', ('variant', 'parameter', 'value', '95 %', ''), fitted)]
    parts.append(markdown(title, head, manoeuvres))
    head = ('model', 'ahead', 'starts', 'vy [m/s]', 'yaw rate [deg/s]', 'position [m]')
    title = f'held out, above {LIMIT_MPS2:g} m/s²: rms errors ahead of every state'
    return '\n\n'.join([*parts, markdown(title, head, ahead)])


def _cells(n):
    def peaks(name):
        words = ('greatest', 'least')
        return ' '.join(f'{n[f"{name}_{w}_error"] / abs(n[f"{name}_{w}"]):+.0%}' for w in words)

    late = ' '.join(f'{1000 * n[f"r_{word}_late_s"]:+.0f}' for word in ('greatest', 'least'))
    slip = ' '.join(
        f'{np.degrees(n[f"sideslip_{word}_error"]):+.1f}' for word in ('greatest', 'least')
    )
    rms = (f'{n[f"{name}_rms_of_range"]:.1%}' for name in ('r', 'ay', 'vy'))
    return (*rms, peaks('r'), late, peaks('ay'), slip)


def main() -> None:
    """Run the command."""
    cars = yaml.safe_load((HERE / 'frozen.yaml').read_text())['cars']
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('folder', type=Path, metavar='FOLDER')
    parser.add_argument('--car', choices=cars, action='append', help='(default: all)')
    parser.add_argument('--out', type=Path, required=True, metavar='DIR')
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    parts = []
    for car in options.car or cars:
        parts.append(judge(car, options.folder / car, cars[car], options.out))
        (options.out / 'results.md').write_text('\n\n'.join(parts) + '\n')
        print(parts[-1], flush=True)


if __name__ == '__main__':
    main()
