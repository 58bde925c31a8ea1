"""Schema of the scenario file: every key with its range and unit.

docs/scenarios.md gives the meaning of each key; a test keeps both equal.
"""

from math import inf
from typing import Annotated, Literal

from msgs_yaml.strict_yaml import Pattern, Range, Struct, YamlError
from node_runtime import parameters
from scenario_publisher.expectations import NOTHING_EXPECTED, Expectations

STRAIGHT, ALONG_ROAD = 'straight', 'along_road'  # of obstacles[].motion
# coordinates and speeds: the ranges of topics.yaml
Coordinate = Annotated[float, Range(-10000.0, 10000.0, 'm')]
Station = Annotated[float, Range(0.0, 20000.0, 'm')]
Length = Annotated[float, Range(0.5, 20000.0, 'm')]
Offset = Annotated[float, Range(-100.0, 100.0, 'm')]
Yaw = Annotated[float, Range(-6.3, 6.3, 'rad')]
# 5 m is the tightest circle a passenger car can turn
Curvature = Annotated[float, Range(-0.2, 0.2, '1/m')]
Speed = Annotated[float, parameters.SPEED]
StartSpeed = Annotated[float, parameters.START_SPEED]
LateralSpeed = Annotated[float, parameters.LATERAL_SPEED]
YawRate = Annotated[float, parameters.YAW_RATE]
ActorSpeed = Annotated[float, Range(0.0, 50.0, 'm/s')]
Velocity = Annotated[float, Range(-50.0, 50.0, 'm/s')]
Radius = Annotated[float, Range(0.01, 50.0, 'm')]
Time = Annotated[float, Range(0.0, 600.0, 's')]
Spacing = Annotated[float, Range(0.1, 5.0, 'm')]
Friction = Annotated[float, parameters.ROAD_FRICTION]
Name = Annotated[str, Pattern('[a-z][a-z0-9_]{0,63}', '1 to 64 of a-z, 0-9, _, the first a letter')]
Text = Annotated[str, Pattern(r'(?s).{1,1000}', '1 to 1000 characters')]


class ScenarioError(YamlError):
    """A scenario that cannot be used; the text names file, line, dotted key and what is allowed.

    check   what of `scenario.CHECKS` did not hold, '' before any of them
    """

    check = ''


class KeyedError(Exception):
    """A mistake beyond the schema: a dotted key of the file, and what is wrong with its value.

    check   what of `scenario.CHECKS` does not hold
    """

    check = ''


class Pose(Struct):
    """Position and heading in the frame map."""

    x_m: Coordinate
    y_m: Coordinate
    yaw_rad: Yaw


class Straight(Struct):
    """A straight."""

    length_m: Length


class Arc(Struct):
    """Constant curvature."""

    length_m: Length
    curvature_1pm: Curvature


class Clothoid(Struct):
    """Curvature that changes linearly with the distance."""

    length_m: Length
    start_curvature_1pm: Curvature
    end_curvature_1pm: Curvature


class LaneChange(Struct):
    """S-shaped lateral shift; length measured along the initial heading."""

    length_m: Length
    offset_m: Offset


class StraightSegment(Struct):
    """A block with one key."""

    straight: Straight


class ArcSegment(Struct):
    """A block with one key."""

    arc: Arc


class ClothoidSegment(Struct):
    """A block with one key."""

    clothoid: Clothoid


class LaneChangeSegment(Struct):
    """A block with one key."""

    lane_change: LaneChange


Segment = StraightSegment | ArcSegment | ClothoidSegment | LaneChangeSegment


class SegmentLine(Struct):
    """A line of curvature over distance, with its initial pose."""

    segments: tuple[Segment, ...]
    start: Pose


class PointLine(Struct):
    """A smooth line through points."""

    points_m: tuple[tuple[Coordinate, Coordinate], ...]


Line = SegmentLine | PointLine


