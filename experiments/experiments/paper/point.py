"""What every controller comes to at the operating point: tracked, and checked by driving again.

Compilers and processors may differ in the last bits of a drive, and a drive at the limit makes
something of that; TOLERANCES say how much. On one machine with one set of libraries the numbers
agree to the last digit.
"""

import json
from pathlib import Path
from typing import Any, NamedTuple

from bags.errors import BagError
from bags.evaluation import metrics
from experiments import simulation
from experiments.study import tables

FILE = 'operating_point.json'
SCENARIO = 'double_lane_change'  # at its own speed, the operating point
CONTROLLERS = ('mpcc', 'mpcc_no_ca', 'frenet', 'mpcc_tuned', 'mpcc_no_ca_tuned', 'frenet_tuned')
TOLERANCES = {
    'min_v2o_per_obstacle_m.1': 0.02,
    'min_v2o_per_obstacle_m.2': 0.02,
    'min_v2e_per_edge_m.left': 0.02,
    'min_v2e_per_edge_m.right': 0.02,
    'peak_sideslip_deg': 0.2,
    'min_speed_mps': 0.1,
    'peak_lat_acc_mps2': 0.1,
    'rms_contouring_m': 0.01,
}


class Deviation(NamedTuple):
    """A number that came out otherwise than tracked."""

    controller: str
    name: str
    tracked: float
    found: float

    def __str__(self) -> str:
        return (
            f'{self.controller}: {self.name} is {self.found:.4f}, tracked {self.tracked:.4f}, '
            f'tolerance {TOLERANCES[self.name]:g}'
        )


def drive(controller: str) -> dict[str, float]:
    """Drive once in process and return the numbers of TOLERANCES."""
    return numbers(
        metrics.compute_metrics(simulation.drive(simulation.prepare(SCENARIO, controller)))
    )


def numbers(found: dict[str, Any]) -> dict[str, float]:
    """Return the numbers of TOLERANCES by dotted name from the metrics of a drive."""
    return {name: _look_up(found, name) for name in TOLERANCES}


def _look_up(found, name):
    for part in name.split('.'):
        found = found[part]
    return found


def write(folder: Path) -> Path:
    """Drive all CONTROLLERS and write FILE into a folder; return its path."""
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / FILE
    path.write_text(tables.dumped({name: drive(name) for name in CONTROLLERS}))
    return path


def tracked(folder: Path) -> dict[str, dict[str, float]]:
    """Return the tracked numbers by controller. Raises BagError."""
    path = folder / FILE
    try:
        return json.loads(path.read_text())
    except (OSError, ValueError) as error:
        raise BagError(f'{path}: holds no numbers of the operating point: {error}') from None


def deviations(
    controller: str, known: dict[str, float], found: dict[str, float]
) -> list[Deviation]:
    """Return every Deviation of what was found from what is tracked, beyond its tolerance."""
    return [
        Deviation(controller, name, known[name], found[name])
        for name, tolerance in TOLERANCES.items()
        if abs(found[name] - known[name]) > tolerance
    ]
