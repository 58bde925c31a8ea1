"""An independent evaluation of a run: brute-force plane geometry, no code of `bags.evaluation`.

Its input are the scenario file and the columns of the run; it evaluates every sample. Metres,
seconds, radians, frame map. Where rounding decides, the result is undecided (None).
"""

from typing import NamedTuple

import numpy as np

from scenario_publisher.scenario import Scenario

MESSAGE_NS = 50_000_000  # obstacles are published once per tick, and carried on in between
SPACING = 0.25  # m between the points that sample the outline
OUTLINE_EVERY = 10  # samples, for the outline against the edges
TOUCH = 0.02  # m, nearer to contact than this the result is undecided
CROSSED = 0.08  # m likewise for the outline beyond an edge, which is evaluated at points only
ANGLE = 0.1  # deg likewise for the sideslip angle
MOVING = 3.0  # m/s, at lower speeds the sideslip angle has no meaning
LOST_DEG, SPUN_DEG = 30.0, 90.0  # of sideslip
REACHED = 0.5  # m likewise for the finish line
CHUNK = 200  # points per evaluation


class Body(NamedTuple):
    """The vehicle as a rectangle around its centre of gravity, and as circles."""

    front: float  # m ahead of the centre of gravity
    rear: float  # m behind it
    width: float  # m
    radius: float  # m, of each circle
    circles: tuple[float, ...]  # m ahead of the centre of gravity


class Motion(NamedTuple):
    """The centre of gravity over n samples."""

    stamp_ns: np.ndarray
    X: np.ndarray
    Y: np.ndarray
    psi: np.ndarray
    vx: np.ndarray
    vy: np.ndarray


class Evaluation(NamedTuple):
    """The result; None where it is undecided, or the number does not exist."""

    v2o: dict[int, float | None]  # m, least distance of the circles to each obstacle
    v2e: dict[str, float]  # m, least distance of the circles to each edge
    outline: float | None  # m, least distance of the outline to any obstacle
    beyond: float  # m, how far the outline reached beyond an edge; negative inside
    sideslip: float | None  # deg, largest, without sign; None for a car that stands
    collided: bool | None
    left_road: bool | None
    lost: bool | None
    spun: bool | None
    completed: bool | None


def evaluate(scn: Scenario, motion: Motion, body: Body) -> Evaluation:
    """Return the evaluation of a run of a scenario."""
    begin_ns = int(motion.stamp_ns[0])
    circles, outline = {}, None
    for actor in (disc for whole in scn.actors for disc in whole.discs):
        present, x, y = _obstacle(actor, motion.stamp_ns - begin_ns)
        number, radius = actor.obstacle.id, actor.obstacle.r_obs
        circles.setdefault(number, None)
        if not present.any():
            continue
        while_present = Motion(*(column[present] for column in motion))
        gaps = [np.hypot(*(c - [x, y])) for c in _circles(while_present, body)]
        gap = float(np.min(gaps)) - radius - body.radius
        circles[number] = gap if circles[number] is None else min(gap, circles[number])
        gap = float(np.min(_to_rectangle(while_present, body, x, y))) - radius
        outline = gap if outline is None else min(gap, outline)
    edges = {
        side: min(
            float(np.min(sign * left_of(centre.T, line))) - body.radius
            for centre in _circles(motion, body)
        )
        for side, sign, line in _sides(scn)
    }
    beyond = _beyond(scn, motion, body)
    slip = _sideslip(motion)
    near = [gap for gap in (*circles.values(), outline) if gap is not None]
    return Evaluation(
        circles,
        edges,
        outline,
        beyond,
        slip,
        collided=_decide(min(near, default=np.inf), TOUCH),
        left_road=_decide(-beyond, CROSSED),
        lost=_decide(LOST_DEG - (slip or 0.0), ANGLE),
        spun=_decide(SPUN_DEG - (slip or 0.0), ANGLE),
        completed=_completed(scn, motion),
    )


