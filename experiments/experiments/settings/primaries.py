"""The claims of the paper on one setting: paired differences, and whether the paper's size holds.

Differences are positive in the direction of the paper. A claim without meaning in a setting (a car
that does not brake has no onset) is None, and neither holds nor fails.
"""

from collections.abc import Mapping
from typing import Any, NamedTuple

from experiments.settings.plan import Plan

Row = Mapping[str, Any]  # of the table: one drive
CLAIMS = ('unsafe_area', 'sideslip', 'brake_onset', 'min_speed', 'conjunction')


class Outcome(NamedTuple):
    """One claim on one pair of drives."""

    difference: float | None  # in the unit of its margin
    holds: bool | None


UNKNOWN = Outcome(None, None)
ALL_UNKNOWN = dict.fromkeys(CLAIMS, UNKNOWN)


def evaluate(rules: Plan, mpcc: Row, baseline: Row) -> dict[str, Outcome]:
    """Return the outcome of every claim on two drives of one setting and perturbation."""
    outcomes = {
        'unsafe_area': _unsafe_area(rules, mpcc, baseline),
        'sideslip': _sideslip(rules, mpcc, baseline),
        'brake_onset': _brake_onset(rules, mpcc, baseline),
        'min_speed': _min_speed(rules, mpcc, baseline),
    }
    holding = [outcome.holds for outcome in outcomes.values()]
    together = None if None in holding else all(holding)
    if False in holding:
        together = False
    return outcomes | {'conjunction': Outcome(None, together)}


def kept_distance(row: Row) -> float | None:
    """Return by how much [m] the safety distances were kept, the worst of obstacles and edges.

    Negative: how deep the circles were in an unsafe area.
    """
    gaps = (
        (row.get('min_v2o_m'), row['safety_obstacle_m']),
        (row.get('min_v2e_m'), row['safety_edge_m']),
    )
    known = [gap - safe for gap, safe in gaps if gap is not None and gap == gap]
    return min(known) if len(known) == len(gaps) else None


def _unsafe_area(rules, mpcc, baseline):
    kept = kept_distance(mpcc), kept_distance(baseline)
    if None in kept:
        return UNKNOWN
    allowed = -rules.unsafe_area.slack_m
    return Outcome(kept[0] - kept[1], kept[1] < allowed <= kept[0])


def _sideslip(rules, mpcc, baseline):
    values = _pair('peak_sideslip_deg', mpcc, baseline)
    if values is None:
        return UNKNOWN
    small, large = values
    claim = rules.sideslip
    return Outcome(large - small, large >= claim.baseline_deg and small <= claim.mpcc_deg)


def _brake_onset(rules, mpcc, baseline):
    return _lead('brake_onset_planned_at_m', baseline, mpcc, rules.brake_onset.earlier_m)


def _min_speed(rules, mpcc, baseline):
    return _lead('min_speed_mps', mpcc, baseline, rules.min_speed.higher_mps)


def _lead(name, greater, less, least):
    """Return by how much a measure is greater in one row, and whether by `least` or more."""
    values = _pair(name, greater, less)
    if values is None:
        return UNKNOWN
    lead = values[0] - values[1]
    return Outcome(lead, lead >= least)


def _pair(name, *rows):
    values = tuple(row.get(name) for row in rows)
    return None if any(value is None or value != value for value in values) else values
