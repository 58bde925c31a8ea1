"""The obstacles that a plan is made for: from messages to predictions of each. SI units.

Each message is measured (with errors, a test option). Without `tracker.position_m` every obstacle
keeps the velocity that it is seen with. With it each has a track (`obstacle_tracks`), and
hypotheses:

    stands     where it is
    lane       along the road or against it, at a constant angle to the road: a message has the
               velocity of an obstacle, not its intention, and where the road bends nobody drives
               straight on
    straight   in its direction
    turn       at a constant yaw rate

at constant speed or, all but the first, braking to a stop. Nobody is expected to get faster. Each
claims an acceleration, and is the more probable the better the acceleration of the track agrees
(the static multiple-model estimator of Magill, IEEE Trans. Automatic Control 10(4), 1965, over the
memory of the filter; one that fits an acceleration pays for the values that it might have had).

An obstacle keeps clear of the plan with a probability of 1 - `tracker.contact`: hypothesis j of
probability p_j counts where p_j is more, and the radius grows by the quantile 1 - contact / p_j of
its position, whose covariance is that of the track as the hypothesis moves it on (chance
constraints with risk by mode: Blackmore, Ono, Bektassov, Williams, IEEE Trans. Robotics 26(3),
2010). Predictions from outside take the place of the hypotheses. Which discs a problem has room
for: `stage_parameters.obstacle_slots`.
"""

import math
from collections.abc import Mapping, Sequence
from statistics import NormalDist
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np

from mpcc_controller.driving import obstacle_tracks
from mpcc_controller.driving.measurement_errors import measured_obstacles
from mpcc_controller.driving.obstacle_tracks import Track
from mpcc_controller.parameters import ControllerParams
from mpcc_controller.path import arc, frenet_frame, reference_path, road_edges
from mpcc_controller.problem.obstacle_motion import Course, PredictedObstacle
from mpcc_controller.problem.stage_parameters import Scene
from msgs_yaml.conversions import ns_to_s
from msgs_yaml.types import Obstacle, Obstacles, VehicleState

MAX_DECELERATION = 12.0  # m/s^2; more, or more to the side, is an error of the measured velocity
MAX_LATERAL = 15.0
LEAST_COURSE_MPS = 1.0  # a slower obstacle shows no direction
# priors, and by how much accelerations [m/s^2] and speeds [m/s] differ from what is claimed
STANDS, BRAKES, FOLLOWS, TURNS = 0.5, 0.2, 0.9, 0.15
ENDS, HELD_MPS2 = 0.5, 4.0  # probability that a turn ends now; the most that one is held with
KEEPS_MPS2, TURNS_MPS2, MOVES_MPS = 0.5, 3.0, 5.0
_normal = NormalDist().cdf
BEYOND_S = 0.5  # of a course past the horizon: delay and memory
FAR_M = 30.0  # beside what car and obstacle drive: one farther apart is not told from straight on
STEP_M = 1.0  # between two points of the centre of the road
POINTS = 64  # of a line along the road
MOST_UNLIKELY = 0.98  # of contact / p_j
LONGEST_AGE_S = 1.0  # of a prediction from outside
LANE, STRAIGHT, TURN, STILL = range(4)


class Seen(NamedTuple):
    """An obstacle as it was last seen."""

    stamp_ns: int  # when that was
    predicted: tuple[PredictedObstacle, ...]  # the discs of every hypothesis, the likeliest first


class Tracks(NamedTuple):
    """What is known of obstacles from tick to tick."""

    by_id: Mapping[int, Track] = MappingProxyType({})
    seen: Mapping[int, Seen] = MappingProxyType({})  # by id
    message: Obstacles | None = None  # the last one, as it was measured
    # those of the last message and those that are remembered, at its stamp; None before it
    obstacles: Obstacles | None = None


class Hypothesis(NamedTuple):
    """How an obstacle may go on."""

    kind: int
    braking: float  # m/s^2
    lateral: float  # m/s^2, to the left, now
    probability: float


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
    if params.tracker.position_m is None:
        discs = tuple(PredictedObstacle(*disc) for o in seen.items for disc in o.discs())
        return Tracks(obstacles=seen._replace(items=discs))
    if known.obstacles is not None and seen == known.message:
        return known
    stamp_ns = seen.stamp_ns
    dt = ns_to_s(stamp_ns - known.message.stamp_ns) if known.message else 0.0
    tracks = obstacle_tracks.update(known.by_id, seen.items, dt, params.tracker)
    predicted = _predict(tracks, scene._replace(obstacles=seen), true_state, params)
    last = {k: s for k, s in known.seen.items() if k in tracks}
    last |= {k: Seen(stamp_ns, discs) for k, discs in predicted.items()}
    items = [
        disc.moved(age) if (age := ns_to_s(stamp_ns - s.stamp_ns)) else disc
        for s in last.values()
        for disc in s.predicted
    ]
    return Tracks(tracks, last, seen, seen._replace(items=tuple(items)))


