"""Statistics over paired runs: shares with intervals, medians with ranges, the median run.

QUANTITIES lists the numbers of a run that a study prints, with their titles and units.
"""

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from experiments.statistical_inference import wilson_interval
from experiments.study.runner import Record

# metrics that select the median run
MEDIAN_METRICS = (
    'min_v2o_m',
    'min_v2e_m',
    'peak_sideslip_deg',
    'min_speed_mps',
    'rms_contouring_m',
)


class Quantity(NamedTuple):
    """A number of a Record, by dotted name."""

    name: str
    title: str
    unit: str
    decimals: int

    def format(self, value: Any) -> str:
        """Return a value as text; a dash for None."""
        return '–' if value is None else f'{value:.{self.decimals}f}'


QUANTITIES = (
    Quantity('min_v2o_m', 'min V2O', 'm', 2),
    Quantity('min_v2o_per_obstacle_m.1', 'min V2O, obstacle 1', 'm', 2),
    Quantity('min_v2o_per_obstacle_m.2', 'min V2O, obstacle 2', 'm', 2),
    Quantity('min_v2e_m', 'min V2E', 'm', 2),
    Quantity('min_v2e_per_edge_m.left', 'min V2E, left', 'm', 2),
    Quantity('min_v2e_per_edge_m.right', 'min V2E, right', 'm', 2),
    Quantity('min_outline_gap_m', 'min gap of the outline', 'm', 2),
    Quantity('min_outline_gap_per_obstacle_m.1', 'gap of the outline, obstacle 1', 'm', 2),
    Quantity('min_outline_gap_per_obstacle_m.2', 'gap of the outline, obstacle 2', 'm', 2),
    Quantity('min_outline_v2e_m', 'outline to an edge', 'm', 2),
    Quantity('min_outline_v2e_per_edge_m.right', 'outline to the right edge', 'm', 2),
    Quantity('peak_overshoot_m', 'widest overshoot', 'm', 2),
    Quantity('peak_sideslip_deg', 'peak sideslip angle', 'deg', 2),
    Quantity('peak_sideslip_at_m', 'its station', 'm', 0),
    Quantity('min_speed_mps', 'min speed', 'm/s', 2),
    Quantity('brake_onset_at_m', 'brake onset, -500 N', 'm', 1),
    Quantity('brake_onset_hard_at_m', 'brake onset, -1500 N', 'm', 1),
    Quantity('planned_brake_onset_at_m', 'planned brake onset, -500 N', 'm', 1),
    Quantity('planned_brake_onset_hard_at_m', 'planned brake onset, -1500 N', 'm', 1),
    Quantity('braking_s', 'braking (-500 N) for', 's', 2),
    Quantity('counter_steer_s', 'counter-steering for', 's', 2),
    Quantity('peak_counter_steer_deg', 'peak counter-steer', 'deg', 1),
    Quantity('lateral_limit_use_plant', 'lateral acceleration held / limit of the plant', '-', 3),
    Quantity('peak_lat_acc_share', 'peak lateral acceleration / (mu g)', '-', 3),
    Quantity('peak_brake_share', 'peak deceleration / (mu g)', '-', 3),
    Quantity('rms_contouring_m', 'rms contouring error', 'm', 3),
    # processor time: wall time depends on the number of runs in parallel
    Quantity('solve_cpu_ms.mean', 'solve time (CPU), mean', 'ms', 2),
    Quantity('solve_cpu_ms.max', 'solve time (CPU), max', 'ms', 2),
    Quantity('solver.iterations_mean', 'iterations, mean', '-', 2),
    Quantity('solver.iterations_max', 'iterations, max', '-', 0),
    Quantity('solver.failed', 'failed solves', '-', 0),
    Quantity('fallbacks', 'fallbacks', '-', 0),
)
BY_NAME = {quantity.name: quantity for quantity in QUANTITIES}


class Share(NamedTuple):
    """The number of runs in which a condition holds, with its Wilson interval."""

    holds: int
    runs: int
    low: float
    high: float

    @property
    def share(self) -> float:
        """The share of the runs."""
        return self.holds / self.runs


class Summary(NamedTuple):
    """A number over the runs that have it; the median is None when most have none."""

    median: float | None
    least: float | None
    most: float | None
    runs: int  # that have it


def share(holds: Sequence[bool]) -> Share:
    """Return the share of truths among at least one, with its 95 % Wilson score interval."""
    return share_of_counts(sum(map(bool, holds)), len(holds))


def share_of_counts(holds: int, runs: int) -> Share:
    """Return the share `holds` of `runs` with its 95 % Wilson score interval."""
    return Share(holds, runs, *wilson_interval(holds, runs))


def majority_p_value(holds: int, runs: int) -> float:
    """Return the probability of at least `holds` of `runs` where each holds with one half."""
    from scipy.stats import binomtest

    return float(binomtest(holds, runs, 0.5, 'greater').pvalue)


def summarise(values: Sequence[float | None]) -> Summary:
    """Return median and range; a value of None counts as infinite (brakes later than any)."""
    known = [float(value) for value in values if value is not None]
    padded = known + [math.inf] * (len(values) - len(known))
    median = float(np.median(padded)) if known else math.inf
    return Summary(
        median if math.isfinite(median) else None,
        min(known, default=None),
        max(known, default=None),
        len(known),
    )


def summarise_runs(runs: Sequence[Record], name: str) -> Summary:
    """Return the summary of a number of the runs by dotted name."""
    return summarise([run.value(name) for run in runs])


def find_median_run(records: Mapping[str, Sequence[Record]]) -> int:
    """Return the index of the draw that is nearest to the median of every controller at once.

    For each controller and each of MEDIAN_METRICS the runs are ranked (ties share their mean rank);
    the draw with the smallest sum of distances to the middle rank is chosen, the first of equals.
    """
    from scipy.stats import rankdata

    def ranks(runs, name):
        values = [run.value(name) for run in runs]
        return rankdata([math.inf if value is None else value for value in values])

    distances = sum(
        np.abs(ranks(runs, name) - (len(runs) + 1) / 2)
        for runs in records.values()
        for name in MEDIAN_METRICS
    )
    return int(np.argmin(distances))
