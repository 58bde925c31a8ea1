"""Which weights are searched for, and in which ranges; all of them on logarithmic scales.

A weight is 1 / tolerance^2, so three decades of a tolerance are six of its weight. The ranges are
the same for every controller; each has one term that the other has not, and that comes last.
"""

import math
from collections.abc import Mapping
from typing import NamedTuple

from bags.errors import BagError
from experiments import simulation
from experiments.tuning import objective
from node_runtime import parameters

WIDTH_DECADES = 1.0  # either side of the untuned value in stage 1
NARROWING = 4.0  # by which stage 2 is narrower than stage 1, in decades
COMMON = (
    'tolerances.contouring_m',
    'tolerances.velocity_mps',
    'tolerances.steer_rate_radps',
    'tolerances.force_rate_nps',
    'priorities.obstacle',
    'priorities.edge',
)
OWN = {'mpcc': 'tolerances.lag_m', 'frenet': 'tolerances.heading_rad'}


class Span(NamedTuple):
    """The range of one weight."""

    low: float
    high: float

    @property
    def decades(self) -> float:
        """How wide it is."""
        return math.log10(self.high / self.low)

    def clipped(self, value: float) -> float:
        """Return a value that rounding may have put outside."""
        return min(max(value, self.low), self.high)


def untuned(controller: str) -> dict[str, float]:
    """Return the weights that are searched for, as the controller's file has them.

    Raises BagError for a controller that does not exist, or one of whose weights is zero: there is
    nothing to search for around zero.
    """
    given = parameters.flatten(simulation.prepare(objective.SCENARIO, controller).params)
    names = (*COMMON, OWN[given['formulation.name']])
    found = {name: float(given[name]) for name in names}
    for name, value in found.items():
        if not value > 0.0:
            raise BagError(f'{controller}: {name} is {value:g}; to be tuned it must be positive')
    return found


def safety(controller: str) -> dict[str, float]:
    """Return the safety distances D_sft [m] of a controller: v2o to obstacles, v2e to edges."""
    given = simulation.prepare(objective.SCENARIO, controller).params.safety
    return {'v2o': given.obstacle_m, 'v2e': given.edge_m}


def wide(centre: Mapping[str, float]) -> dict[str, Span]:
    """Return the ranges of stage 1 around the untuned weights."""
    factor = 10.0**WIDTH_DECADES
    return {name: Span(value / factor, value * factor) for name, value in centre.items()}


def narrow(spans: Mapping[str, Span], best: Mapping[str, float]) -> dict[str, Span]:
    """Return the ranges of stage 2: narrower ones about the best of stage 1, within its ranges."""
    found = {}
    for name, span in spans.items():
        factor = 10.0 ** (span.decades / NARROWING / 2)
        found[name] = Span(max(span.low, best[name] / factor), min(span.high, best[name] * factor))
    return found
