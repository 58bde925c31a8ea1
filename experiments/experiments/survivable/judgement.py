"""How far a trajectory is from surviving: overlap with obstacles, wheels off the road, sideslip.

The search minimises `shortfall`, which has a value for every trajectory; that a drive survives is
decided by the metrics of the whole drive alone (`survives`).
"""

from typing import NamedTuple

import numpy as np

from bags.evaluation import geometry
from bags.evaluation.drive import Drive, obstacle_tracks
from bags.evaluation.geometry import Outline
from bags.evaluation.metrics import survival
from bags.evaluation.metrics.outcome import SLIDING_DEG
from bags.evaluation.metrics.registry import EvaluatedDrive
from bags.evaluation.metrics.survival import SHOULDER_M, SLIDING_FROM_MPS
from experiments.survivable.emergency import Emergency, Rollout
from msgs_yaml.conversions import NS_PER_S
from vehicle_plant.simulator import TICK_NS
from vehicle_plant.suspension import wheel_corners

MARGIN_M = 0.15  # beside an obstacle, aimed at by the search
ROAD_MARGIN_M, SLIDING_MARGIN_DEG = 0.2, 5.0


class Shortfall(NamedTuple):
    """What a trajectory lacks: all zero where it keeps every margin."""

    gap: float  # m, over all obstacles the sum of what lacks to the margin
    road: float  # m
    sideslip: float  # in units of 10 deg

    @property
    def cost(self) -> float:
        """What the search minimises."""
        return 2 * self.gap + 2 * self.road + self.sideslip

    @property
    def may_survive(self) -> bool:
        """Whether the trajectory is worth the metrics of the whole drive."""
        is_on_road = self.road < ROAD_MARGIN_M
        return self.gap < MARGIN_M and is_on_road and self.sideslip < SLIDING_MARGIN_DEG / 10


class Judge:
    """Measures rollouts of one emergency; the obstacles' motion is computed once."""

    def __init__(self, emergency: Emergency):
        self._emergency = emergency
        car = emergency.setup.plant.car
        body, shape = car.body, car.outline
        self._outline = Outline(
            front=body.cog_to_front_m + shape.front_overhang_m,
            rear=body.cog_to_rear_m + shape.rear_overhang_m,
            width=shape.width_m,
        )
        self._wheels = np.array([(corner.x, corner.y) for corner in wheel_corners(car)])
        stamps = emergency.start_ns + TICK_NS * np.arange(emergency.most_ticks + 1)
        messages = [emergency.obstacles_at(int(stamp)) for stamp in stamps]
        self._discs = obstacle_tracks(stamps, messages)

    def shortfall(self, rollout: Rollout) -> Shortfall:
        """Return what a rollout lacks."""
        X, Y, psi, vx, vy = rollout.states()
        since = (rollout.stamps() - self._emergency.start_ns) / NS_PER_S
        gap = 0.0
        for disc in self._discs:
            k = np.minimum((since * NS_PER_S / TICK_NS).astype(int), len(disc.x) - 1)
            age = since - k * TICK_NS / NS_PER_S
            place = disc.x[k] + disc.vx[k] * age, disc.y[k] + disc.vy[k] * age
            gaps = geometry.gap_to_circle(X, Y, psi, self._outline, *place, disc.radius)
            if np.isfinite(gaps).any():  # while it is present
                gap += max(0.0, MARGIN_M - np.nanmin(gaps))
        wheels = geometry.transform_to_map(self._wheels, X[::5], Y[::5], psi[::5])
        beyond = self._emergency.course.beyond_edge(wheels[..., 0], wheels[..., 1]).max()
        moving = np.hypot(vx, vy) > SLIDING_FROM_MPS
        sideslip = np.degrees(np.abs(np.arctan2(vy, vx)))[moving].max(initial=0.0)
        return Shortfall(
            gap,
            max(0.0, beyond - SHOULDER_M + ROAD_MARGIN_M),
            max(0.0, sideslip - SLIDING_DEG + SLIDING_MARGIN_DEG) / 10,
        )


def survives(drive: Drive) -> bool:
    """Return whether a whole drive counts as survived, by the metric of that name."""
    return EvaluatedDrive(drive).value(survival.survived) is True
