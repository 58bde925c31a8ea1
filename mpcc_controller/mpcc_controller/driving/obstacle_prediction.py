"""The obstacles that a plan is made for: from messages to a prediction of each. SI units.

Each message is measured (with errors, a test option), and each of its obstacles gets a `Track`:

    braking    if its last speeds show more of it than noise explains; it brakes to a stop. One that
               gets faster keeps its speed: its acceleration tells little about the next seconds.
    a line     if it moves along the road or against it: it keeps its angle to the road and so, if
               that is 0, its distance from the edges. A message has the velocity of an obstacle,
               not its intention, and where the road bends nobody drives straight on.

/scenario/obstacles holds every known obstacle. What is not in it is unknown from then on, whether
it went away or was only missed. So what vanishes goes on as predicted for `surroundings.memory_s`
after it was last seen and is forgotten then; an obstacle that is gone is avoided for that time at
most. Which obstacles a problem has room for: `stage_parameters.closest_discs`.
"""

import math
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from mpcc_controller.driving.measurement_errors import measured_obstacles
from mpcc_controller.parameters import ControllerParams, Surroundings
from mpcc_controller.path import arc, frenet_frame, reference_path, road_edges
from mpcc_controller.path.arc import Pose
from mpcc_controller.problem.obstacle_motion import LEAST_SPEED_MPS, Line, PredictedObstacle
from mpcc_controller.problem.stage_parameters import Scene
from msgs_yaml.conversions import NS_PER_S, ns_to_s
from msgs_yaml.types import Obstacle, Obstacles, VehicleState

MAX_DECELERATION = 12.0  # m/s^2; more is an error of the measured velocity
LEAST_DECELERATION = 1.0  # m/s^2; an obstacle that surely slows down by less goes on
# Student's t that a value exceeds once in 10,000 times, for 1, 2, ... degrees of freedom
STUDENT = (3183.1, 70.7, 22.2, 13.03, 9.68, 8.02, 7.06, 6.44, 6.01, 5.69, 5.45, 5.26, 5.11, 4.99)
LEAST_COURSE_MPS = 1.0  # a slower obstacle shows no direction
STEP_M = 1.0  # between two corners of a line
LONGEST_S = 4.0  # of driving along a line, then straight on: more than horizon and memory
STRAIGHT_M = 0.02  # a line that leaves its tangent by less is straight
CONTINUATION_M = 1e3  # of a line past its end


class Track(NamedTuple):
    """What is known of an obstacle since it was last seen."""

    stamp_ns: int  # when that was
    obstacle: PredictedObstacle  # as it was then
    speeds: tuple[tuple[int, float], ...]  # (stamp_ns, m/s) of the last messages, the newest last


class Tracks(NamedTuple):
    """What is known of obstacles from tick to tick."""

    by_id: Mapping[int, Track] = MappingProxyType({})
    # those of the last message and those that are remembered, at its stamp; None before it
    obstacles: Obstacles | None = None


def observe(
    known: Tracks, scene: Scene, true_state: VehicleState, seen_ns: int, params: ControllerParams
) -> Tracks:
    """Return what is known after the obstacles of the scene were seen at an instant.

    The errors with which they are seen depend on that instant and on the true state of the car. The
    controller shows the obstacles of every tick since its (re)start, and no others: then a node,
    the ring in process and a replay predict the same bits, whatever was received between.
    """
    if scene.obstacles is None:
        return known._replace(obstacles=None)
    seen = measured_obstacles(scene.obstacles, true_state, seen_ns, params.measurement_errors)
    rules, stamp_ns = params.surroundings, seen.stamp_ns
    speeds = [_last_speeds(o, known.by_id.get(o.id), stamp_ns, rules) for o in seen.items]
    present = [
        PredictedObstacle(*o, _deceleration(o, last), _line(o, scene, rules))
        for o, last in zip(seen.items, speeds)
    ]
    new = {o.id: Track(stamp_ns, o, last) for o, last in zip(present, speeds)}
    longest_s = max(rules.memory_s or 0.0, rules.braking_window_s or 0.0)
    ages_s = {k: ns_to_s(stamp_ns - t.stamp_ns) for k, t in (known.by_id | new).items()}
    tracks = {
        k: new.get(k) or known.by_id[k] for k, age_s in ages_s.items() if 0.0 <= age_s <= longest_s
    }
    remembered = [
        track.obstacle.moved(ages_s[key])
        for key, track in tracks.items()
        if rules.memory_s and key not in new and ages_s[key] <= rules.memory_s
    ]
    return Tracks(tracks, seen._replace(items=(*present, *remembered)))


