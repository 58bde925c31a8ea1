"""Reference numbers of every controller at the operating point, tracked in the repository.

Compilers and processors may differ in the last bits of a run, and a run at the limit of grip
amplifies them: TOLERANCES bound the effect. On one machine with one set of libraries the numbers
agree to the last digit; a friction of the road that differs by 1e-7 changes them by 1e-6 at most.
"""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

from bags.errors import BagError
from bags.evaluation import metrics
from experiments import simulation
from experiments.study import tables
from node_runtime import parameters

FILE = 'operating_point.json'
SCENARIO = 'double_lane_change'  # at its own speed, the operating point
CONTROLLERS = ('mpcc', 'mpcc_no_ca', 'frenet', 'mpcc_tuned', 'mpcc_no_ca_tuned', 'frenet_tuned')
TOLERANCES = {
    'min_v2o_per_obstacle_m.1': 1e-4,
    'min_v2o_per_obstacle_m.2': 1e-4,
    'min_v2e_per_edge_m.left': 1e-4,
    'min_v2e_per_edge_m.right': 1e-4,
    'peak_sideslip_deg': 1e-3,
    'min_speed_mps': 1e-4,
    'peak_lat_acc_mps2': 1e-3,
    'rms_contouring_m': 1e-4,
}


class Deviation(NamedTuple):
    """A number that differs from the tracked one."""

    controller: str
    name: str
    tracked: float
    measured: float

    def __str__(self) -> str:
        return (
            f'{self.controller}: {self.name} is {self.measured:.6f}, tracked {self.tracked:.6f}, '
            f'tolerance {TOLERANCES[self.name]:g}'
        )


def simulate(controller: str) -> dict[str, float]:
    """Simulate once in process and return the numbers of TOLERANCES."""
    drive = simulation.drive(simulation.prepare(SCENARIO, controller))
    return select(metrics.compute_metrics(drive))


def select(values: Mapping[str, Any]) -> dict[str, float]:
    """Return the numbers of TOLERANCES by dotted name from the metrics of a run."""
    flat = parameters.flatten_mapping(values)
    return {name: flat[name] for name in TOLERANCES}


def write(folder: Path) -> Path:
    """Simulate all CONTROLLERS and write FILE into a folder; return its path."""
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / FILE
    path.write_text(tables.dump_json({name: simulate(name) for name in CONTROLLERS}))
    return path


def read(folder: Path) -> dict[str, dict[str, float]]:
    """Return the tracked numbers by controller. Raises BagError."""
    path = folder / FILE
    try:
        return json.loads(path.read_text())
    except (OSError, ValueError) as error:
        raise BagError(f'{path}: holds no numbers of the operating point: {error}') from None


def find_deviations(
    controller: str, tracked: Mapping[str, float], measured: Mapping[str, float]
) -> list[Deviation]:
    """Return every Deviation of the measured from the tracked numbers beyond its tolerance."""
    return [
        Deviation(controller, name, tracked[name], measured[name])
        for name, tolerance in TOLERANCES.items()
        if abs(measured[name] - tracked[name]) > tolerance
    ]
