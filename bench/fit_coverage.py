"""How often do the intervals of `identify --log` hold the truth? Noisy logs of a known car.

    python bench/fit_coverage.py

The single track drives a slalom of growing amplitude for 30 s to its limit; lateral speed and yaw
rate get noise of 0.03 m/s and 0.01 rad/s. Intervals are those of 95 %.
"""

import argparse
import sys
from pathlib import Path

import numpy as np
from tables import markdown

sys.path.append(str(Path(__file__).parents[1] / 'tests/helpers'))
from measured_drives import TRUTH, single_track_log

from experiments.measured import single_track_fit
from mpcc_controller import car_file

FIRST_SEED, COUNT = 9200, 100


def main() -> None:
    """Fit the logs, and print how many intervals hold the truth."""
    argparse.ArgumentParser(description=__doc__.splitlines()[0]).parse_args()
    car = car_file.read('car.yaml')
    logs = [single_track_log(car, FIRST_SEED + k) for k in range(COUNT)]
    fits = [single_track_fit.fit([log], car) for log in logs]
    rows = []
    for name, truth in TRUTH.items():
        values = np.array([fit.values[name] for fit in fits])
        half = np.array([fit.half_widths[name] for fit in fits])
        inside = int(np.sum(np.abs(values - truth) <= half))
        rows.append((name, f'{truth:g}', f'{values.mean():.4g}', f'{half.mean():.2g}', str(inside)))
    print(markdown(f'of {COUNT} noisy logs', ('parameter', 'truth', 'mean', '±', 'inside'), rows))


if __name__ == '__main__':
    main()
