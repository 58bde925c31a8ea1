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
from itertools import islice
from statistics import NormalDist
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np

from mpcc_controller.driving import obstacle_tracks
from mpcc_controller.driving.measurement_errors import measured_obstacles
from mpcc_controller.driving.obstacle_tracks import Track
from mpcc_controller.parameters import ControllerParams
from mpcc_controller.path import arc, frenet_frame, reference_path, road_edges
from mpcc_controller.path.compiled_queries import interpolate
from mpcc_controller.problem.obstacle_motion import Course, PredictedObstacle, moved
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
_normal, _quantile = NormalDist().cdf, NormalDist().inv_cdf
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


class Likely(NamedTuple):
    """An obstacle as it likely goes on."""

    obstacle: Obstacle
    track: Track
    how: Any  # a Hypothesis, or a Branch from outside
    probability: float
    quantile: float  # deviations of its position by which its discs grow


def observe(
    known: Tracks, scene: Scene, received: VehicleState, seen_ns: int, params: ControllerParams
) -> Tracks:
    """Return what is known after the obstacles of the scene were seen at an instant.

    The errors with which they are seen depend on that instant and on the true state of the car. The
    controller shows the obstacles of every tick since its (re)start, and no others: then a node,
    the ring in process and a replay predict the same bits, whatever was received between.
    """
    if scene.obstacles is None:
        return known._replace(obstacles=None)
    seen = measured_obstacles(scene.obstacles, received, seen_ns, params.measurement_errors)
    if params.tracker.position_m is None:
        discs = tuple(PredictedObstacle(*disc) for o in seen.items for disc in o.discs())
        return Tracks(obstacles=seen._replace(items=discs))
    if known.obstacles is not None and seen == known.message:
        return known
    stamp_ns = seen.stamp_ns
    dt = ns_to_s(stamp_ns - known.message.stamp_ns) if known.message else 0.0
    tracks = obstacle_tracks.update(known.by_id, seen.items, dt, params.tracker)
    predicted = _predict(tracks, scene._replace(obstacles=seen), received, params)
    last = {k: s for k, s in known.seen.items() if k in tracks}
    last |= {k: Seen(stamp_ns, discs) for k, discs in predicted.items()}
    items: list[PredictedObstacle] = []
    for s in last.values():
        age = ns_to_s(stamp_ns - s.stamp_ns)
        items += moved(s.predicted, age) if age else s.predicted
    return Tracks(tracks, last, seen, seen._replace(items=tuple(items)))


def scene_at(known: Tracks, scene: Scene, stamp_ns: int) -> Scene:
    """Return the scene with the known obstacles, moved to an instant as they are predicted to."""
    if known.obstacles is None:
        return scene._replace(obstacles=None)
    t, items = ns_to_s(stamp_ns - known.obstacles.stamp_ns), known.obstacles.items
    return scene._replace(obstacles=Obstacles(stamp_ns, moved(items, t) if t else items))


