"""The metrics by which runs are compared: one dictionary per drive, as in comparison.json.

compute_metrics(drive)   every metric of a drive by name
registry                 the decorator `@metric`: how to add a metric
outcome                  finish line, collisions, clearances, road departure, loss of control
survival                 the judge of emergencies: did the car come through, and if not, why
rules                    what people expect among others: the own lane, who comes, who is ahead
driving                  tracking, sideslip, braking, steering, grip, solve times, deadline misses

Stations ("at_m") are metres along the reference, `x_m` is the map's x. A metric that has no
meaning in a run (no obstacle, no braking, no solve time) is None.
"""

from typing import Any

from bags.evaluation.drive import Drive, drop_nonfinite

# their metrics come in this order in comparison.json and in the printed table
from bags.evaluation.metrics import outcome  # noqa: F401 # isort: skip
from bags.evaluation.metrics import survival  # noqa: F401 # isort: skip
from bags.evaluation.metrics import rules  # noqa: F401 # isort: skip
from bags.evaluation.metrics import driving  # noqa: F401 # isort: skip
from bags.evaluation.metrics.registry import METRICS, EvaluatedDrive


def compute_metrics(drive: Drive) -> dict[str, Any]:
    """Return every metric of a drive by name, JSON values.

    Samples that are not finite are left out. Raises BagError when no state of the car is left.
    """
    return metrics_of(EvaluatedDrive(drop_nonfinite(drive)))


def metrics_of(run: EvaluatedDrive) -> dict[str, Any]:
    """Return every metric of a run by name, as `compute_metrics` does."""
    return {metric.name: run.value(metric.function) for metric in METRICS.values()}