def _decide(gap, band):
    return None if abs(gap) < band else bool(gap < 0.0)


def _sides(scn):
    """Return name, sign of the road's side in `left_of`, and points of each edge."""
    return ('left', -1.0, scn.edges.left), ('right', 1.0, scn.edges.right)


def _obstacle(actor, since_ns):
    """Return whether an obstacle is present at each sample, and its position where it is."""
    message_s = since_ns // MESSAGE_NS * MESSAGE_NS / 1e9
    present = (actor.appears <= message_s) & (message_s < actor.disappears)
    age = since_ns[present] / 1e9 - actor.appears
    o = actor.obstacle
    return present, o.X + o.vX * age, o.Y + o.vY * age


def _circles(motion, body):
    """Return the centre (2, n) of each circle."""
    direction = np.array([np.cos(motion.psi), np.sin(motion.psi)])
    return [np.array([motion.X, motion.Y]) + ahead * direction for ahead in body.circles]


def _corners(motion, body):
    """Return the corners (n, 4, 2) of the outline, counter-clockwise."""
    ahead = np.array([body.front, body.front, -body.rear, -body.rear])
    left = np.array([-0.5, 0.5, 0.5, -0.5]) * body.width
    c, s = np.cos(motion.psi)[:, None], np.sin(motion.psi)[:, None]
    X = motion.X[:, None] + c * ahead - s * left
    Y = motion.Y[:, None] + s * ahead + c * left
    return np.stack([X, Y], axis=-1)


def _to_rectangle(motion, body, x, y):
    """Return the distance (n,) of a point per sample to the outline, negative inside."""
    corner = _corners(motion, body)
    point = np.stack([x, y], axis=-1)
    gaps, insides = [], []
    for k in range(4):
        tail, tip = corner[:, k], corner[:, (k + 1) % 4]
        along, relative = tip - tail, point - tail
        share = np.clip(_dot(relative, along) / _dot(along, along), 0.0, 1.0)
        gaps.append(np.hypot(*(relative - share[:, None] * along).T))
        insides.append(along[:, 0] * relative[:, 1] - along[:, 1] * relative[:, 0] > 0.0)
    nearest = np.min(gaps, axis=0)
    return np.where(np.all(insides, axis=0), -nearest, nearest)


def _dot(a, b):
    return np.sum(a * b, axis=-1)


def left_of(points: np.ndarray, line: np.ndarray, endless: bool = False) -> np.ndarray:
    """Return how far (m,) points (m, 2) lie to the left of a polyline (n, 2); right is negative.

    The nearest point of the whole line counts. The normal there decides the side, at a corner the
    mean of the normals of both segments. An `endless` line continues straight at both ends.
    """
    tail, along = line[:-1], np.diff(line, axis=0)
    length = np.hypot(*along.T)
    normal = np.column_stack([-along[:, 1], along[:, 0]]) / length[:, None]
    corner = np.vstack([normal[:1], normal[:-1] + normal[1:], normal[-1:]])
    distances = []
    for begin in range(0, len(points), CHUNK):
        some = points[begin : begin + CHUNK]
        # segments that can be nearest to one of them: not farther than the nearest vertex
        middle = some.mean(axis=0)
        spread = np.hypot(*(some - middle).T).max()
        vertex = np.hypot(*(line - middle).T)
        reach = vertex.min() + 2.0 * spread + 1e-6
        near = np.flatnonzero(np.minimum(vertex[:-1], vertex[1:]) - length <= reach)
        relative = some[:, None, :] - tail[near]
        share = np.sum(relative * along[near], axis=2) / length[near] ** 2
        share = np.clip(share, 0.0, 1.0)
        from_foot = relative - share[..., None] * along[near]
        gap = np.hypot(from_foot[..., 0], from_foot[..., 1])
        row, best = np.arange(len(some)), np.argmin(gap, axis=1)
        k, q = near[best], share[row, best]
        where = np.where(q[:, None] <= 0.0, corner[k], normal[k])
        where = np.where(q[:, None] >= 1.0, corner[k + 1], where)
        side = _dot(from_foot[row, best], where)
        away = gap[row, best]
        if endless:
            ends = (k == 0) & (q <= 0.0) | (k == len(tail) - 1) & (q >= 1.0)
            away = np.where(ends, np.abs(side), away)
        distances.append(np.copysign(away, side))
    return np.concatenate(distances)


