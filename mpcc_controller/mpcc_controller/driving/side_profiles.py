"""The ways around the hazards, and the lateral offsets from the path that each takes. SI units."""

import itertools
import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from mpcc_controller.driving.hazards import Hazard, RoadAhead, lateral_motion
from mpcc_controller.driving.obstacle_passing import LEFT, RIGHT, Sides
from mpcc_controller.model.single_track import State
from mpcc_controller.parameters import ControllerParams

MOST_SIDES = 3  # obstacles whose sides are combined, the first ones that the car meets
LEAST_TIME_S = 0.3  # to move aside: below it the guess would be no help
# peak acceleration of the quintic from rest to rest over a length d in the time T: d / T^2 times
QUINTIC_PEAK = 10 / math.sqrt(3)


class Profile(NamedTuple):
    """Lateral offsets from the path that a guess takes: held from `enter` to `leave`."""

    enter: list[float]  # s
    leave: list[float]  # s
    offset: list[float]  # m, left of the path
    acceleration: float  # m/s^2, the largest lateral one of the way there
    least_cost: float  # of the contouring error that no such plan avoids


class _Slot(NamedTuple):
    """The offsets from the path between which the car passes one hazard."""

    enter: float  # s
    leave: float  # s
    low: float  # m, left of the path
    high: float  # m
    offset: float  # m, that is taken
    least_cost: float  # of the contouring error meanwhile


def side_combinations(
    around: RoadAhead, x0: State, params: ControllerParams
) -> list[tuple[Sides, Profile]]:
    """Return the ways around the hazards, those that take the least acceleration first.

    Where no car fits between obstacles or beside the road there is
    no way; obstacles beyond the first MOST_SIDES are left to the solver.
    """
    hazards = around.hazards[:MOST_SIDES]
    ways = []
    for chosen in itertools.product((LEFT, RIGHT), repeat=len(hazards)):
        shape = profile(around, hazards, chosen, x0, params)
        if shape is not None:
            ways.append(({h.obstacle.id: side for h, side in zip(hazards, chosen)}, shape))
    return sorted(ways, key=lambda way: way[1].acceleration)


def profile(
    around: RoadAhead,
    hazards: Sequence[Hazard],
    chosen: Sequence[int],
    x0: State,
    params: ControllerParams,
) -> Profile | None:
    """Return the offsets that pass `hazards` on the `chosen` sides; None where no car fits."""
    slots: list[_Slot] = []
    for hazard, side in zip(hazards, chosen):
        slot = _slot_beside(around, hazard, side, params)
        if slot is not None and slots and slot.enter < slots[-1].leave:
            slots[-1], slot = _overlap(slots[-1], slot)
        if slot is None:
            return None
        slots.append(slot)
    return Profile(
        [slot.enter for slot in slots],
        [slot.leave for slot in slots],
        [slot.offset for slot in slots],
        _largest_acceleration(slots, *lateral_motion(around, x0)),
        max((slot.least_cost for slot in slots), default=0.0),
    )


def _slot_beside(
    around: RoadAhead, hazard: Hazard, side: int, params: ControllerParams
) -> _Slot | None:
    """Return where a car passes a hazard on one side; None where it does not fit."""
    dt, last = params.model.step_s, len(around.left) - 1
    first, final = round(hazard.enter / dt), min(round(hazard.leave / dt), last)
    right = float(np.max(around.right[first : final + 1]))
    left = float(np.min(around.left[first : final + 1]))
    touch = hazard.obstacle.r_obs + params.body.circle_radius_m
    if side == LEFT:
        right = max(right, hazard.highest + touch)
        wished = hazard.highest + touch + params.safety.obstacle_m
        target = max(wished, 0.0)
    else:
        left = min(left, hazard.lowest - touch)
        wished = hazard.lowest - touch - params.safety.obstacle_m
        target = min(wished, 0.0)
    if right > left:
        return None
    needed = max(right, -left, 0.0)  # right <= e <= left
    stages = final - first + 1
    least_cost = stages * (needed / params.tolerances.contouring_m) ** 2
    offset = min(max(target, right), left)
    return _Slot(hazard.enter, hazard.leave, right, left, offset, least_cost)


def _overlap(before: _Slot, after: _Slot) -> tuple[_Slot, _Slot | None]:
    """Return both slots where both hazards are beside the car at once; None without room."""
    low, high = max(after.low, before.low), min(after.high, before.high)
    if low > high:
        return before, None
    between = max((after.enter + before.leave) / 2, before.enter)
    before = before._replace(leave=between, offset=min(max(before.offset, low), high))
    after = after._replace(
        enter=between,
        leave=max(after.leave, between),
        low=low,
        high=high,
        offset=min(max(after.offset, low), high),
    )
    return before, after


def _largest_acceleration(slots: Sequence[_Slot], start: float, rate: float) -> float:
    """Return the largest lateral acceleration [m/s^2] from the offset `start` through the slots."""
    acceleration, t, e = 0.0, 0.0, start
    for slot in slots:
        T = max(slot.enter - t, LEAST_TIME_S)
        acceleration = max(acceleration, QUINTIC_PEAK * abs(slot.offset - e - rate * T / 2) / T**2)
        t, e, rate = slot.leave, slot.offset, 0.0
    return acceleration
