"""Schema of the scenario file: every key with its range and unit.

The comment of a key is its meaning in the reference of the site; docs/scenarios.md explains them.
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
Ahead = Annotated[float, Range(-50.0, 50.0, 'm')]
Time = Annotated[float, Range(0.0, 600.0, 's')]
RunTime = Annotated[float, parameters.RUN_TIME]
FinishStation = Annotated[float, Range(1.0, 20000.0, 'm')]
SightRange = Annotated[float, Range(1.0, 20000.0, 'm')]
Reaction = Annotated[float, Range(0.0, 5.0, 's')]
Deceleration = Annotated[float, Range(0.5, 12.0, 'm/s^2')]
Spacing = Annotated[float, Range(0.1, 5.0, 'm')]
Friction = Annotated[float, parameters.ROAD_FRICTION]
Name = Annotated[str, Pattern('[a-z][a-z0-9_]{0,63}', '1 to 64 of a-z, 0-9, _, the first a letter')]
Predictions = Literal['none', 'exact']
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
    yaw_rad: Yaw  # heading


class Straight(Struct):
    """A straight."""

    length_m: Length  # along it


class Arc(Struct):
    """Constant curvature."""

    length_m: Length  # along it
    curvature_1pm: Curvature  # 1 / radius, to the left positive


class Clothoid(Struct):
    """Curvature that changes linearly with the distance."""

    length_m: Length
    start_curvature_1pm: Curvature  # at its start
    end_curvature_1pm: Curvature  # at its end


class LaneChange(Struct):
    """S-shaped lateral shift; length measured along the initial heading."""

    length_m: Length  # measured straight ahead, not along the curve
    offset_m: Offset  # to the left; it ends exactly there, with the heading it began with


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

    segments: tuple[Segment, ...]  # joined without a break in position and heading
    start: Pose  # where the line starts


class PointLine(Struct):
    """A smooth line through points."""

    # [x, y], 2 to 100000 of them, of a cubic spline, whose curvature is continuous
    points_m: tuple[tuple[Coordinate, Coordinate], ...]


Line = SegmentLine | PointLine


class ConstantOffset(Struct):
    """An edge at a constant distance from the centre line."""

    offset_m: Offset  # from the centre line, to the left positive


class OffsetTable(Struct):
    """An edge whose distance from the centre line changes linearly between stations."""

    # increasing; before the first and behind the last one the offset stays
    stations_m: tuple[Station, ...]
    offsets_m: tuple[Offset, ...]  # at each; at most 1 m per metre of road


class PointEdge(Struct):
    """An edge as a polyline."""

    # [x, y], 2 to 100000 of them; corners up to 60 deg; as long as the road
    points_m: tuple[tuple[Coordinate, Coordinate], ...]


Edge = ConstantOffset | OffsetTable | PointEdge


class Edges(Struct):
    """Both edges of the road."""

    left: Edge
    right: Edge


class Road(Struct):
    """The drivable road."""

    centre_line: Line  # stations and offsets on the road refer to it
    edges: Edges


class ConstantSpeed(Struct):
    """A constant desired speed."""

    constant_mps: Speed  # one desired speed


class SpeedTable(Struct):
    """Desired speed over the station of the path, linear between stations."""

    # increasing; before the first and behind the last one the speed stays
    stations_m: tuple[Station, ...]
    speeds_mps: tuple[Speed, ...]  # at each


class FrictionPatch(Struct):
    """A stripe along the road with another friction."""

    from_m: Station  # station of the centre line at which it begins
    to_m: Station  # at which it ends, 0.1 m or more behind `from_m` and on the road
    from_offset_m: Offset  # its right side, to the left of the centre line
    to_offset_m: Offset  # its left side, 0.1 m or more to the left of `from_offset_m`
    friction: Friction  # scale of the grip on it


class MapObstacle(Struct):
    """An obstacle placed in the map, a disc or several."""

    x_m: Coordinate  # of its centre
    y_m: Coordinate  # of its centre
    radius_m: Radius  # of every disc
    vx_mps: Velocity = 0.0  # velocity in the map
    vy_mps: Velocity = 0.0  # velocity in the map
    appears_at_s: Time = 0.0  # after the start, from then on it is there
    disappears_at_s: Time = inf  # from then on it is gone
    # places of its discs, 1 to 16, ahead of its centre: in its direction, standing along x
    discs_m: tuple[Ahead, ...] = (0.0,)


class RoadObstacle(Struct):
    """An obstacle placed along the centre line of the road, a disc or several."""

    station_m: Station  # of its centre along the centre line of the road
    offset_m: Offset  # of its centre to the left of that
    radius_m: Radius  # of every disc
    along_mps: Velocity = 0.0  # along the centre line, in its direction at that station
    across_mps: Velocity = 0.0  # to the left of it
    # straight on, or along the road at its offset (across_mps changes it)
    motion: Literal['straight', 'along_road'] = STRAIGHT
    appears_at_s: Time = 0.0  # after the start, from then on it is there
    disappears_at_s: Time = inf  # from then on it is gone
    # places of its discs, 1 to 16, ahead of its centre: along the road, in its direction if it
    # goes straight on
    discs_m: tuple[Ahead, ...] = (0.0,)


class Waypoint(Struct):
    """A place on the road, the speed there, and how long to wait there."""

    station_m: Station  # along the centre line; may decrease from one to the next
    offset_m: Offset  # to the left of it
    speed_mps: ActorSpeed  # there, along its way
    wait_s: Time = 0.0  # how long it stands there, where `speed_mps` is 0


class WaypointObstacle(Struct):
    """An obstacle that follows way-points, a disc or several."""

    waypoints: tuple[Waypoint, ...]  # where it goes, 2 to 100
    radius_m: Radius  # of every disc
    appears_at_s: Time = 0.0  # after the start, from then on it is there
    disappears_at_s: Time = inf  # from then on it is gone
    # places of its discs, 1 to 16, ahead of it along the road
    discs_m: tuple[Ahead, ...] = (0.0,)


Obstacle = MapObstacle | RoadObstacle | WaypointObstacle


class StartOnPath(Struct):
    """A start on the coarse path, along it; the speed defaults to the desired one there."""

    progress_m: Station  # station of the path; pose and heading are those of the path
    speed_mps: StartSpeed | None = None  # forwards
    lateral_mps: LateralSpeed = 0.0  # to the left positive: the vehicle slides
    yaw_rate_radps: YawRate = 0.0  # to the left positive


class StartPose(Struct):
    """A start anywhere on the road."""

    x_m: Coordinate
    y_m: Coordinate
    yaw_rad: Yaw  # heading
    speed_mps: StartSpeed  # forwards
    lateral_mps: LateralSpeed = 0.0  # to the left positive: the vehicle slides
    yaw_rate_radps: YawRate = 0.0  # to the left positive


class Stop(Struct):
    """End of the run: finish line, time limit or standstill, whichever comes first."""

    progress_m: FinishStation  # station of the path at which the finish line crosses it
    time_s: RunTime  # longest run
    # a car that has moved and stands for so long ends the run; 1 s where it is left out
    standstill_s: RunTime | None = None


class Sight(Struct):
    """Which obstacles are seen from the car; others are not published."""

    stations_m: tuple[Station, ...] = (0.0,)  # of the path, increasing
    # at each, along the path from the car; linear between stations
    ranges_m: tuple[SightRange, ...] = (20000.0,)
    # the desired speed is bounded so that the car can stop within the whole range, or half of it
    stop_within: Literal['whole', 'half'] = 'whole'
    reaction_s: Reaction = 0.5  # until the brakes act
    deceleration_mps2: Deceleration = 5.0
    hidden_by_obstacles: bool = False  # whether an obstacle hides others behind it
    # the desired speed is bounded so that the car can stop for who comes out from behind a standing
    # obstacle at so much, or has passed before; 0: nobody does
    emerging_mps: ActorSpeed = 0.0


class Sampling(Struct):
    """Greatest distance between neighbouring points of the published lines."""

    path_m: Spacing = 0.5  # of the path
    edges_m: Spacing = 1.0  # of the centre line and the edges


class File(Struct):
    """A complete scenario file."""

    schema: Literal[1]  # version of this schema
    name: Name  # of the scenario; the folder of a run is named after it
    description: Text  # what it is about, for people
    road: Road
    path: Line  # the coarse path: it passes an obstacle on the side to be passed
    speed: ConstantSpeed | SpeedTable  # desired
    friction: Friction  # scale of the grip of the road; 1 is dry asphalt
    start: StartOnPath | StartPose  # of the vehicle
    stop: Stop
    obstacles: tuple[Obstacle, ...]  # 0 to 200; their ids are 1, 2, ... in this order
    sampling: Sampling = Sampling()
    friction_patches: tuple[FrictionPatch, ...] = ()  # places with another friction, 0 to 16
    expect: Expectations = NOTHING_EXPECTED  # metrics with bounds: what a run is to come to
    sight: Sight | None = None  # where a crest or an obstacle hides what is behind it
    # exact: where the obstacles will be is published, too
    predictions: Predictions = 'none'