def _sideslip(motion):
    """Return the largest angle [deg] between heading and motion."""
    speed = np.hypot(motion.vx, motion.vy)
    moving = speed > MOVING
    if not moving.any():
        return None
    return float(np.degrees(np.arccos(np.clip(motion.vx[moving] / speed[moving], -1.0, 1.0)).max()))


def _beyond(scn, motion, body):
    """Return how far the outline reached beyond an edge at most."""
    some = np.union1d(np.arange(0, len(motion.X), OUTLINE_EVERY), len(motion.X) - 1)
    corner = _corners(Motion(*(column[some] for column in motion)), body)
    sides = []
    for k in range(4):
        tail, tip = corner[:, k, None], corner[:, (k + 1) % 4, None]
        count = int(np.ceil(np.hypot(*(tip - tail)[0, 0]) / SPACING))
        share = np.arange(count)[:, None] / count
        sides.append(tail + share * (tip - tail))
    outline = np.concatenate(sides, axis=1).reshape(-1, 2)
    return max(-float(np.min(sign * left_of(outline, line, True))) for _, sign, line in _sides(scn))


def _completed(scn, motion):
    """Return whether the centre crossed the finish line on the road; None where undecided.

    On a road that passes the finish line several times only those crossings count that come
    after the least distance to be travelled.
    """
    stop = scn.stop
    direction = np.array([np.cos(stop.psi), np.sin(stop.psi)])
    relative = np.column_stack([motion.X - stop.X, motion.Y - stop.Y])
    ahead = relative @ direction
    aside = relative @ [-direction[1], direction[0]]
    steps = np.hypot(np.diff(motion.X), np.diff(motion.Y))
    travelled = np.concatenate([[0.0], np.cumsum(steps)])
    finish = np.array([[stop.X, stop.Y]])
    left = abs(float(left_of(finish, scn.edges.left)[0]))
    right = abs(float(left_of(finish, scn.edges.right)[0]))
    on_road = (aside < left - TOUCH) & (aside > TOUCH - right)
    sides = (ahead[:-1] < 0.0) & (ahead[1:] >= 0.0)
    late = travelled[1:] > stop.armed_after + REACHED
    if np.any(sides & on_road[1:] & late):
        return True
    if not np.any((ahead[:-1] < REACHED) & (ahead[1:] >= -REACHED)):
        return False  # never near the line or beyond it, from behind
    if np.any((np.abs(ahead) < REACHED) & on_road & (travelled > stop.armed_after)):
        return None  # so near the line that the method of measuring decides
    if np.ptp(scn.reference.psi) > 1.9 * np.pi:
        return None  # laps: a point has several distances along them
    path = np.column_stack([scn.reference.X, scn.reference.Y])
    goal = _length_to(path, finish[0])
    points = np.column_stack([motion.X, motion.Y])[::OUTLINE_EVERY]
    reached = max(_length_to(path, point) for point in points)
    return False if reached < goal - REACHED else None


def _length_to(path, point):
    """Return the distance along a polyline at which it is nearest to a point."""
    along = np.diff(path, axis=0)
    length = np.hypot(*along.T)
    share = np.clip(_dot(point - path[:-1], along) / length**2, 0.0, 1.0)
    gap = np.hypot(*(point - path[:-1] - share[:, None] * along).T)
    k = int(np.argmin(gap))
    return float(np.sum(length[:k]) + share[k] * length[k])
