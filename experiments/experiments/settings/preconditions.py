"""The preconditions P0 to P4 of a setting, as functions of rows of the table.

They are nested in use: a setting is at a level when it meets the conditions up to it. Each is
evaluated alone, so that every level can be reported. A drive with an error meets none.
"""

from collections.abc import Mapping
from typing import Any, NamedTuple

from experiments.settings.plan import LEVELS, Plan

Row = Mapping[str, Any]  # of the table: one drive
ACCEPTED = 'P3'


class Levels(NamedTuple):
    """Which conditions a setting meets, for one version of the baseline."""

    P0: bool  # the task is near the limit
    P1: bool  # without collision avoidance the car hits obstacle 1
    P2: bool  # MPCC and baseline avoid and stay on the road
    P3: bool  # all three reach the lateral limit of the plant
    P4: bool  # MPCC and baseline brake hard before obstacle 2

    def reaches(self, level: str, least: str = LEVELS[0]) -> bool:
        """Return whether all conditions from `least` up to a level are met."""
        return all(self[LEVELS.index(least) : LEVELS.index(level) + 1])


def evaluate(conditions: Plan, no_ca: Row, mpcc: Row, baseline: Row) -> Levels:
    """Return the conditions that the unperturbed drives of a setting meet."""
    compared = (mpcc, baseline)
    return Levels(
        P0=no_ca['S'] >= conditions.P0.least_S,
        P1=hits_first(no_ca, conditions.P1.by),
        P2=all(avoids(row, conditions.P2.by) for row in compared),
        P3=all(reaches_limit(row, conditions) for row in (no_ca, *compared)),
        P4=all(_value(row, 'brake_onset_planned_at_m') is not None for row in compared),
    )


def hits_first(no_ca: Row, by: str) -> bool:
    """Return whether the car without collision avoidance hits obstacle 1, by circle or outline."""
    gap = _value(no_ca, {'circle': 'v2o_1_m', 'outline': 'outline_1_m'}[by])
    return gap is not None and gap < 0.0


def reaches_limit(row: Row, conditions: Plan) -> bool:
    """Return whether a car reaches the lateral limit of the plant as P3 asks."""
    return _number(row, 'limit_share') >= conditions.P3.least_limit_share


def avoids(row: Row, by: str) -> bool:
    """Return whether a car completes under control, and a shape touches no obstacle and no edge."""
    gaps = {
        'circle': ('min_v2o_m', 'min_v2e_m'),
        'outline': ('min_outline_gap_m', 'outline_edge_m'),
    }
    is_controlled = bool(_value(row, 'completed')) and not _value(row, 'lost')
    return is_controlled and all(_number(row, gap) > 0.0 for gap in gaps[by])


def _number(row, name):
    value = _value(row, name)
    return float('-inf') if value is None else value


def _value(row, name):
    """Return a value of a row, None where a drive has none; data frames have NaN there."""
    value = row.get(name)
    return None if value is None or value != value else value
