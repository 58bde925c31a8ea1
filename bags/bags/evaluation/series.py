"""Distances and angles of a drive, sample by sample: the basis of metrics and figures."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from bags.evaluation import geometry
from bags.evaluation.drive import Drive, Motion, Obstacle, Scene

SEARCH_M = 15.0  # how far the projection on the reference may move between two messages
SIDESLIP_FROM = 3.0  # m/s, the sideslip angle of a standing car is undefined
NS = 1e-9  # s


class Series(NamedTuple):
    """One entry per odometry message of the drive."""

    t: np.ndarray  # s, since the first
    station: np.ndarray  # m, along the reference
    contouring: np.ndarray  # m, left of the reference positive
    speed: np.ndarray  # m/s
    sideslip: np.ndarray  # rad, atan2(vy, vx), not-a-number at speeds below SIDESLIP_FROM
    v2o: dict[int, np.ndarray]  # m, per obstacle id, vehicle circle to obstacle; nan while absent
    v2e: dict[str, np.ndarray]  # m, per edge, vehicle circle to edge; negative beyond it
    outline_gaps: dict[int, np.ndarray]  # m, per obstacle id, true outline to it; nan while absent

    @property
    def outline_gap(self) -> np.ndarray:
        """Gap from the true outline to the nearest obstacle [m]; infinite without one."""
        return np.fmin.reduce([np.full(len(self.t), np.inf), *self.outline_gaps.values()])

    def __repr__(self):
        return f'Series({len(self.t)} samples, {len(self.v2o)} obstacles)'


def compute_series(drive: Drive) -> Series:
    """Return the Series of a drive."""
    motion, scene, facts = drive.motion, drive.scene, drive.facts
    points = np.column_stack([motion.x, motion.y])
    projection = geometry.project_drive(points, scene.reference, SEARCH_M)
    circles = circle_centres(motion, facts.circles)

    def nearest(gaps):
        """Return the smallest distance (n,) over the car's circles; `gaps` are of their centres."""
        return np.min(gaps, axis=0) - facts.vehicle_radius

    # of an obstacle of several discs the nearest counts
    pose, v2o, outline_gaps = (motion.x, motion.y, motion.yaw), {}, {}
    for o in scene.obstacles:
        x, y = obstacle_position(o, scene, motion.stamp_ns)
        away = nearest([np.hypot(*(at - np.column_stack([x, y])).T) - o.radius for at in circles])
        gap = geometry.gap_to_circle(*pose, facts.outline, x, y, o.radius)
        v2o[o.id] = np.fmin(v2o.get(o.id, away), away)
        outline_gaps[o.id] = np.fmin(outline_gaps.get(o.id, gap), gap)
    speed = np.hypot(motion.vx, motion.vy)
    sideslip = np.arctan2(motion.vy, motion.vx)
    return Series(
        t=(motion.stamp_ns - motion.stamp_ns[0]) * NS,
        station=projection.distance,
        contouring=projection.offset,
        speed=speed,
        sideslip=np.where(speed > SIDESLIP_FROM, sideslip, np.nan),
        # D_V2O of the paper (eq. 3), and D_V2E (eq. 4) with the sign of the road's side
        v2o=v2o,
        v2e={
            side: nearest([inside * geometry.distance_to_polyline(at, edge) for at in circles])
            for side, inside, edge in (('left', -1.0, scene.left), ('right', 1.0, scene.right))
        },
        outline_gaps=outline_gaps,
    )


def latest_message(scene: Scene, stamp_ns: np.ndarray) -> np.ndarray:
    """Return the index of the latest message of the obstacles at each stamp; 0 before the first."""
    return np.maximum(np.searchsorted(scene.obstacle_stamp_ns, stamp_ns, side='right') - 1, 0)


def obstacle_position(
    obstacle: Obstacle, scene: Scene, stamp_ns: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return x, y [m] at each stamp: the latest message, extrapolated at constant velocity."""
    latest = latest_message(scene, stamp_ns)
    age = (stamp_ns - scene.obstacle_stamp_ns[latest]) * NS
    x = obstacle.x[latest] + obstacle.vx[latest] * age
    return x, obstacle.y[latest] + obstacle.vy[latest] * age


def circle_centres(motion: Motion, circles: Sequence[float]) -> list[np.ndarray]:
    """Return the centres (n, 2) [m, map] of the car's circles, so far ahead of its own centre."""
    cos, sin = np.cos(motion.yaw), np.sin(motion.yaw)
    return [np.column_stack([motion.x + d * cos, motion.y + d * sin]) for d in circles]
