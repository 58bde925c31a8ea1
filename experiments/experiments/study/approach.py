"""One undisturbed drive seen from inside: what the controller plans and measures on its way.

For what a recording says beyond the metrics: the intrusions that are planned, and how much the
frame of the distances shifts what the controller sees.
"""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from bags.storage.columns import Columns
from experiments import simulation
from experiments.study import case, samples
from experiments.study.variants import Variant

UNDISTURBED = samples.Draw(0, 0.0, 1.0, 1e-6)
PREVIEW_M = 50.0  # about the horizon of 2.5 s


class Approach(NamedTuple):
    """A drive with its setup and columns."""

    params: Any  # of the controller, see simulation.Setup
    columns: Mapping[str, Columns]


class Seen(NamedTuple):
    """How one obstacle was seen while it was ahead."""

    obstacle: int
    most_over_m: float  # most that path coordinates overestimated the distance
    most_under_m: float  # most that they underestimated it, positive
    active_from_m: float | None  # station of the first plan that enters its safety distance


def drive(variant: Variant, speed_kph: float, scenario: str) -> Approach:
    """Drive a variant once, undisturbed. Raises BagError."""
    chosen = case.of(variant, speed_kph, UNDISTURBED, scenario)
    prepared = case.prepared(chosen)
    return Approach(prepared.params, simulation.run(prepared))


def seen(approach: Approach) -> list[Seen]:
    """Return how each obstacle was seen from PREVIEW_M before it until alongside."""
    reports = [why.values for why in approach.columns['/controller/why'].values]
    # a tick that brakes without a plan still measures
    first = approach.columns['/scenario/obstacles'].values[0].items
    return [_seen(one.id, reports) for one in first]


def _seen(number, reports):
    gap = np.array([report[f'v2o.{number}'] for report in reports])
    over = np.array([report[f'v2o_difference.{number}'] for report in reports])
    ahead = slice(0, int(np.argmin(gap)) + 1)
    near = over[ahead][gap[ahead] <= PREVIEW_M]
    active = [r['theta'] for r in reports[ahead] if r.get(f'q_v2o.{number}', 0.0) > 0.0]
    return Seen(
        number, float(near.max()), max(0.0, -float(near.min())), active[0] if active else None
    )
