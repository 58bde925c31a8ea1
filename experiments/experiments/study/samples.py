"""What differs from run to run: the same draws for every controller, so that runs are paired.

Halton points, shifted by a seeded vector (Cranley and Patterson 1976): the first n draws of a
longer list are the list of n, so a study can be enlarged without driving anything again.
"""

from typing import NamedTuple

import numpy as np

from bags.errors import BagError

SEED = 1
SPEED_KPH = 0.5  # either way
GRIP = 0.03  # of the plant's friction, either way; the controller goes on believing the scenario's
TOLERANCE = (1e-6, 1e-3)  # of the solver, log-uniform
MOST_RUNS = 10_000


class Draw(NamedTuple):
    """One run as it is drawn; run k means the same to every controller."""

    number: int
    speed_kph: float  # beside the nominal speed
    grip: float  # plant friction over that of the scenario
    tolerance: float  # of the solver


def draws(runs: int, seed: int = SEED, speed_kph: float = SPEED_KPH) -> list[Draw]:
    """Return that many draws; `speed_kph` is the spread of the entry speed, either way.

    Raises BagError for a number of runs that cannot be made.
    """
    from scipy.stats import qmc

    if not 1 <= runs <= MOST_RUNS:
        raise BagError(f'runs: must be from 1 to {MOST_RUNS}, is {runs}')
    shift = np.random.default_rng(seed).random(3)
    points = (qmc.Halton(d=3, scramble=False).random(runs) + shift) % 1.0
    low, high = np.log10(TOLERANCE)
    return [
        Draw(
            number,
            float(speed_kph * (2 * speed - 1)),
            float(1 + GRIP * (2 * grip - 1)),
            float(10 ** (low + (high - low) * fine)),
        )
        for number, (speed, grip, fine) in enumerate(points, start=1)
    ]