def _predict(
    tracks: Mapping[int, Track], scene: Scene, car: VehicleState, params: ControllerParams
) -> dict[int, tuple[PredictedObstacle, ...]]:
    """Return the discs of every likely hypothesis of the obstacles of the scene, by id."""
    (stamp_ns, items, _), step_s = scene.obstacles, params.model.step_s
    reach_s, contact = params.model.horizon * step_s + BEYOND_S, params.tracker.contact
    t = step_s * np.arange(math.ceil(reach_s / step_s) + 1)
    road = _Road(items, tracks, scene, car, reach_s, params)
    means = np.array([tracks[o.id].mean for o in items]).reshape(-1, 3, 2)
    accelerations = (_directions(means[:, 1]) @ means[:, 2, :, None])[:, :, 0].tolist()
    likely: list[Likely] = []
    for o, acceleration in zip(items, accelerations):
        track = tracks[o.id]
        given = [b for b in scene.predictions.get(o.id, ()) if _is_fresh(b, stamp_ns)]
        own = 1.0 - sum(branch.probability for branch in given)
        pairs: list[tuple[float, Any]] = [(branch.probability, branch) for branch in given]
        if own > contact or not given:
            follower = road.followers.get(o.id)
            pairs += [(own * h.probability, h) for h in _hypotheses(track, acceleration, follower)]
        pairs.sort(key=lambda pair: -pair[0])
        for probability, how in [pair for pair in pairs if pair[0] > contact] or pairs[:1]:
            quantile = _quantile(1.0 - min(contact / probability, MOST_UNLIKELY))
            likely.append(Likely(o, track, how, probability, quantile))
    predicted: dict[int, list[PredictedObstacle]] = {o.id: [] for o in items}
    expected = _expected([a for a in likely if isinstance(a.how, Hypothesis)], t, road)
    rows = iter(range(expected.shape[1]))
    for a in likely:
        o, count = a.obstacle, 1 + len(a.obstacle.others)
        if isinstance(a.how, Hypothesis):
            courses = [Course(step_s, expected, row) for row in islice(rows, count)]
        else:
            given = _given(a, t, stamp_ns)
            courses = [Course(step_s, given, row) for row in range(count)]
        for course in courses:
            (X, X_next), (Y, Y_next) = course.table[:2, course.row, :2].tolist()
            velocity = (X_next - X) / step_s, (Y_next - Y) / step_s
            disc = o.id, X, Y, o.r_obs, *velocity, (), course, 0.0, a.probability
            predicted[o.id].append(PredictedObstacle(*disc))
    return {key: tuple(discs) for key, discs in predicted.items()}


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
            (X, Y), (vX, vY), _ = tracks[o.id].mean.tolist()
            speed, apart = math.hypot(vX, vY), math.hypot(X - car.X, Y - car.Y)
            reach = (speed + abs(car.vx)) * reach_s + FAR_M
            if LEAST_COURSE_MPS <= speed < math.inf and apart < reach:
                rows.append((o, speed, math.atan2(vY, vX)))
        if not rows:
            return
        discs = [(o.X + x, o.Y + y) for o, _, _ in rows for x, y in ((0.0, 0.0), *o.others)]
        X, Y = np.array(discs).T
        near = reference_path.project(scene.path, car.X, car.Y, None, 0.0)
        place = frenet_frame.to_frenet(scene.path, X, Y, near)
        margin = 1.5 * max(speed for _, speed, _ in rows) * reach_s
        station = np.arange(np.min(place.s) - margin, np.max(place.s) + margin + STEP_M, STEP_M)
        arcs, _ = reference_path.arcs_at(scene.path, station)
        window = params.surroundings.edge_window_m
        track = road_edges.track_beside(scene.road, arcs, window, aligned=True)
        self.station, centre = station, track.centre
        self.centre = centre.X, centre.Y, np.unwrap(centre.psi)
        pose = self.at(place.s)
        offset = arc.contouring_error(pose, X, Y)
        numbers = np.clip(np.searchsorted(station, place.s), 0, len(station) - 1)
        beside = (pose.psi, offset, centre.kappa[numbers], track.half_width[numbers])
        beside, first = np.transpose(beside).tolist(), 0
        for o, _, course in rows:
            psi, e, kappa, half_width = beside[first]
            discs = slice(first, first := first + 1 + len(o.others))
            turned = math.remainder(course - psi, 2 * math.pi)
            way = 1.0 if abs(turned) <= math.pi / 2 else -1.0
            angle = turned if way > 0 else math.remainder(turned - math.pi, 2 * math.pi)
            shrink = 1.0 - kappa * e  # 0 in the centre of a bend
            if abs(angle) <= most and abs(e) <= half_width and shrink > 0.1:
                kappa = way * kappa / shrink
                self.followers[o.id] = OnRoad(way, angle, kappa, place.s[discs], offset[discs])

    def at(self, s):
        """Return the poses of the centre at stations [m]."""
        return arc.Pose(*(np.interp(s, self.station, axis) for axis in self.centre))


def _hypotheses(
    track: Track, acceleration: Sequence[float], on_road: OnRoad | None
) -> list[Hypothesis]:
    """Return how an obstacle may go on, with probabilities.

    acceleration: m/s^2, of the track, ahead and to the left
    on_road: None: it does not follow the road
    """
    speed, P = math.hypot(*track.mean[1].tolist()), track.covariance
    if not 0.0 < speed < math.inf:
        return [Hypothesis(STILL if speed == 0.0 else STRAIGHT, 0.0, 0.0, 1.0)]
    a_t, a_n = acceleration
    a_t = min(max(a_t, -MAX_DECELERATION), 0.0)
    a_n = min(max(a_n, -MAX_LATERAL), MAX_LATERAL)
    var_v, var = float(P[1, 1]), float(P[2, 2])
    sd = math.sqrt(var)
    # the speed in the plane is that of noise, or any
    wide = var_v + MOVES_MPS**2
    still = STANDS / var_v * math.exp(-(speed**2) / (2 * var_v))
    moves = (1 - STANDS) / wide * math.exp(-(speed**2) / (2 * wide))
    stands = still / (still + moves) if moves else 0.0
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
    """Return the directions ahead and to the left (k, 2, 2) of velocities (k, 2), 0 of none."""
    speed = np.array([math.hypot(*w) or 1.0 for w in v.tolist()])
    ahead = v / speed[:, None]
    return np.stack((ahead, ahead[:, ::-1] * (-1.0, 1.0)), axis=1)


def _density(value: float, mean: float, variance: float) -> float:
    return math.exp(-((value - mean) ** 2) / (2 * variance)) / math.sqrt(2 * math.pi * variance)


