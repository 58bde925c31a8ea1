"""At which P_k the baseline's step pushes as hard as the paper's Gaussian.

An intrusion u = 1 - D / D_sft of the safety distance costs P_k q (D - D_sft)^2 with
q = exp(-2 D^2 / D_sft^2) (Gaussian, paper 3.3) or q = 1 (step, before contact). What moves the car
is the slope of that cost over D:

    Gaussian   2 P_k D_sft q u (1 + 2 D u / D_sft)
    step       2 P_k D_sft u

The MPCC plans its intrusions in the outer fifth of the safety distance, where q is about 0.2; so
at equal P_k the step is about four times the Gaussian, and a comparison of the two compares sizes.
"""

from typing import NamedTuple

import numpy as np

from bags.errors import BagError
from experiments.study.approach import Approach


class Intrusions(NamedTuple):
    """What the MPCC plans inside the safety distance of obstacles, all ticks and stages."""

    stages: int
    deepest: float  # least D / D_sft
    median: float
    force_share: float  # slopes of the Gaussian over those of the step at equal P_k
    cost_share: float  # costs likewise


def gaussian_force_share(depth: np.ndarray) -> np.ndarray:
    """Return the slope of the Gaussian's cost over that of the step, at D / D_sft from 0 to 1."""
    return np.exp(-2 * depth**2) * (1 + 2 * depth * (1 - depth))


def planned(approach: Approach) -> Intrusions:
    """Return the intrusions of the plans of a drive with one circle at the centre of gravity.

    Raises BagError when there are none.
    """
    params = approach.params
    depth = np.concatenate(
        [
            (np.hypot(plan.X - one.X, plan.Y - one.Y) - one.r_obs - params.body.circle_radius_m)
            for plan, seen in zip(
                approach.columns['/controller/prediction'].values,
                approach.columns['/scenario/obstacles'].values,
            )
            for one in seen.items
        ]
    )
    depth = depth[depth < params.safety.obstacle_m] / params.safety.obstacle_m
    if not depth.size:
        raise BagError('the MPCC plans no intrusion at which penalties could be compared')
    return of_depths(np.clip(depth, 0.0, None))


def of_depths(depth: np.ndarray) -> Intrusions:
    """Return the shares over intrusions at D / D_sft from 0 to 1, at least one."""
    left = 1 - depth
    force = np.sum(gaussian_force_share(depth) * left) / np.sum(left)
    cost = np.sum(np.exp(-2 * depth**2) * left**2) / np.sum(left**2)
    return Intrusions(
        len(depth), float(depth.min()), float(np.median(depth)), float(force), float(cost)
    )
