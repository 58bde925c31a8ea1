"""Obstacles that move along the road are expected to follow it. SI units.

One whose velocity points along the road, or against it, keeps its angle to the road and so, if that
is 0, its distance from the edges. On a straight road that is a constant velocity.
"""

import math

import numpy as np

from mpcc_controller.parameters import Surroundings
from mpcc_controller.path import arc, reference_path, road_edges
from mpcc_controller.path.arc import Pose
from mpcc_controller.path.reference_path import ReferencePath
from mpcc_controller.path.road_edges import Road
from mpcc_controller.problem.obstacle_motion import AnyObstacle, ExpectedObstacle, Line
from msgs_yaml.types import Obstacles

LEAST_SPEED_MPS = 1.0  # a slower obstacle shows no direction
STEP_M = 1.0  # between two corners of a line
LONGEST_S = 4.0  # of driving along a line, then straight on: more than horizon and memory
STRAIGHT_M = 0.02  # a line that leaves its tangent by less is straight
CONTINUATION_M = 1e3  # of a line past its end


def along_road(
    obstacles: Obstacles, path: ReferencePath, road: Road, params: Surroundings
) -> Obstacles:
    """Return the obstacles, those that move along a road that bends with the line they follow.

    Those are on the road, and their direction differs from that of the road, or the opposite one,
    by at most `surroundings.follow_road_rad`; without that parameter there are none.
    """
    if params.follow_road_rad is None:
        return obstacles
    items = (_with_line(o, path, road, params) for o in obstacles.items)
    return obstacles._replace(items=tuple(items))


def _with_line(o: AnyObstacle, path, road, params) -> AnyObstacle:
    speed = math.hypot(o.vX, o.vY)
    if not LEAST_SPEED_MPS <= speed < math.inf or not math.isfinite(o.X + o.Y):
        return o
    theta = reference_path.project(path, o.X, o.Y, None, 0.0)
    course = math.atan2(o.vY, o.vX)
    here = _centre(path, road, np.array([theta]), params)
    pose = Pose(*(float(column[0]) for column in here.centre[:3]))
    turned = math.remainder(course - pose.psi, 2 * math.pi)
    way = 1.0 if abs(turned) <= math.pi / 2 else -1.0
    angle = turned if way > 0 else math.remainder(turned - math.pi, 2 * math.pi)
    offset = arc.contouring_error(pose, o.X, o.Y)
    if abs(angle) > params.follow_road_rad or abs(offset) > here.half_width[0]:
        return o
    along = np.arange(0.0, speed * LONGEST_S + STEP_M, STEP_M)
    centre = _centre(path, road, theta + way * along, params).centre
    aside = offset + way * math.tan(angle) * along
    X, Y = centre.X - aside * np.sin(centre.psi), centre.Y + aside * np.cos(centre.psi)
    # it begins where the obstacle is
    X, Y = X + (o.X - X[0]), Y + (o.Y - Y[0])
    leaves = math.cos(course) * (Y - o.Y) - math.sin(course) * (X - o.X)
    if np.max(np.abs(leaves)) < STRAIGHT_M:
        return o
    steps = np.hypot(np.diff(X), np.diff(Y))
    if not np.min(steps) > 0:  # inside of the centre of a bend there is no line
        return o
    X, Y = (np.append(x, x[-1] + CONTINUATION_M * (x[-1] - x[-2]) / steps[-1]) for x in (X, Y))
    distance = np.concatenate(([0.0], np.cumsum(steps)))
    line = Line(np.append(distance, distance[-1] + CONTINUATION_M), X, Y)
    braking = o.braking if isinstance(o, ExpectedObstacle) else 0.0
    return ExpectedObstacle(*o[:6], braking=braking, line=line)


def _centre(path, road, theta, params):
    """Return the track beside the path at `theta` (k,)."""
    arcs, _ = reference_path.arcs_at(path, theta)
    return road_edges.track_beside(road, arcs, params.edge_window_m, aligned=True)