def scene_at(known: Tracks, scene: Scene, stamp_ns: int) -> Scene:
    """Return the scene with the known obstacles, moved to an instant as they are predicted to."""
    if known.obstacles is None:
        return scene._replace(obstacles=None)
    t, items = ns_to_s(stamp_ns - known.obstacles.stamp_ns), known.obstacles.items
    items = tuple(o.moved(t) for o in items) if t else items
    return scene._replace(obstacles=Obstacles(stamp_ns, items))


def _predict(
    tracks: Mapping[int, Track], scene: Scene, car: VehicleState, params: ControllerParams
) -> dict[int, tuple[PredictedObstacle, ...]]:
    """Return the discs of every likely hypothesis of the obstacles of the scene, by id."""
    (stamp_ns, items, _), step_s = scene.obstacles, params.model.step_s
    reach_s = params.model.horizon * step_s + BEYOND_S
    t = step_s * np.arange(math.ceil(reach_s / step_s) + 1)
    road = _Road(items, tracks, scene, car, reach_s, params)
    predicted: dict[int, tuple[PredictedObstacle, ...]] = {}
    for o in items:
        track = tracks[o.id]
        given = [b for b in scene.predictions.get(o.id, ()) if _is_fresh(b, stamp_ns)]
        own = 1.0 - sum(branch.probability for branch in given)
        hypotheses = [(branch.probability, branch) for branch in given]
        if own > params.tracker.contact or not given:
            follower = road.followers.get(o.id)
            hypotheses += [(own * h.probability, h) for h in _hypotheses(track, follower)]
        hypotheses.sort(key=lambda pair: -pair[0])
        discs: list[PredictedObstacle] = []
        for probability, how in hypotheses:
            if discs and probability <= params.tracker.contact:
                break
            likely = min(params.tracker.contact / probability, MOST_UNLIKELY)
            quantile = NormalDist().inv_cdf(1.0 - likely)
            if isinstance(how, Hypothesis):
                lines, sd = _expected(o, track, how, t, road)
            else:
                lines, sd = _given(o, track, how, t, stamp_ns)
            for X, Y in lines:
                vX, vY = (float(axis[1] - axis[0]) / step_s for axis in (X, Y))
                course = Course(step_s, X, Y, quantile * sd)
                disc = o.id, float(X[0]), float(Y[0]), o.r_obs, vX, vY, (), course, 0.0, probability
                discs.append(PredictedObstacle(*disc))
        predicted[o.id] = tuple(discs)
    return predicted


class OnRoad(NamedTuple):
    """An obstacle that moves along the road or against it."""

    way: float  # 1 along it, -1 against it
    angle: float  # rad, to it
    kappa: float  # 1/m, of its line, left of the obstacle positive
    s: np.ndarray  # (k,) m, stations of its discs
    offset: np.ndarray  # (k,) m, of its discs, left of the centre of the road


class _Road:
    """The centre of the road beside the obstacles of a message, and those that follow it, by id."""

    def __init__(self, items, tracks, scene, car, reach_s, params):
        self.followers: dict[int, OnRoad] = {}
        most = params.surroundings.follow_road_rad
        if most is None or scene.path is None or scene.road is None or not items:
            return
        rows = []  # (obstacle, speed, course) of those near the car that show a direction
        for o in items:
            (X, Y), (vX, vY) = tracks[o.id].mean[:2]
            speed, apart = math.hypot(vX, vY), math.hypot(X - car.X, Y - car.Y)
            reach = (speed + abs(car.vx)) * reach_s + FAR_M
            if LEAST_COURSE_MPS <= speed < math.inf and apart < reach:
                rows.append((o, speed, math.atan2(vY, vX)))
        if not rows:
            return
        X, Y = np.array([(d.X, d.Y) for o, _, _ in rows for d in o.discs()]).T
        near = reference_path.project(scene.path, car.X, car.Y, None, 0.0)
        place = frenet_frame.to_frenet(scene.path, X, Y, near)
        margin = 1.5 * max(speed for _, speed, _ in rows) * reach_s
        station = np.arange(np.min(place.s) - margin, np.max(place.s) + margin + STEP_M, STEP_M)
        arcs, _ = reference_path.arcs_at(scene.path, station)
        window = params.surroundings.edge_window_m
        track = road_edges.track_beside(scene.road, arcs, window, aligned=True)
        self.station, centre = station, track.centre
        self.centre = centre.X, centre.Y, np.unwrap(centre.psi)
        first = 0
        for o, _, course in rows:
            discs = slice(first, first + 1 + len(o.others))
            first = discs.stop
            s = place.s[discs]
            row = min(max(int(np.searchsorted(station, s[0])), 0), len(station) - 1)
            pose = self.at(s)
            offset = arc.contouring_error(pose, X[discs], Y[discs])
            turned = math.remainder(course - pose.psi[0], 2 * math.pi)
            way = 1.0 if abs(turned) <= math.pi / 2 else -1.0
            angle = turned if way > 0 else math.remainder(turned - math.pi, 2 * math.pi)
            kappa = float(track.centre.kappa[row])
            shrink = 1.0 - kappa * float(offset[0])  # 0 in the centre of a bend
            if abs(angle) <= most and abs(offset[0]) <= track.half_width[row] and shrink > 0.1:
                self.followers[o.id] = OnRoad(way, angle, way * kappa / shrink, s, offset)

    def at(self, s):
        """Return the poses of the centre at stations [m]."""
        return arc.Pose(*(np.interp(s, self.station, axis) for axis in self.centre))


