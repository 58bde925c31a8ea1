"""The scenario file, key by key: what may stand where, in which range and unit.

What each key means is told in docs/scenarios.md; a test keeps both equal.
"""

from dataclasses import dataclass
from math import inf
from typing import Annotated, Literal

from node_runtime import parameters
from node_runtime.parameters import Range
from scenario_publisher.quantities import (
    Coordinate,
    Friction,
    Name,
    Offset,
    Radius,
    Spacing,
    Speed,
    Station,
    Text,
    Time,
    Velocity,
    Yaw,
)
from scenario_publisher.segments import Segment


@dataclass(frozen=True)
class Pose:
    """Position and heading in the frame map."""

    x_m: Coordinate
    y_m: Coordinate
    yaw_rad: Yaw


@dataclass(frozen=True)
class SegmentLine:
    """A line made from curvature over distance and the pose it starts with."""

    segments: tuple[Segment, ...]
    start: Pose


@dataclass(frozen=True)
class PointLine:
    """A smooth line through points."""

    points_m: tuple[tuple[Coordinate, Coordinate], ...]


Line = SegmentLine | PointLine


@dataclass(frozen=True)
class ConstantOffset:
    """An edge at a constant distance from the centre line."""

    offset_m: Offset


@dataclass(frozen=True)
class OffsetTable:
    """An edge whose distance from the centre line changes linearly between stations."""

    stations_m: tuple[Station, ...]
    offsets_m: tuple[Offset, ...]


@dataclass(frozen=True)
class PointEdge:
    """An edge of its own, straight between its points."""

    points_m: tuple[tuple[Coordinate, Coordinate], ...]


Edge = ConstantOffset | OffsetTable | PointEdge


@dataclass(frozen=True)
class Edges:
    """What bounds the road."""

    left: Edge
    right: Edge


@dataclass(frozen=True)
class Road:
    """Where one may drive."""

    centre_line: Line
    edges: Edges


@dataclass(frozen=True)
class ConstantSpeed:
    """One desired speed."""

    constant_mps: Speed


@dataclass(frozen=True)
class SpeedTable:
    """Desired speed over the station of the path, linear between stations."""

    stations_m: tuple[Station, ...]
    speeds_mps: tuple[Speed, ...]


@dataclass(frozen=True)
class FrictionPatch:
    """A stripe along the road with a friction of its own."""

    from_m: Station
    to_m: Station
    from_offset_m: Offset
    to_offset_m: Offset
    friction: Friction


@dataclass(frozen=True)
class MapObstacle:
    """A round obstacle placed in the map."""

    x_m: Coordinate
    y_m: Coordinate
    radius_m: Radius
    vx_mps: Velocity = 0.0
    vy_mps: Velocity = 0.0
    appears_at_s: Time = 0.0
    disappears_at_s: Time = inf


@dataclass(frozen=True)
class RoadObstacle:
    """A round obstacle placed along the centre line of the road."""

    station_m: Station
    offset_m: Offset
    radius_m: Radius
    along_mps: Velocity = 0.0
    across_mps: Velocity = 0.0
    appears_at_s: Time = 0.0
    disappears_at_s: Time = inf


@dataclass(frozen=True)
class StartOnPath:
    """A start on the coarse path, along it; left out, the speed is the desired one there."""

    progress_m: Station
    speed_mps: Speed = None


@dataclass(frozen=True)
class StartPose:
    """A start anywhere on the road."""

    x_m: Coordinate
    y_m: Coordinate
    yaw_rad: Yaw
    speed_mps: Speed


@dataclass(frozen=True)
class Stop:
    """What ends the run, whichever comes first."""

    progress_m: Annotated[float, Range(1.0, 10000.0, 'm')]
    time_s: Annotated[float, parameters.RUN_TIME]


@dataclass(frozen=True)
class Sampling:
    """Longest distance between neighbouring points of what is published."""

    path_m: Spacing = 0.5
    edges_m: Spacing = 1.0


@dataclass(frozen=True)
class File:
    """A whole scenario."""

    schema: Literal[1]
    name: Name
    description: Text
    road: Road
    path: Line
    speed: ConstantSpeed | SpeedTable
    friction: Friction
    start: StartOnPath | StartPose
    stop: Stop
    obstacles: tuple[MapObstacle | RoadObstacle, ...]
    sampling: Sampling = Sampling()
    friction_patches: tuple[FrictionPatch, ...] = ()
