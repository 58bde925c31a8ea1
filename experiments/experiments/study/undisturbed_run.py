"""One run without random draw, evaluated from inside: planned intrusions and distance errors.

An intrusion u = 1 - D / D_sft of the safety distance costs P_k q (D - D_sft)^2 with
q = exp(-2 D^2 / D_sft^2) (Gaussian, paper 3.3) or q = 1 (step, before contact). The force on the
car is the slope of that cost over D:

    Gaussian   2 P_k D_sft q u (1 + 2 D u / D_sft)
    step       2 P_k D_sft u

The MPCC plans its intrusions in the outer fifth of the safety distance, where q is about 0.2; so
at equal P_k the step is about four times the Gaussian, and comparing the two compares sizes.
"""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from bags.errors import BagError
from bags.storage.columns import Columns
from experiments import simulation
from experiments.study import run_spec
from experiments.study.variants import Variant
from mpcc_controller.parameters import ControllerParams

UNDISTURBED = run_spec.Draw(0, 0.0, 1.0, 1e-6)
PREVIEW_M = 50.0  # about the horizon of 2.5 s


class UndisturbedRun(NamedTuple):
    """A run with its parameters and columns."""

    params: ControllerParams
    columns: Mapping[str, Columns]

    def __repr__(self) -> str:
        return f'UndisturbedRun({len(self.columns["/controller/why"].values)} ticks)'


class ObstacleView(NamedTuple):
    """One obstacle as the controller measured it while it was ahead."""

    obstacle: int
    most_over_m: float  # largest overestimation of the distance by path coordinates
    most_under_m: float  # largest underestimation, positive
    active_from_m: float | None  # station of the first plan that enters its safety distance


class Intrusions(NamedTuple):
    """Planned intrusions into the safety distances of obstacles, over all ticks and stages."""

    stages: int
    deepest: float  # least D / D_sft
    median: float
    force_share: float  # slopes of the Gaussian over those of the step at equal P_k
    cost_share: float  # costs likewise


def simulate(variant: Variant, speed_kph: float) -> UndisturbedRun:
    """Simulate a variant once, undisturbed. Raises BagError."""
    setup = run_spec.prepare(run_spec.build_spec(variant, speed_kph, UNDISTURBED))
    return UndisturbedRun(setup.params, simulation.run(setup))


def view_obstacles(run: UndisturbedRun) -> list[ObstacleView]:
    """Return how each obstacle was measured from PREVIEW_M before it until alongside."""
    reports = [why.values for why in run.columns['/controller/why'].values]
    obstacles = run.columns['/scenario/obstacles'].values[0].items
    return [_view(obstacle.id, reports) for obstacle in obstacles]


def _view(number, reports):
    distance = np.array([report[f'v2o.{number}'] for report in reports])
    error = np.array([report[f'v2o_difference.{number}'] for report in reports])
    ahead = slice(0, int(np.argmin(distance)) + 1)
    near = error[ahead][distance[ahead] <= PREVIEW_M]
    # a tick that brakes without a plan has no q_v2o
    active = [r['theta'] for r in reports[ahead] if r.get(f'q_v2o.{number}', 0.0) > 0.0]
    return ObstacleView(
        number, float(near.max()), max(0.0, -float(near.min())), active[0] if active else None
    )


def gaussian_force_share(depth: np.ndarray) -> np.ndarray:
    """Return the slope of the Gaussian's cost over that of the step, at D / D_sft from 0 to 1."""
    return np.exp(-2 * depth**2) * (1 + 2 * depth * (1 - depth))


def planned_intrusions(run: UndisturbedRun) -> Intrusions:
    """Return the intrusions of the plans of a car with one circle at the centre of gravity.

    Raises BagError when there are none.
    """
    safe_m = run.params.safety.obstacle_m
    ticks = zip(
        run.columns['/controller/prediction'].values, run.columns['/scenario/obstacles'].values
    )
    distances = [
        np.hypot(plan.X - obstacle.X, plan.Y - obstacle.Y)
        - obstacle.r_obs
        - run.params.body.circle_radius_m
        for plan, obstacles in ticks
        for obstacle in obstacles.items
    ]
    distance = np.concatenate(distances)
    depth = distance[distance < safe_m] / safe_m
    if not depth.size:
        raise BagError('the MPCC plans no intrusion at which penalties could be compared')
    return summarise_intrusions(np.clip(depth, 0.0, None))


def summarise_intrusions(depth: np.ndarray) -> Intrusions:
    """Return the summary of intrusions at D / D_sft from 0 to 1, at least one."""
    left = 1 - depth
    force = np.sum(gaussian_force_share(depth) * left) / np.sum(left)
    cost = np.sum(np.exp(-2 * depth**2) * left**2) / np.sum(left**2)
    return Intrusions(
        len(depth), float(depth.min()), float(np.median(depth)), float(force), float(cost)
    )