def _hypotheses(track: Track, on_road: OnRoad | None) -> list[Hypothesis]:
    """Return how an obstacle may go on, with probabilities; None: it does not follow the road."""
    (_, v, a), P = track.mean, track.covariance
    speed = math.hypot(*v)
    if not 0.0 < speed < math.inf:
        return [Hypothesis(STILL if speed == 0.0 else STRAIGHT, 0.0, 0.0, 1.0)]
    a_t, a_n = (float(part) for part in _directions(v) @ a)
    a_t = min(max(a_t, -MAX_DECELERATION), 0.0)
    a_n = min(max(a_n, -MAX_LATERAL), MAX_LATERAL)
    var_v, var, sd = P[1, 1], P[2, 2], math.sqrt(P[2, 2])
    # the speed in the plane is that of noise, or any
    wide = var_v + MOVES_MPS**2
    still = STANDS / var_v * math.exp(-(speed**2) / (2 * var_v))
    moves = (1 - STANDS) / wide * math.exp(-(speed**2) / (2 * wide))
    stands = still / (still + moves)
    # it brakes with anything up to MAX_DECELERATION, or keeps its speed
    kept, share = var + KEEPS_MPS2**2, _normal((a_t + MAX_DECELERATION) / sd) - _normal(a_t / sd)
    brakes = BRAKES * share / MAX_DECELERATION
    brakes /= brakes + (1 - BRAKES) * _density(a_t, 0.0, kept)
    # kind -> weight, lateral acceleration that it claims
    wide = var + TURNS_MPS2**2
    off = 1 - FOLLOWS if on_road else 1.0
    on, turns = (1 - TURNS) * _density(a_n, 0.0, kept), TURNS * _density(a_n, 0.0, wide)
    turned, ended = a_n * TURNS_MPS2**2 / wide, ENDS * turns
    sides = {
        STRAIGHT: (off * (on + ended), ended / (on + ended) * turned),
        TURN: (off * (turns - ended), turned),
    }
    if on_road:
        lateral = speed**2 * on_road.kappa
        sides[LANE] = FOLLOWS * _density(a_n, lateral, kept), lateral
    whole = sum(weight for weight, _ in sides.values())
    hypotheses = [Hypothesis(STILL, 0.0, 0.0, stands)]
    for kind, (weight, lateral) in sides.items():
        share = (1 - stands) * weight / whole
        hypotheses += [
            Hypothesis(kind, 0.0, lateral, share * (1 - brakes)),
            Hypothesis(kind, -a_t, lateral, share * brakes),
        ]
    return hypotheses


def _directions(v: np.ndarray) -> np.ndarray:
    """Return the directions ahead and to the left (2, 2) of a velocity (2,)."""
    ahead = v / math.hypot(*v)
    return np.array([ahead, (-ahead[1], ahead[0])])


def _density(value: float, mean: float, variance: float) -> float:
    return math.exp(-((value - mean) ** 2) / (2 * variance)) / math.sqrt(2 * math.pi * variance)


