"""Rules that people expect of a car among others: its lane, those who come, those ahead.

The own lane is the strip along the reference, the middle of the lane by the planner, up to
LANE_M / 2 to either side or to the nearer edge. In it is who reaches further into it than discs
are wider than the box that they cover; it is free while nobody is in it in front of the car's rear,
nor shortly before or afterwards. Stations and offsets are those along the reference, every
STEP_NS.
"""

from typing import NamedTuple

import numpy as np

from bags.evaluation import geometry
from bags.evaluation.drive import SEARCH_M, obstacle_position
from bags.evaluation.metrics.registry import EvaluatedDrive, metric

STEP_NS = 50_000_000
LANE_M = 3.5
REACHES_M = 0.4  # the discs of a truck, and who keeps its lane, reach so far into the next one
AHEAD_M = 100.0  # farther ahead nobody is in the way
AROUND_NS = 4_000_000_000  # to make way before somebody is in the lane, and to return afterwards
MEETS_S = 2.0  # from then on somebody who comes is met
BESIDE_M = 0.5  # room to the side that people leave to one who comes
MOVING_MPS = 1.0
SETTLE_NS = 2_000_000_000  # to fall back behind one who has moved in ahead


class Other(NamedTuple):
    """An obstacle in the coordinates of the reference, one entry per row; nan while absent."""

    station: np.ndarray  # m
    offset: np.ndarray  # m, left positive
    speed: np.ndarray  # m/s along the reference
    radius: float  # m


class Traffic(NamedTuple):
    """A drive in the coordinates of the reference, one entry per row."""

    station: np.ndarray  # m, of the centre of gravity
    aside: np.ndarray  # m, from the reference
    speed: np.ndarray  # m/s
    left: np.ndarray  # m, how far left of the reference the outline reaches
    right: np.ndarray  # m, how far right of it, positive
    half: np.ndarray  # m, half the width of the lane
    is_free: np.ndarray  # whether nobody is in the lane
    others: tuple[Other, ...]


@metric(unit='m')
def lane_excess_m(run):
    """How far the outline reached out of its lane, at most, while the lane was free; else 0."""
    traffic = run.value(traffic_of)
    beyond = np.maximum(traffic.left, traffic.right) - traffic.half
    return float(np.max(beyond, where=traffic.is_free, initial=0.0))


@metric(unit='m')
def dodge_m(run):
    """Largest distance of the centre of gravity from the reference as one is met in a free lane.

    From 2 s before the car and one that comes in another lane meet until they are past each other.
    """
    traffic, most = run.value(traffic_of), 0.0
    for other in traffic.others:
        is_met = traffic.is_free & _is_met(run, traffic, other)
        most = float(np.max(traffic.aside, where=is_met, initial=most))
    return most


@metric(unit='s')
def in_the_way_s(run):
    """How long the car was out of its lane, in the way of one it would meet within 2 s.

    In the way is within 0.5 m of the strip in which the other one comes. The time that a threshold
    of the time to collision is exceeded: Minderhoud and Bovy, Extended time-to-collision measures
    for road traffic safety assessment, 2001.
    """
    traffic = run.value(traffic_of)
    is_in_way = np.zeros(len(traffic.station), bool)
    for other in traffic.others:
        strip = other.radius + BESIDE_M
        for side, reach, inner in (
            (1.0, traffic.left, -traffic.right),
            (-1.0, traffic.right, -traffic.left),
        ):
            theirs = side * other.offset
            is_out = (theirs > 0.0) & (reach > np.maximum(traffic.half, theirs - strip))
            is_in_way |= is_out & (inner < theirs + strip) & _is_met(run, traffic, other)
    return float(np.count_nonzero(is_in_way) * STEP_NS * 1e-9)


@metric(unit='s')
def min_time_gap_s(run):
    """Smallest time gap to one that moves on ahead: clearance over the own speed (ISO 15622).

    Of one whose middle has been ahead of the outline for 2 s and more; None without any.
    """
    traffic, outline = run.value(traffic_of), run.drive.facts.outline
    rows, least = np.arange(len(traffic.station)), np.inf
    for other in traffic.others:
        clearance = other.station - other.radius - traffic.station - outline.front
        is_ahead = (clearance > 0.0) & (other.speed > MOVING_MPS) & (traffic.speed > MOVING_MPS)
        is_ahead &= (other.offset < traffic.left) & (other.offset > -traffic.right)
        since = rows - np.maximum.accumulate(np.where(is_ahead, -1, rows))
        stays = is_ahead & (since * STEP_NS > SETTLE_NS)
        least = np.min(clearance[stays] / traffic.speed[stays], initial=least)
    return float(least) if np.isfinite(least) else None


def traffic_of(run: EvaluatedDrive) -> Traffic:
    """Return the drive in the coordinates of its reference."""
    motion, scene, outline = run.drive.motion, run.drive.scene, run.drive.facts.outline
    even = np.arange(motion.stamp_ns[0], motion.stamp_ns[-1] + 1, STEP_NS)
    rows = np.searchsorted(motion.stamp_ns, even)
    station = run.series.station[rows]
    corners = geometry.transform_to_map(
        outline.corners, motion.x[rows], motion.y[rows], motion.yaw[rows]
    )
    offsets = geometry.offset_from_line(corners.reshape(-1, 2), scene.reference).reshape(-1, 4)
    edges = scene.left, scene.right
    rooms = [np.abs(geometry.offset_from_line(scene.reference, edge)) for edge in edges]
    half = np.minimum(np.min(rooms, axis=0), LANE_M / 2)
    half = np.interp(station, geometry.arc_length(scene.reference), half)
    others = tuple(_other(obstacle, scene, even) for obstacle in scene.obstacles)
    occupied = np.zeros(len(rows), bool)
    for other in others:
        ahead = other.station - station
        is_near = (ahead > -outline.rear - other.radius) & (ahead < AHEAD_M)
        occupied |= is_near & (np.abs(other.offset) - other.radius < half - REACHES_M)
    around = 2 * (AROUND_NS // STEP_NS) + 1
    busy = np.convolve(occupied, np.ones(around))[around // 2 :][: len(rows)] > 0.5
    return Traffic(
        station=station,
        aside=np.abs(run.series.contouring[rows]),
        speed=run.series.speed[rows],
        left=offsets.max(axis=1),
        right=-offsets.min(axis=1),
        half=half,
        is_free=~busy,
        others=others,
    )


def _other(obstacle, scene, stamp_ns):
    """Return an obstacle in the coordinates of the reference at each stamp."""
    columns = np.full((3, len(stamp_ns)), np.nan)
    place = np.column_stack(obstacle_position(obstacle, scene, stamp_ns))
    seen = np.isfinite(place).all(axis=1)
    if seen.any():
        foot = geometry.project_drive(place[seen], scene.reference, SEARCH_M)
        columns[:2, seen] = foot.distance, foot.offset
        columns[2, 1:] = np.diff(columns[0]) / (STEP_NS * 1e-9)
    return Other(*columns, obstacle.radius)


def _is_met(run, traffic, other):
    """Return whether the car and one that comes meet within MEETS_S and are not yet past."""
    outline = run.drive.facts.outline
    ahead = other.station - traffic.station
    before = ahead - other.radius - outline.front < MEETS_S * (traffic.speed - other.speed)
    return (other.speed < -MOVING_MPS) & before & (ahead > -outline.rear - other.radius)
