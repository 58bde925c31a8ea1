"""The outline of the car and the circles that stand for it, from the parameters of a run."""

import math
from collections.abc import Mapping
from typing import Any

from bags.evaluation.geometry import Outline


def outline_of(plant: Mapping[str, Any]) -> Outline:
    """Return the outline from the parameters of the plant; KeyError if one is missing."""
    return Outline(
        front=plant['car.body.cog_to_front_m'] + plant['car.outline.front_overhang_m'],
        rear=plant['car.body.cog_to_rear_m'] + plant['car.outline.rear_overhang_m'],
        width=plant['car.outline.width_m'],
    )


def circles_of(controller: Mapping[str, Any], outline: Outline) -> tuple[float, tuple[float, ...]]:
    """Return the radius [m] of the controller's vehicle circles, and their offsets [m].

    With `body.circles` they are as many as that and cover the outline, each an equal share of its
    length; else they are those that the parameters list. KeyError if one is missing.
    """
    count = controller.get('body.circles')
    if not count:
        return controller['body.circle_radius_m'], tuple(controller['body.circle_offsets_m'])
    share = (outline.front + outline.rear) / count
    offsets = tuple((k + 0.5) * share - outline.rear for k in range(count))
    return math.hypot(share / 2, outline.width / 2), offsets