class ConstantOffset(Struct):
    """An edge at a constant distance from the centre line."""

    offset_m: Offset


class OffsetTable(Struct):
    """An edge whose distance from the centre line changes linearly between stations."""

    stations_m: tuple[Station, ...]
    offsets_m: tuple[Offset, ...]


class PointEdge(Struct):
    """An edge as a polyline."""

    points_m: tuple[tuple[Coordinate, Coordinate], ...]


Edge = ConstantOffset | OffsetTable | PointEdge


class Edges(Struct):
    """Both edges of the road."""

    left: Edge
    right: Edge


class Road(Struct):
    """The drivable road."""

    centre_line: Line
    edges: Edges


class ConstantSpeed(Struct):
    """A constant desired speed."""

    constant_mps: Speed


class SpeedTable(Struct):
    """Desired speed over the station of the path, linear between stations."""

    stations_m: tuple[Station, ...]
    speeds_mps: tuple[Speed, ...]


class FrictionPatch(Struct):
    """A stripe along the road with another friction."""

    from_m: Station
    to_m: Station
    from_offset_m: Offset
    to_offset_m: Offset
    friction: Friction


class MapObstacle(Struct):
    """A round obstacle placed in the map."""

    x_m: Coordinate
    y_m: Coordinate
    radius_m: Radius
    vx_mps: Velocity = 0.0
    vy_mps: Velocity = 0.0
    appears_at_s: Time = 0.0
    disappears_at_s: Time = inf


class RoadObstacle(Struct):
    """A round obstacle placed along the centre line of the road."""

    station_m: Station
    offset_m: Offset
    radius_m: Radius
    along_mps: Velocity = 0.0
    across_mps: Velocity = 0.0
    motion: Literal['straight', 'along_road'] = STRAIGHT
    appears_at_s: Time = 0.0
    disappears_at_s: Time = inf


class Waypoint(Struct):
    """A place on the road, the speed there, and how long to wait there."""

    station_m: Station
    offset_m: Offset
    speed_mps: ActorSpeed
    wait_s: Time = 0.0


class WaypointObstacle(Struct):
    """A round obstacle that follows way-points."""

    waypoints: tuple[Waypoint, ...]
    radius_m: Radius
    appears_at_s: Time = 0.0
    disappears_at_s: Time = inf


Obstacle = MapObstacle | RoadObstacle | WaypointObstacle


class StartOnPath(Struct):
    """A start on the coarse path, along it; the speed defaults to the desired one there."""

    progress_m: Station
    speed_mps: StartSpeed | None = None
    lateral_mps: LateralSpeed = 0.0
    yaw_rate_radps: YawRate = 0.0


class StartPose(Struct):
    """A start anywhere on the road."""

    x_m: Coordinate
    y_m: Coordinate
    yaw_rad: Yaw
    speed_mps: StartSpeed
    lateral_mps: LateralSpeed = 0.0
    yaw_rate_radps: YawRate = 0.0


class Stop(Struct):
    """End of the run: finish line, time limit or standstill, whichever comes first."""

    progress_m: Annotated[float, Range(1.0, 20000.0, 'm')]
    time_s: Annotated[float, parameters.RUN_TIME]
    standstill_s: Annotated[float, parameters.RUN_TIME] | None = None


class Sampling(Struct):
    """Greatest distance between neighbouring points of the published lines."""

    path_m: Spacing = 0.5
    edges_m: Spacing = 1.0


class File(Struct):
    """A complete scenario file."""

    schema: Literal[1]
    name: Name
    description: Text
    road: Road
    path: Line
    speed: ConstantSpeed | SpeedTable
    friction: Friction
    start: StartOnPath | StartPose
    stop: Stop
    obstacles: tuple[Obstacle, ...]
    sampling: Sampling = Sampling()
    friction_patches: tuple[FrictionPatch, ...] = ()
    expect: Expectations = NOTHING_EXPECTED