def scene_at(known: Tracks, scene: Scene, stamp_ns: int) -> Scene:
    """Return the scene with the known obstacles, moved to an instant as they are predicted to."""
    if known.obstacles is None:
        return scene._replace(obstacles=None)
    t = ns_to_s(stamp_ns - known.obstacles.stamp_ns)
    items = tuple(o.moved(t) for o in known.obstacles.items)
    return scene._replace(obstacles=Obstacles(stamp_ns, items))


def _last_speeds(
    o: Obstacle, before: Track | None, stamp_ns: int, params: Surroundings
) -> tuple[tuple[int, float], ...]:
    """Return the speeds of an obstacle over `surroundings.braking_window_s`, the newest last."""
    if params.braking_window_s is None:
        return ()
    speeds = before.speeds if before else ()
    if speeds and speeds[-1][0] == stamp_ns:
        speeds = speeds[:-1]  # the message is repeated
    elif speeds and speeds[-1][0] > stamp_ns:
        speeds = ()  # the clock was set back
    kept = (s for s in speeds if ns_to_s(stamp_ns - s[0]) <= params.braking_window_s)
    return *kept, (stamp_ns, float(np.hypot(o.vX, o.vY)))


def _deceleration(o: Obstacle, speeds: Sequence[tuple[int, float]]) -> float:
    """Return the deceleration [m/s^2] that speeds show, 0 where noise may explain it.

    A line is fitted to the last ones. An obstacle brakes if the slope differs from 0 by more than
    the speeds scatter about the line: as many speeds as that takes, from three on, are used.
    """
    if np.hypot(o.vX, o.vY) < LEAST_SPEED_MPS:
        return 0.0
    for count in range(3, len(speeds) + 1):
        t, v = np.array(speeds[-count:], float).T
        t = (t - t[-1]) / NS_PER_S
        t -= np.mean(t)
        square = np.sum(t**2)
        slope = np.sum(t * v) / square
        scatter = np.sum((v - np.mean(v) - slope * t) ** 2) / (count - 2)
        uncertain = STUDENT[min(count - 3, len(STUDENT) - 1)] * np.sqrt(scatter / square)
        if -slope > uncertain:
            return min(float(-slope), MAX_DECELERATION)
        if uncertain - slope < LEAST_DECELERATION:
            return 0.0
    return 0.0


def _line(o: Obstacle, scene: Scene, params: Surroundings) -> Line | None:
    """Return the line of an obstacle that moves along a road that bends; None: straight on.

    It is on the road, and its direction differs from that of the road, or the opposite one, by at
    most `surroundings.follow_road_rad`; without that parameter nobody follows the road.
    """
    if params.follow_road_rad is None or scene.path is None or scene.road is None:
        return None
    speed = math.hypot(o.vX, o.vY)
    if not LEAST_COURSE_MPS <= speed < math.inf or not math.isfinite(o.X + o.Y):
        return None

    def track_at(theta):
        arcs, _ = reference_path.arcs_at(scene.path, theta)
        return road_edges.track_beside(scene.road, arcs, params.edge_window_m, aligned=True)

    theta = reference_path.project(scene.path, o.X, o.Y, None, 0.0)
    course = math.atan2(o.vY, o.vX)
    here = track_at(np.array([theta]))
    pose = Pose(*(float(column[0]) for column in here.centre[:3]))
    turned = math.remainder(course - pose.psi, 2 * math.pi)
    way = 1.0 if abs(turned) <= math.pi / 2 else -1.0
    angle = turned if way > 0 else math.remainder(turned - math.pi, 2 * math.pi)
    offset = arc.contouring_error(pose, o.X, o.Y)
    if abs(angle) > params.follow_road_rad or abs(offset) > here.half_width[0]:
        return None
    # from its last disc on
    behind = math.ceil(max((math.hypot(*place) for place in o.others), default=0.0) / STEP_M)
    along = np.arange(-behind * STEP_M, speed * LONGEST_S + STEP_M, STEP_M)
    centre = track_at(theta + way * along).centre
    aside = offset + way * math.tan(angle) * along
    X, Y, _ = frenet_frame.offset_left(centre, aside)
    # at the distance 0 the obstacle is
    X, Y = X + (o.X - X[behind]), Y + (o.Y - Y[behind])
    leaves = math.cos(course) * (Y - o.Y) - math.sin(course) * (X - o.X)
    steps = np.hypot(np.diff(X), np.diff(Y))
    # inside of the centre of a bend there is no line
    if np.max(np.abs(leaves)) < STRAIGHT_M or not np.min(steps) > 0:
        return None
    X, Y = (np.append(x, x[-1] + CONTINUATION_M * (x[-1] - x[-2]) / steps[-1]) for x in (X, Y))
    distance = np.concatenate(([0.0], np.cumsum(steps)))
    distance -= distance[behind]
    return Line(np.append(distance, distance[-1] + CONTINUATION_M), X, Y)
