"""The road ahead: its dangerous obstacles, the ways around them, and how a plan passes them.

SI units. Sides are those of the car: LEFT passes left of the obstacle. Two plans that pass an
obstacle that may move on different sides cannot be deformed into each other: they are of different
homotopy classes (Bhattacharya, Likhachev & Kumar 2012), and a solver finds only that of its guess.
"""

import itertools
import math
from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np

from mpcc_controller.model.single_track import Car, State
from mpcc_controller.parameters import ControllerParams
from mpcc_controller.path import arc, frenet_frame, reference_path, road_edges
from mpcc_controller.path.arc import Arc
from mpcc_controller.problem import obstacle_motion, stage_parameters
from mpcc_controller.problem.stage_parameters import Scene

LEFT, RIGHT, BEHIND = 1, -1, 0  # BEHIND: not passed within the horizon
OVERLAP_M = 0.1
LEAST_CONTACT_MPS = 1e-3  # of a contact: 0 stands for none
WORDS = {LEFT: 'left', RIGHT: 'right', BEHIND: 'behind'}

MOST_SIDES = 3  # obstacles whose sides are combined, the first ones that the car meets
LEAST_TIME_S = 0.3  # to move aside: below it the guess would be no help
# peak acceleration of the quintic from rest to rest over a length d in the time T: d / T^2 times
QUINTIC_PEAK = 10 / math.sqrt(3)

Sides = dict[int, int]  # by the id of the obstacle


class Hazard(NamedTuple):
    """A dangerous obstacle beside the path, as a car that takes up the desired speed meets it."""

    id: int
    touch: float  # m, between the path of a circle of the car and a disc that it touches
    enter: float  # s, from then on it is beside the car
    leave: float  # s, until then
    lowest: float  # m, left of the path, the centres of its dangerous discs meanwhile
    highest: float  # m
    path_side: int  # on which the path passes it with room for the car, BEHIND if it does not


class RoadAhead(NamedTuple):
    """The path, its room and its hazards over the horizon: what all guesses of a tick share."""

    straight: np.ndarray  # (N + 1, 9) planned states along the path, towards its speed
    arcs: Arc  # of the path at these stages
    vx: np.ndarray  # (N + 1,) m/s there
    v_ref: np.ndarray  # (N + 1,) m/s, desired there
    right: np.ndarray  # (N + 1,) m left of the path: how far right the road allows the CoG
    left: np.ndarray  # (N + 1,) m, how far left
    hazards: tuple[Hazard, ...]  # in the order in which the car meets them
    rows: list[int]  # of their discs among the obstacles of the scene, in the same order


def road_ahead(
    scene: Scene, x0: State, lines: Iterable[np.ndarray], car: Car, params: ControllerParams
) -> RoadAhead | None:
    """Return the dangerous obstacles and what the guesses around them share; None without danger.

    An obstacle is dangerous where its distance along the path or along one of `lines`, planned
    states (N + 1, 9), is less than the safety distance and `candidates.danger_m`.
    """
    if not scene.obstacles.items:
        return None
    # of a car that takes up the desired speed from below
    t = params.model.step_s * np.arange(params.model.horizon + 1)
    _, v_here = reference_path.arcs_at(scene.path, np.array([x0.theta]))
    vx = np.minimum(x0.vx + params.limits.drive_n / car.m * t, max(float(v_here[0]), x0.vx))
    theta = x0.theta + travelled(vx, params.model.step_s)
    arcs, v_ref = reference_path.arcs_at(scene.path, theta)
    zeros = np.zeros_like(theta)
    fade = np.linspace(1, 0, len(theta)) * (arc.contouring_error(arcs, x0.X, x0.Y)[0])
    X, Y, _ = frenet_frame.offset_left(arcs, fade)
    straight = np.column_stack(State(X, Y, arcs.psi, vx, zeros, zeros, theta, zeros, zeros))
    limit = params.safety.obstacle_m + params.candidates.danger_m
    least = np.min([least_gaps(X, scene, params) for X in (straight, *lines)], axis=0)
    dangerous: dict[int, list[int]] = {}  # rows by id
    for row in np.flatnonzero(least < limit).tolist():
        dangerous.setdefault(scene.obstacles.items[row].id, []).append(row)
    if not dangerous:
        return None
    track = road_edges.track_beside(scene.road, arcs, params.surroundings.edge_window_m)
    centre = arc.contouring_error(arcs, track.centre.X, track.centre.Y)
    at_edges = params.body.edge_radius_m or params.body.circle_radius_m
    room = np.maximum(track.half_width - at_edges, 0)
    hazards = _hazards(dangerous, scene, arcs, params)
    rows = [row for hazard in hazards for row in dangerous[hazard.id]]
    return RoadAhead(straight, arcs, vx, v_ref, centre - room, centre + room, hazards, rows)


def lateral_motion(around: RoadAhead, x0: State) -> tuple[float, float]:
    """Return the offset [m] from the path at stage 0, to the left, and its rate [m/s]."""
    here = Arc(*(float(field[0]) for field in around.arcs))
    course = x0.psi - here.psi
    rate = x0.vx * math.sin(course) + x0.vy * math.cos(course)
    return float(arc.contouring_error(here, x0.X, x0.Y)), rate


