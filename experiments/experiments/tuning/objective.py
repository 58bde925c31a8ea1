"""What a set of weights is worth, after the paper (section "Cost Function").

"The weights are fine-tuned [...] by minimising longitudinal velocity error and sideslip angle
peaks [...] and enabling the vehicle to avoid obstacles maintaining a safe distance from obstacles
and road edges": the first two are the objective, the last is a constraint. How the two errors are
added is not printed; 1 m/s counting as much as 3 degrees is our choice (3 degrees is the peak that
the paper reports).

Taken literally this rewards letting go of the coarse path: the gentlest weave past both obstacles
has next to no sideslip. So one more constraint, ours: the rms distance from the path is bounded.
"""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from bags.evaluation import metrics
from experiments import simulation
from experiments.configuration.inputs import KPH

SCENARIO = 'double_lane_change'
VELOCITY_SCALE_MPS = 1.0
SIDESLIP_SCALE_DEG = 3.0
CONSTRAINTS = ('v2o', 'v2e', 'completed', 'tracking')


class Condition(NamedTuple):
    """One drive of the objective; every set of weights and every controller drives the same."""

    speed_kmh: float  # desired, and at the start
    friction: float  # of the road; the controller believes 1


# the operating point, both ends of its neighbourhood, and a faster one: so that weights are not
# fitted to one drive
CONDITIONS = (
    Condition(75.0, 1.0),
    Condition(75.5, 0.97),
    Condition(74.5, 1.03),
    Condition(80.0, 1.0),
)


class Score(NamedTuple):
    """What one drive contributes."""

    velocity_rms_mps: float  # of v_x less the desired speed
    sideslip_peak_deg: float
    missing_v2o_m: float  # of D_sft,O where the drive was nearest to an obstacle, 0 if none is
    missing_v2e_m: float  # of D_sft,E likewise
    not_completed: float  # 1 when the drive did not reach its end
    contouring_rms_m: float  # distance from the coarse path

    @property
    def cost(self) -> float:
        """The objective, without unit."""
        return (
            self.velocity_rms_mps / VELOCITY_SCALE_MPS + self.sideslip_peak_deg / SIDESLIP_SCALE_DEG
        )

    def violations(self, tracking_m: float) -> tuple[float, ...]:
        """Return by how much each of CONSTRAINTS is violated; `tracking_m` bounds the tracking."""
        worse = max(0.0, self.contouring_rms_m - tracking_m)
        return self.missing_v2o_m, self.missing_v2e_m, self.not_completed, worse


def drive(controller: str, weights: Mapping[str, Any], condition: Condition) -> Score:
    """Drive the double lane change once in process and score it.

    `weights` are parameters of the controller by dotted name. Raises BagError for what the
    controller refuses.
    """
    settings = {'controller': dict(weights), 'plant': {'friction': condition.friction}}
    speed = condition.speed_kmh / KPH
    return score(simulation.drive(simulation.prepare(SCENARIO, controller, settings, speed)), speed)


def score(driven, speed_mps: float) -> Score:
    """Return the Score of a Drive whose desired speed is constant."""
    found, facts = metrics.compute_metrics(driven), driven.facts
    return Score(
        velocity_rms_mps=float(np.sqrt(np.mean((driven.motion.vx - speed_mps) ** 2))),
        # a car that stands has no sideslip angle; it has not completed either
        sideslip_peak_deg=found['peak_sideslip_deg'] or 0.0,
        missing_v2o_m=_missing(facts.safe_obstacle, found['min_v2o_m']),
        missing_v2e_m=_missing(facts.safe_edge, found['min_v2e_m']),
        not_completed=float(not found['completed']),
        contouring_rms_m=found['rms_contouring_m'],
    )


def _missing(safe, least):
    return 0.0 if least is None else max(0.0, safe - least)


def cost(scores: Sequence[Score]) -> float:
    """Return the objective of a set of weights: the mean over its drives."""
    return float(np.mean([one.cost for one in scores]))


def violations(scores: Sequence[Score], tracking_m: float) -> tuple[float, ...]:
    """Return how far a set of weights violates each of CONSTRAINTS, 0 if not: the worst drive's."""
    worst = np.max([one.violations(tracking_m) for one in scores], axis=0)
    return tuple(float(one) for one in worst)


def broken(
    found: Sequence[float], tracking_m: float, safety_m: Mapping[str, float]
) -> tuple[str, ...]:
    """Return in words which of CONSTRAINTS the worst drive violates, and by how much.

    `found` is from `violations`; `safety_m` holds the safety distances D_sft under v2o and v2e.
    """
    by_name = dict(zip(CONSTRAINTS, found))
    told = [
        f'min {name.upper()} {safety_m[name] - by_name[name]:.2f} m < {safety_m[name]:g} m'
        for name in ('v2o', 'v2e')
        if by_name[name]
    ]
    if by_name['completed']:
        told.append('not completed')
    if by_name['tracking']:
        told.append(f'path tracked to {tracking_m + by_name["tracking"]:.2f} m > {tracking_m:g} m')
    return tuple(told)