def _expected(likely: Sequence[Likely], t: np.ndarray, road: _Road) -> np.ndarray:
    """Return the table (see `Course`) of the discs of hypotheses at times [s] from now."""
    if not likely:
        return np.empty((3, 0, len(t)))
    means = np.array([a.track.mean for a in likely])
    P = np.array([a.track.covariance for a in likely])
    kind, braking, lateral, _ = np.array([a.how for a in likely]).T
    # position and velocity where the acceleration is the claimed one
    claimed = np.column_stack((-braking, lateral))[:, None] @ _directions(means[:, 1])
    claimed[kind == STILL] = 0.0
    gain = P[:, :2, 2:] / P[:, 2:, 2:]
    here, v = (means[:, :2] + gain * (claimed - means[:, 2:])).transpose(1, 0, 2)
    P = P[:, :2, :2] - gain * P[:, 2:, :2]
    speed = np.array([math.hypot(*w) for w in v.tolist()])
    moves = (kind != STILL) & (speed != 0.0)
    stop = [s / b if b else math.inf for s, b in zip(speed.tolist(), braking.tolist())]
    speed, braked = speed[:, None], np.minimum(t, np.array(stop)[:, None])
    driven = np.where(moves[:, None], speed * braked - braking[:, None] * braked**2 / 2, 0.0)
    own, cross, rate = P[:, 0, 0, None], P[:, 0, 1, None], P[:, 1, 1, None]
    variance = np.where(moves[:, None], np.maximum(own + 2 * cross * t + rate * t**2, 0.0), own)
    # the discs, first all straight on
    parents = np.repeat(np.arange(len(likely)), [1 + len(a.obstacle.others) for a in likely])
    apart = np.array([each for a in likely for each in ((0.0, 0.0), *a.obstacle.others)])
    places, table = apart + here[parents], np.empty((3, len(parents), len(t)))
    lines = table[:2].transpose(1, 0, 2)
    course = v / np.where(speed == 0.0, 1.0, speed)
    lines[:] = places[:, :, None] + (course[:, :, None] * driven[:, None])[parents]
    table[2] = (np.array([[a.quantile] for a in likely]) * np.sqrt(variance))[parents]
    follows = moves & (kind == LANE)
    if np.any(follows):
        on_road = [road.followers[likely[k].obstacle.id] for k in np.flatnonzero(follows)]
        rows = np.flatnonzero(follows[parents])
        lines[rows] = _along_road(places[rows], driven[parents[rows]], on_road, road)
    for k in np.flatnonzero(moves & (kind == TURN)).tolist():
        # on the arc of a constant yaw rate; the body turns with it
        held = min(max(likely[k].how.lateral, -HELD_MPS2), HELD_MPS2)
        turn = held / float(speed[k, 0]) ** 2 * driven[k]  # rad
        chord = driven[k] * np.sinc(turn / (2 * np.pi))
        ahead = chord * np.array([np.cos(turn / 2), np.sin(turn / 2)])
        line = here[k][:, None] + _directions(v[[k]])[0].T @ ahead
        for row in np.flatnonzero(parents == k):
            lines[row] = line + _turned(places[row] - here[k], turn)
    return table


def _turned(offset: np.ndarray, angle: np.ndarray) -> np.ndarray:
    """Return an offset (2,) turned by angles (n,) [rad], (2, n)."""
    x, y = offset
    cos, sin = np.cos(angle), np.sin(angle)
    return np.array([cos * x - sin * y, sin * x + cos * y])


def _along_road(
    places: np.ndarray, driven: np.ndarray, on_road: Sequence[OnRoad], road: _Road
) -> np.ndarray:
    """Return X and Y (k, 2, n) of the discs of obstacles that keep their angles to the road.

    places: (k, 2) m, where the discs are
    driven: (k, n) m, how far then
    """
    ways = [(o.way, o.way * math.tan(o.angle)) for o in on_road for _ in o.s]
    way, slope = np.array(ways).T[:, :, None]
    s, offset = (np.concatenate(each)[:, None] for each in zip(*((o.s, o.offset) for o in on_road)))
    along = np.linspace(0.0, 1.5 * driven[:, -1] + STEP_M, POINTS, axis=1)
    X, Y, _ = frenet_frame.offset_left(road.at(s + way * along), offset + slope * along)
    distance = np.zeros(X.shape)
    np.cumsum(np.hypot(np.diff(X), np.diff(Y)), axis=1, out=distance[:, 1:])
    # it begins where the disc is
    begun = (a - a[:, :1] + place[:, None] for a, place in zip((X, Y), places.T))
    return np.stack([interpolate(driven, distance, a) for a in begun], axis=1)


def _is_fresh(branch: Any, stamp_ns: int) -> bool:
    """Return whether a predicted path is recent, and goes on after a stamp."""
    age_s = ns_to_s(stamp_ns - branch.stamp_ns)
    return -LONGEST_AGE_S <= age_s <= min(LONGEST_AGE_S, branch.t[-1])


def _given(likely: Likely, t: np.ndarray, stamp_ns: int) -> np.ndarray:
    """Return the same along a predicted path of the first disc; the others turn with it.

    Before its first time the disc comes from where the track is; past its last one it goes on with
    its last velocity, about which it is as uncertain as the track.
    """
    o, track, branch, _, quantile = likely
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
    lines = [line + _turned(np.array(offset), turn) for offset in ((0.0, 0.0), *o.others)]
    return np.array([[X, Y, quantile * sd] for X, Y in lines]).transpose(1, 0, 2)