def travelled(vx: np.ndarray, dt: float) -> np.ndarray:
    """Return the distances (N + 1,) [m] travelled at the speeds of the stages."""
    return np.concatenate(([0], np.cumsum((vx[1:] + vx[:-1]) / 2 * dt)))


def _hazards(dangerous, scene, arcs, params) -> tuple[Hazard, ...]:
    """Return where a car along the path, at the speeds of `arcs`, meets obstacles; by its order.

    `dangerous` are the rows of discs in the scene, by the id of their obstacle.
    """
    items, dt, stages = scene.obstacles.items, params.model.step_s, np.arange(len(arcs.X))
    rows = [row for discs in dangerous.values() for row in discs]
    oX, oY = obstacle_motion.stages(items, len(stages), dt)[:2, rows]
    lags, offsets = np.abs(arc.lag_error(arcs, oX, oY)), arc.contouring_error(arcs, oX, oY)
    touch = np.array([[items[row].r_obs] for row in rows]) + params.body.circle_radius_m
    nose = max(map(abs, params.body.circle_offsets_m))
    # the stretch around the stage that is beside it: it may come beside the car again on a lap
    closest = np.argmin(lags, axis=1)[:, None]
    near = np.maximum(touch + nose, np.min(lags, axis=1)[:, None] + 1e-9)
    apart = ~(lags < near)
    first = np.max(np.where(apart & (stages < closest), stages + 1, 0), axis=1)
    final = np.min(np.where(apart & (stages > closest), stages - 1, stages[-1]), axis=1)
    beside = (first[:, None] <= stages) & (stages <= final[:, None])
    lowest = np.min(np.where(beside, offsets, np.inf), axis=1).tolist()
    highest = np.max(np.where(beside, offsets, -np.inf), axis=1).tolist()
    enter, leave, touch = (dt * first).tolist(), (dt * final).tolist(), touch[:, 0].tolist()
    hazards, begin = [], 0
    for key, discs in dangerous.items():
        own = slice(begin, begin := begin + len(discs))
        low, high, near = min(lowest[own]), max(highest[own]), touch[own.start]
        side = LEFT if high < -near else RIGHT if low > near else BEHIND
        hazards.append(Hazard(key, near, min(enter[own]), max(leave[own]), low, high, side))
    return tuple(sorted(hazards, key=lambda hazard: hazard.enter))


class Slot(NamedTuple):
    """The offsets from the path between which the car passes one hazard."""

    enter: float  # s
    leave: float  # s
    low: float  # m, left of the path
    high: float  # m
    offset: float  # m, that is taken
    least_cost: float  # of the contouring error meanwhile


class Profile(NamedTuple):
    """Lateral offsets from the path that a guess takes: each is held over its slot."""

    slots: tuple[Slot, ...]
    acceleration: float  # m/s^2, the largest lateral one of the way there
    least_cost: float  # of the contouring error that no such plan avoids


def side_combinations(
    around: RoadAhead, x0: State, params: ControllerParams
) -> list[tuple[Sides, Profile]]:
    """Return the ways around the hazards, those that take the least acceleration first.

    Where no car fits between obstacles or beside the road there is no way; obstacles beyond the
    first MOST_SIDES are left to the solver.
    """
    hazards, ways = around.hazards[:MOST_SIDES], []
    start, beside = lateral_motion(around, x0), (LEFT, RIGHT)
    choices = [[(s, _slot_beside(around, h, s, params)) for s in beside] for h in hazards]
    for chosen in itertools.product(*choices):
        slots: list[Slot] = []
        for _, slot in chosen:
            if slot is not None and slots and slot.enter < slots[-1].leave:
                slots[-1], slot = _overlap(slots[-1], slot)
            if slot is None:
                break
            slots.append(slot)
        else:
            acceleration, t, (e, rate) = 0.0, 0.0, start
            for slot in slots:
                T = max(slot.enter - t, LEAST_TIME_S)
                needed = QUINTIC_PEAK * abs(slot.offset - e - rate * T / 2) / T**2
                acceleration = max(acceleration, needed)
                t, e, rate = slot.leave, slot.offset, 0.0
            least_cost = max(slot.least_cost for slot in slots)
            shape = Profile(tuple(slots), acceleration, least_cost)
            ways.append(({h.id: side for h, (side, _) in zip(hazards, chosen)}, shape))
    return sorted(ways, key=lambda way: way[1].acceleration)