def _expected(
    o: Obstacle, track: Track, how: Hypothesis, t: np.ndarray, road: _Road
) -> tuple[Sequence[Any], np.ndarray]:
    """Return X and Y of the discs of an obstacle at times [s] from now, and their deviation [m]."""
    P = track.covariance
    # position and velocity where the acceleration is the claimed one
    gain, claimed = P[:2, 2] / P[2, 2], np.zeros(2)
    if how.kind != STILL:
        claimed = np.array([-how.braking, how.lateral]) @ _directions(track.mean[1])
    here, v = track.mean[:2] + np.outer(gain, claimed - track.mean[2])
    P = P[:2, :2] - np.outer(gain, P[2, :2])
    places, speed = np.array([(0.0, 0.0), *o.others]) + here, math.hypot(*v)
    if how.kind == STILL or speed == 0.0:
        sd = np.full_like(t, math.sqrt(P[0, 0]))
        return [np.outer(place, np.ones_like(t)) for place in places], sd
    sd = np.sqrt(np.maximum(P[0, 0] + 2 * P[0, 1] * t + P[1, 1] * t**2, 0.0))
    driven = speed * t
    if how.braking:
        braked = np.minimum(t, speed / how.braking)
        driven = speed * braked - how.braking * braked**2 / 2
    if how.kind == LANE:
        return _along_road(places, driven, road.followers[o.id], road), sd
    if how.kind == STRAIGHT:
        moved = np.outer(v / speed, driven)
        return [place[:, None] + moved for place in places], sd
    # on the arc of a constant yaw rate; the body turns with it
    held = min(max(how.lateral, -HELD_MPS2), HELD_MPS2)
    turn = held / speed**2 * driven  # rad
    chord = driven * np.sinc(turn / (2 * np.pi))
    moved = _directions(v).T @ (chord * np.array([np.cos(turn / 2), np.sin(turn / 2)]))
    return [here[:, None] + moved + _turned(place - here, turn) for place in places], sd


def _turned(offset: np.ndarray, angle: np.ndarray) -> np.ndarray:
    """Return an offset (2,) turned by angles (n,) [rad], (2, n)."""
    x, y = offset
    cos, sin = np.cos(angle), np.sin(angle)
    return np.array([cos * x - sin * y, sin * x + cos * y])


def _along_road(places, driven, on_road, road):
    """Return X and Y of the discs of an obstacle that keeps its angle to the road."""
    along = np.linspace(0.0, 1.5 * driven[-1] + STEP_M, POINTS)
    lane = road.at(on_road.s[:, None] + on_road.way * along)
    aside = on_road.offset[:, None] + on_road.way * math.tan(on_road.angle) * along
    X, Y, _ = frenet_frame.offset_left(lane, aside)
    distance = np.zeros_like(X)
    np.cumsum(np.hypot(np.diff(X), np.diff(Y)), axis=1, out=distance[:, 1:])
    # it begins where the disc is
    return [
        [np.interp(driven, d, axis - axis[0] + begin) for axis, begin in zip(line, place)]
        for place, d, *line in zip(places, distance, X, Y)
    ]


def _is_fresh(branch: Any, stamp_ns: int) -> bool:
    """Return whether a predicted path is recent, and goes on after a stamp."""
    age_s = ns_to_s(stamp_ns - branch.stamp_ns)
    return -LONGEST_AGE_S <= age_s <= min(LONGEST_AGE_S, branch.t[-1])


def _given(
    o: Obstacle, track: Track, branch: Any, t: np.ndarray, stamp_ns: int
) -> tuple[Sequence[Any], np.ndarray]:
    """Return the same along a predicted path of the first disc; the others turn with it.

    Before its first time the disc comes from where the track is; past its last one it goes on with
    its last velocity, about which it is as uncertain as the track.
    """
    at = branch.t - ns_to_s(stamp_ns - branch.stamp_ns)
    points = np.column_stack((branch.X, branch.Y))
    variance = np.linalg.eigvalsh(branch.covariance)[:, -1]
    if at[0] > 0.0:
        at, points = np.append(0.0, at), np.vstack((track.mean[0], points))
        variance = np.append(track.covariance[0, 0], variance)
    v = track.mean[1] if len(at) < 2 else (points[-1] - points[-2]) / (at[-1] - at[-2])
    X, Y = (np.interp(t, at, axis) for axis in points.T)
    beyond = np.maximum(t - at[-1], 0.0)
    line = np.array([X, Y]) + np.outer(v, beyond)
    sd = np.sqrt(np.interp(t, at, variance) + track.covariance[1, 1] * beyond**2)
    dX, dY = np.diff(line)
    moves = np.hypot(dX, dY) > 0
    turn = np.zeros_like(t)
    if o.others and np.any(moves):
        course = np.unwrap(np.arctan2(dY[moves], dX[moves]))
        turn[:-1] = np.interp(t[:-1], t[:-1][moves], course) - course[0]
        turn[-1] = turn[-2]
    return [line + _turned(np.array(offset), turn) for offset in ((0.0, 0.0), *o.others)], sd
