"""Drives of the study again: how near to the lateral limit is a car until it meets an obstacle?"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from bags.evaluation.drive import Drive
from bags.evaluation.metrics.driving import held_lat_acc_mps2
from bags.evaluation.metrics.registry import EvaluatedDrive
from bags.evaluation.series import Series, compute_series
from experiments.settings import drive
from experiments.settings import setting as settings
from experiments.settings.preregistration import Preregistration

OBSTACLES = (1, 2)  # ids, in the order in which they are passed


class Approach(NamedTuple):
    """The lateral acceleration held for 0.1 s over the plant's limit, up to three instants."""

    before_1: float  # the first contact with obstacle 1, or without one the nearest approach
    before_2: float
    whole: float  # the end of the drive

    def __repr__(self) -> str:
        return f'Approach({self.before_1:.2f}, {self.before_2:.2f}, {self.whole:.2f})'


def measure(plan: Preregistration, seed: int, number: int, arms: Sequence[str]) -> list[Approach]:
    """Drive a setting by some arms, without perturbation; return an Approach for each."""
    (values,) = settings.draw(plan, seed, number, 1)
    built = settings.build(plan, number, values)
    return [_approach(drive.plan_drive(plan, built, arm), built) for arm in arms]


def _approach(task, built):
    driven, _ = drive.simulate(task)
    facts = driven.facts._replace(circles=built.offsets, vehicle_radius=built.radius)
    driven = driven._replace(facts=facts)
    series = compute_series(driven)
    ends = [meeting_ns(driven, series, obstacle) for obstacle in OBSTACLES]
    held = [held_before(driven, series, end) for end in (*ends, driven.motion.stamp_ns[-1] + 1)]
    return Approach(*(value / built.plant.limit for value in held))


def meeting_ns(driven: Drive, series: Series, obstacle: int) -> int:
    """Return the stamp of the first contact with an obstacle, or of the nearest approach to it.

    Contact is that of circles or outline, whichever is first.
    """
    gap = np.minimum(series.v2o[obstacle], series.outline_gaps[obstacle])
    touches = gap < 0.0
    first = np.argmax(touches) if touches.any() else np.nanargmin(gap)
    return int(driven.motion.stamp_ns[first])


def held_before(driven: Drive, series: Series, end_ns: int) -> float:
    """Return the lateral acceleration held for 0.1 s before a stamp [m/s²]; 0 without any."""
    measured = driven.accelerations
    before = measured.stamp_ns < end_ns
    part = measured._replace(stamp_ns=measured.stamp_ns[before], ay=measured.ay[before])
    run = EvaluatedDrive(driven._replace(accelerations=part), series)
    return run.value(held_lat_acc_mps2) or 0.0