def _slot_beside(
    around: RoadAhead, hazard: Hazard, side: int, params: ControllerParams
) -> Slot | None:
    """Return where a car passes a hazard on one side; None where it does not fit."""
    dt, last = params.model.step_s, len(around.left) - 1
    first, final = round(hazard.enter / dt), min(round(hazard.leave / dt), last)
    right = float(np.max(around.right[first : final + 1]))
    left = float(np.min(around.left[first : final + 1]))
    touch = hazard.touch
    if side == LEFT:
        right = max(right, hazard.highest + touch)
        wished = hazard.highest + touch + params.safety.obstacle_m
        target = max(wished, 0.0)
    else:
        left = min(left, hazard.lowest - touch)
        wished = hazard.lowest - touch - params.safety.obstacle_m
        target = min(wished, 0.0)
    if right > left:
        return None
    needed = max(right, -left, 0.0)  # right <= e <= left
    stages = final - first + 1
    least_cost = stages * (needed / params.tolerances.contouring_m) ** 2
    offset = min(max(target, right), left)
    return Slot(hazard.enter, hazard.leave, right, left, offset, least_cost)


def _overlap(before: Slot, after: Slot) -> tuple[Slot, Slot | None]:
    """Return both slots where both hazards are beside the car at once; None without room."""
    low, high = max(after.low, before.low), min(after.high, before.high)
    if low > high:
        return before, None
    between = max((after.enter + before.leave) / 2, before.enter)
    before = before._replace(leave=between, offset=min(max(before.offset, low), high))
    after = after._replace(
        enter=between,
        leave=max(after.leave, between),
        low=low,
        high=high,
        offset=min(max(after.offset, low), high),
    )
    return before, after


def gaps(X: np.ndarray, scene: Scene, params: ControllerParams) -> np.ndarray:
    """Return V2O [m] to each obstacle at each of the planned states (N + 1, 9): (n, N + 1)."""
    return stage_parameters.closest_gaps(X, scene.obstacles.items, params)


def least_gaps(X: np.ndarray, scene: Scene, params: ControllerParams) -> np.ndarray:
    """Return the least V2O [m] to each obstacle (n,) along planned states (N + 1, 9)."""
    return np.min(gaps(X, scene, params), axis=-1)


def contact_speed(X: np.ndarray, scene: Scene, params: ControllerParams) -> float:
    """Return the relative speed [m/s] of the first contact of planned states (N + 1, 9).

    0 without one, and times the probability of the hypothesis. Circles that overlap by less than
    OVERLAP_M may be outlines that do not touch.
    """
    if not scene.obstacles.items:
        return 0.0
    touches = gaps(X, scene, params) < -OVERLAP_M
    if not np.any(touches):
        return 0.0
    stage = int(np.argmax(np.any(touches, axis=0)))
    x, obstacle = State(*X[stage]), scene.obstacles.items[int(np.argmax(touches[:, stage]))]
    vX, vY = obstacle.velocity(stage * params.model.step_s)
    vX = x.vx * math.cos(x.psi) - x.vy * math.sin(x.psi) - vX
    vY = x.vx * math.sin(x.psi) + x.vy * math.cos(x.psi) - vY
    return max(obstacle.probability * math.hypot(vX, vY), LEAST_CONTACT_MPS)


def passed_sides(
    X: np.ndarray, scene: Scene, rows: Sequence[int], params: ControllerParams
) -> Sides:
    """Return the side on which planned states (N + 1, 9) pass each obstacle, by its id.

    Of the obstacles of the scene those `rows`. It counts where the car is beside the obstacle along
    the path, both at the same time, and at the end of the horizon no more behind its centre.
    """
    if not len(rows):
        return {}
    x, items = State(*X.T), scene.obstacles.items
    arcs, _ = reference_path.arcs_at(scene.path, x.theta)
    oX, oY = obstacle_motion.stages(items, len(X), params.model.step_s)[:2, rows]
    cos_psi, sin_psi = np.cos(arcs.psi), np.sin(arcs.psi)
    dX, dY = oX - x.X, oY - x.Y
    ahead = cos_psi * dX + sin_psi * dY
    stages = np.argmin(np.abs(ahead), axis=1)
    at = np.arange(len(rows)), stages
    asides = (cos_psi[stages] * dY[at] - sin_psi[stages] * dX[at]).tolist()
    sides: Sides = {}
    for row, stage, gap, aside in zip(rows, stages.tolist(), ahead[at].tolist(), asides):
        obstacle = items[row]
        is_beside = abs(gap) < obstacle.r_obs + params.body.circle_radius_m
        # a plan that waits behind it and comes beside it at last has not passed it
        is_beside &= stage < len(X) - 1 or gap <= 0
        side = LEFT if aside < 0 else RIGHT
        # of several discs that one which is passed, of the likeliest hypothesis
        sides[obstacle.id] = sides.get(obstacle.id, BEHIND) or (side if is_beside else BEHIND)
    return sides


def name_of(sides: Sides) -> str:
    """Return the sides as words: `left of 1, right of 4`."""
    return ', '.join(f'{WORDS[side]} of {key}' for key, side in sides.items())


def are_opposed(sides: Sides, other: Sides) -> bool:
    """Return whether some obstacle is passed on the left by one and on the right by the other."""
    return any(sides.get(key, BEHIND) * side < 0 for key, side in other.items())


def is_same_way(sides: Sides, other: Sides) -> bool:
    """Return whether every obstacle is passed on the same side, or by neither."""
    keys = sides.keys() | other.keys()
    return all(sides.get(key, BEHIND) == other.get(key, BEHIND) for key in keys)
