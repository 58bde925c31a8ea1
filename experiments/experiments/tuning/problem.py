"""The optimisation problem of tuning: weights and their ranges, objective, constraints.

The objective follows the paper (section "Cost Function"): "The weights are fine-tuned [...] by
minimising longitudinal velocity error and sideslip angle peaks [...] and enabling the vehicle to
avoid obstacles maintaining a safe distance from obstacles and road edges". The first two are the
objective, the last is a constraint. How the two errors are added is not printed; 1 m/s counting as
much as 3 degrees is our choice (3 degrees is the peak that the paper reports).

Taken literally this rewards leaving the coarse path: the gentlest weave past both obstacles has
next to no sideslip. So there is one more constraint, ours: a bound on the rms distance from the
path.

A weight is 1 / tolerance^2, so three decades of a tolerance are six of its weight. All scales are
logarithmic. The ranges are the same for every controller; a formulation names its weights.
"""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from optuna.distributions import FloatDistribution

from bags.errors import BagError
from bags.evaluation import metrics
from bags.evaluation.drive import Drive
from experiments import simulation
from experiments.configuration import inputs
from experiments.configuration.inputs import KPH
from experiments.drive_row import SCENARIO_SPEED, Row
from experiments.simulation import Setup
from mpcc_controller.problem import formulation
from node_runtime import parameters

SCENARIO = 'double_lane_change'
VELOCITY_SCALE_MPS = 1.0
SIDESLIP_SCALE_DEG = 3.0
CONSTRAINTS = ('v2o', 'v2e', 'completed', 'tracking')
WIDTH_DECADES = 1.0  # either side of the untuned value in stage 1
NARROWING = 4.0  # ratio of the widths of stage 1 and stage 2, in decades


class Condition(NamedTuple):
    """One run of the objective; the same for every set of weights and every controller."""

    speed_kmh: float  # desired, and at the start
    friction: float  # of the road; the controller assumes 1


# the operating point, both ends of its neighbourhood, and a faster one: so that weights are not
# fitted to one run
CONDITIONS = (
    Condition(75.0, 1.0),
    Condition(75.5, 0.97),
    Condition(74.5, 1.03),
    Condition(80.0, 1.0),
)


class Score(NamedTuple):
    """The contribution of one run."""

    velocity_rms_mps: float  # of v_x less the desired speed
    sideslip_peak_deg: float
    missing_v2o_m: float  # of D_sft,O at the least distance to an obstacle, 0 if none is missing
    missing_v2e_m: float  # of D_sft,E likewise
    not_completed: float  # 1 when the run was not completed
    contouring_rms_m: float  # distance from the coarse path

    @property
    def cost(self) -> float:
        """The objective, dimensionless."""
        return (
            self.velocity_rms_mps / VELOCITY_SCALE_MPS + self.sideslip_peak_deg / SIDESLIP_SCALE_DEG
        )

    def violations(self, tracking_m: float) -> tuple[float, ...]:
        """Return the violation of each of CONSTRAINTS; `tracking_m` is the bound on tracking."""
        excess = max(0.0, self.contouring_rms_m - tracking_m)
        return self.missing_v2o_m, self.missing_v2e_m, self.not_completed, excess


def row_of(controller: str, weights: Mapping[str, Any], condition: Condition) -> Row:
    """Return the drive of a set of weights: parameters of the controller by dotted name."""
    settings = {f'controller.{name}': value for name, value in weights.items()}
    settings['plant.friction'] = condition.friction
    settings[SCENARIO_SPEED] = condition.speed_kmh / KPH
    return Row(SCENARIO, controller, tuple(settings.items()))


def measure(setup: Setup, speed_mps: float) -> dict[str, float]:
    """Simulate the setup of a row of `row_of` with a desired speed; return its Score as fields."""
    return score(simulation.drive(setup), speed_mps)._asdict()


def score(drive: Drive, speed_mps: float) -> Score:
    """Return the Score of a Drive with a constant desired speed."""
    values, facts = metrics.compute_metrics(drive), drive.facts
    return Score(
        velocity_rms_mps=float(np.sqrt(np.mean((drive.motion.vx - speed_mps) ** 2))),
        # a car at rest has no sideslip angle; it has not completed the run either
        sideslip_peak_deg=values['peak_sideslip_deg'] or 0.0,
        missing_v2o_m=_missing(facts.safe_obstacle, values['min_v2o_m']),
        missing_v2e_m=_missing(facts.safe_edge, values['min_v2e_m']),
        not_completed=float(not values['completed']),
        contouring_rms_m=values['rms_contouring_m'],
    )


def _missing(safe, least):
    return 0.0 if least is None else max(0.0, safe - least)


def cost(scores: Sequence[Score]) -> float:
    """Return the objective of a set of weights: the mean over its runs."""
    return float(np.mean([score.cost for score in scores]))


def violations(scores: Sequence[Score], tracking_m: float) -> tuple[float, ...]:
    """Return the violation of each of CONSTRAINTS in the worst run, 0 for none."""
    worst = np.max([score.violations(tracking_m) for score in scores], axis=0)
    return tuple(map(float, worst))


def describe_violations(
    worst: Sequence[float], tracking_m: float, safety_m: Mapping[str, float]
) -> tuple[str, ...]:
    """Return one phrase for each violated constraint.

    `worst` is from `violations`; `safety_m` holds the safety distances D_sft under v2o and v2e.
    """
    by_name = dict(zip(CONSTRAINTS, worst))
    phrases = [
        f'min {name.upper()} {safety_m[name] - by_name[name]:.2f} m < {safety_m[name]:g} m'
        for name in ('v2o', 'v2e')
        if by_name[name]
    ]
    if by_name['completed']:
        phrases.append('not completed')
    if by_name['tracking']:
        tracked_m = tracking_m + by_name['tracking']
        phrases.append(f'path tracked to {tracked_m:.2f} m > {tracking_m:g} m')
    return tuple(phrases)


def untuned_weights(controller: str) -> dict[str, float]:
    """Return the searched weights as the controller's file has them, by dotted name.

    Raises BagError for an unknown controller, and for a weight of zero, around which no logarithmic
    range exists.
    """
    values = parameters.flatten(inputs.controller_params(controller))
    names = formulation.find(values['formulation.name']).tuned_weights
    weights = {name: float(values[name]) for name in names}
    for name, value in weights.items():
        if not value > 0.0:
            raise BagError(f'{controller}: {name} is {value:g}; to be tuned it must be positive')
    return weights


def wide_spans(centre: Mapping[str, float]) -> dict[str, FloatDistribution]:
    """Return the ranges of stage 1 around the untuned weights."""
    factor = 10.0**WIDTH_DECADES
    return {n: FloatDistribution(v / factor, v * factor, log=True) for n, v in centre.items()}


def narrow_spans(
    spans: Mapping[str, FloatDistribution], best: Mapping[str, float]
) -> dict[str, FloatDistribution]:
    """Return the ranges of stage 2: narrower ones about the best of stage 1, within its ranges."""
    narrow = {}
    for name, span in spans.items():
        factor = (span.high / span.low) ** (0.5 / NARROWING)
        ends = max(span.low, best[name] / factor), min(span.high, best[name] * factor)
        narrow[name] = FloatDistribution(*ends, log=True)
    return narrow
