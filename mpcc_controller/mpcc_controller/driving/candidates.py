"""Initial guesses of a tick: one per way around dangerous obstacles, and one that brakes. SI units.

Sides are those of the car: LEFT passes left of the obstacle. Two plans that pass an obstacle that
may move on different sides cannot be deformed into each other: they are of different homotopy
classes (Bhattacharya, Likhachev & Kumar 2012), and a solver finds only that of its guess.
"""

import itertools
import math
from collections.abc import Iterable, Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from mpcc_controller.driving import initial_guess
from mpcc_controller.model.single_track import GRAVITY, Car, Input, State, ideal_split
from mpcc_controller.parameters import ControllerParams
from mpcc_controller.path import arc, reference_path, road_edges
from mpcc_controller.path.arc import Arc
from mpcc_controller.problem.obstacle_motion import position, velocity
from mpcc_controller.problem.stage_parameters import Scene
from msgs_yaml.types import Obstacle
from stage_solver.stage_problem import Plan

LEFT, RIGHT, BEHIND = 1, -1, 0  # BEHIND: not passed within the horizon
FOLLOWED, BRAKE = 'followed', 'brake'
MOST_SIDES = 3  # obstacles whose sides are combined, the first ones that the car meets
LEAST_TIME_S = 0.3  # to move aside: below it the guess would be no help
OVERLAP_M = 0.1
LEAST_CONTACT_MPS = 1e-3  # of a contact: 0 stands for none
SLOW = 1.0  # m/s; slower, a steady cornering guess has no meaning
RETURN_TIME_S = 1.0  # at least, from an obstacle back to the path
# peak acceleration of the quintic from rest to rest over a length d in the time T: d / T^2 times
QUINTIC_PEAK = 10 / math.sqrt(3)
THETA = State._fields.index('theta')
WORDS = {LEFT: 'left', RIGHT: 'right', BEHIND: 'behind'}

Sides = dict[int, int]  # by the id of the obstacle


class Candidate(NamedTuple):
    """An initial guess, and which way around the obstacles it goes."""

    name: str  # BRAKE, or the sides
    guess: Plan  # in the map


class Hazard(NamedTuple):
    """A dangerous obstacle beside the path, as a car that takes up the desired speed meets it."""

    obstacle: Obstacle
    enter: float  # s, from then on it is beside the car
    leave: float  # s, until then
    lowest: float  # m, left of the path, its centre meanwhile
    highest: float  # m
    path_side: int  # on which the path passes it with room for the car, BEHIND if it does not


class Profile(NamedTuple):
    """Lateral offsets from the path that a guess takes: held from `enter` to `leave`."""

    enter: list[float]  # s
    leave: list[float]  # s
    offset: list[float]  # m, left of the path
    acceleration: float  # m/s^2, the largest lateral one of the way there
    least_cost: float  # of the contouring error that no such plan avoids


class RoadAhead(NamedTuple):
    """The path, its room and its hazards over the horizon: what all guesses of a tick share."""

    straight: np.ndarray  # (N + 1, 9) planned states along the path, towards its speed
    arcs: Arc  # of the path at these stages
    vx: np.ndarray  # (N + 1,) m/s there
    v_ref: np.ndarray  # (N + 1,) m/s, desired there
    right: np.ndarray  # (N + 1,) m left of the path: how far right the road allows the CoG
    left: np.ndarray  # (N + 1,) m, how far left
    hazards: tuple[Hazard, ...]  # in the order in which the car meets them


def road_ahead(
    scene: Scene, x0: State, lines: Iterable[np.ndarray], car: Car, params: ControllerParams
) -> RoadAhead | None:
    """Return the dangerous obstacles and what the guesses around them share; None without danger.

    An obstacle is dangerous where its distance along the path or along one of `lines`, planned
    states (N + 1, 9), is less than the safety distance and `candidates.danger_m`.
    """
    if not scene.obstacles.items:
        return None
    vx = _speeds(scene, x0, car, params)
    theta = x0.theta + _travelled(vx, params.model.step_s)
    arcs, v_ref = reference_path.arcs_at(scene.path, theta)
    zeros = np.zeros_like(theta)
    fade = np.linspace(1, 0, len(theta)) * (_left_of(arcs, x0.X, x0.Y)[0])
    X, Y = arcs.X - fade * np.sin(arcs.psi), arcs.Y + fade * np.cos(arcs.psi)
    straight = np.column_stack(State(X, Y, arcs.psi, vx, zeros, zeros, theta, zeros, zeros))
    limit = params.safety.obstacle_m + params.candidates.danger_m
    gaps = np.min([least_gaps(X, scene, params) for X in (straight, *lines)], axis=0)
    dangerous = [o for o, gap in zip(scene.obstacles.items, gaps) if gap < limit]
    if not dangerous:
        return None
    track = road_edges.track_beside(scene.road, arcs, params.surroundings.edge_window_m)
    centre = _left_of(arcs, track.centre.X, track.centre.Y)
    at_edges = params.body.edge_radius_m or params.body.circle_radius_m
    room = np.maximum(track.half_width - at_edges, 0)
    hazards = sorted((_hazard(o, arcs, params) for o in dangerous), key=lambda h: h.enter)
    return RoadAhead(straight, arcs, vx, v_ref, centre - room, centre + room, tuple(hazards))


def least_gaps(X: np.ndarray, scene: Scene, params: ControllerParams) -> np.ndarray:
    """Return the least V2O [m] to each obstacle (n,) along planned states (N + 1, 9)."""
    return np.min(_gaps(X, scene, params), axis=-1)


def contact_speed(X: np.ndarray, scene: Scene, params: ControllerParams) -> float:
    """Return the relative speed [m/s] of the first contact of planned states (N + 1, 9).

    0 without one. Circles that overlap by less than OVERLAP_M may be outlines that do not touch.
    """
    if not scene.obstacles.items:
        return 0.0
    touches = _gaps(X, scene, params) < -OVERLAP_M
    if not np.any(touches):
        return 0.0
    stage = int(np.argmax(np.any(touches, axis=0)))
    x, obstacle = State(*X[stage]), scene.obstacles.items[int(np.argmax(touches[:, stage]))]
    vX, vY = velocity(obstacle, stage * params.model.step_s)
    vX = x.vx * math.cos(x.psi) - x.vy * math.sin(x.psi) - vX
    vY = x.vx * math.sin(x.psi) + x.vy * math.cos(x.psi) - vY
    return max(math.hypot(vX, vY), LEAST_CONTACT_MPS)


def _gaps(X, scene, params) -> np.ndarray:
    """Return V2O [m] to each obstacle at each stage (n, N + 1)."""
    x = State(*X.T)
    oX, oY = _positions(scene.obstacles.items, len(X), params.model.step_s)
    cos_psi, sin_psi = np.cos(x.psi), np.sin(x.psi)
    square = np.inf
    for offset in params.body.circle_offsets_m:
        dX, dY = oX - x.X - offset * cos_psi, oY - x.Y - offset * sin_psi
        square = np.minimum(square, dX**2 + dY**2)
    radii = np.array([o.r_obs for o in scene.obstacles.items]) + params.body.circle_radius_m
    return np.sqrt(square) - radii[:, None]


def passed_sides(
    X: np.ndarray, scene: Scene, obstacles: Sequence[Obstacle], params: ControllerParams
) -> Sides:
    """Return the side on which planned states (N + 1, 9) pass each obstacle, by its id.

    It counts where the car is beside the obstacle along the path, both at the same time, and at the
    end of the horizon no more behind its centre.
    """
    if not obstacles:
        return {}
    x = State(*X.T)
    arcs, _ = reference_path.arcs_at(scene.path, x.theta)
    oX, oY = _positions(tuple(obstacles), len(X), params.model.step_s)
    cos_psi, sin_psi = np.cos(arcs.psi), np.sin(arcs.psi)
    ahead = cos_psi * (oX - x.X) + sin_psi * (oY - x.Y)
    aside = cos_psi * (oY - x.Y) - sin_psi * (oX - x.X)
    stages = np.argmin(np.abs(ahead), axis=1)
    sides = {}
    for row, (obstacle, stage) in enumerate(zip(obstacles, stages)):
        gap = ahead[row, stage]
        is_beside = abs(gap) < obstacle.r_obs + params.body.circle_radius_m
        # a plan that waits behind it and comes beside it at last has not passed it
        is_beside &= stage < len(X) - 1 or gap <= 0
        side = LEFT if aside[row, stage] < 0 else RIGHT
        sides[obstacle.id] = side if is_beside else BEHIND
    return sides


def side_combinations(around: RoadAhead, x0: State, params: ControllerParams):
    """Return the ways around the hazards, those that take the least acceleration first.

    A list of (sides, profile). Where no car fits between obstacles or beside the road there is
    no way; obstacles beyond the first MOST_SIDES are left to the solver.
    """
    hazards = around.hazards[:MOST_SIDES]
    ways = []
    for chosen in itertools.product((LEFT, RIGHT), repeat=len(hazards)):
        shape = profile(around, hazards, chosen, x0, params)
        if shape is not None:
            ways.append(({h.obstacle.id: side for h, side in zip(hazards, chosen)}, shape))
    return sorted(ways, key=lambda way: way[1].acceleration)


def profile(
    around: RoadAhead,
    hazards: Sequence[Hazard],
    chosen: Sequence[int],
    x0: State,
    params: ControllerParams,
) -> Profile | None:
    """Return the offsets that pass `hazards` on the `chosen` sides; None where no car fits."""
    dt, last = params.model.step_s, len(around.left) - 1
    enter, leave, offset, low, high = [], [], [], [], []
    least_cost = 0.0
    for hazard, side in zip(hazards, chosen):
        first, final = round(hazard.enter / dt), min(round(hazard.leave / dt), last)
        right = float(np.max(around.right[first : final + 1]))
        left = float(np.min(around.left[first : final + 1]))
        touch = hazard.obstacle.r_obs + params.body.circle_radius_m
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
        least_cost = max(least_cost, stages * (needed / params.tolerances.contouring_m) ** 2)
        if enter and hazard.enter < leave[-1]:  # both are beside the car at once
            right, left = max(right, low[-1]), min(left, high[-1])
            if right > left:
                return None
            offset[-1] = min(max(offset[-1], right), left)
            target = min(max(target, right), left)
            between = max((hazard.enter + leave[-1]) / 2, enter[-1])
            leave[-1] = between
            hazard = hazard._replace(enter=between, leave=max(hazard.leave, between))
        enter.append(hazard.enter)
        leave.append(hazard.leave)
        offset.append(min(max(target, right), left))
        low.append(right)
        high.append(left)
    start, rate = _lateral_motion(around, x0)
    acceleration, t, e = 0.0, 0.0, start
    for begin, end, target in zip(enter, leave, offset):
        T = max(begin - t, LEAST_TIME_S)
        acceleration = max(acceleration, QUINTIC_PEAK * abs(target - e - rate * T / 2) / T**2)
        t, e, rate = end, target, 0.0
    return Profile(enter, leave, offset, acceleration, least_cost)


def guess_along(
    around: RoadAhead, shape: Profile, x0: State, car: Car, params: ControllerParams
) -> Plan:
    """Return the guess that takes the offsets of a profile on the way to the desired speed.

    Quintics lead from offset to offset and back to the path. Heading, yaw rate, sideslip and
    steering angle are those of steady cornering along the line, within the friction.
    """
    t = params.model.step_s * np.arange(len(around.left))
    start, rate = _lateral_motion(around, x0)
    e = np.full(len(t), start)
    time, here = 0.0, start
    knots = [*zip(shape.enter, shape.leave, shape.offset)]
    end = shape.leave[-1]
    back = math.sqrt(QUINTIC_PEAK * abs(shape.offset[-1]) / (0.4 * GRAVITY))
    knots.append((end + max(back, RETURN_TIME_S), math.inf, 0.0))
    for begin, leave, target in knots:
        T = max(begin - time, LEAST_TIME_S)
        later = t >= time
        e[later] = _quintic(np.minimum((t[later] - time) / T, 1.0), here, rate * T, target)
        time, here, rate = max(leave, time + T), target, 0.0
    arcs = around.arcs
    X = arcs.X - e * np.sin(arcs.psi)
    Y = arcs.Y + e * np.cos(arcs.psi)
    along = np.maximum(around.vx, SLOW) * (1 - arcs.kappa * e)
    course = arcs.psi + np.arctan2(np.gradient(e, t), along)
    return _steady_plan(X, Y, course, around.vx, arcs.theta, x0, car, params)


def braking_guess(
    line: np.ndarray, x0: State, car: Car, params: ControllerParams, floor: float | None = None
) -> Plan:
    """Return the guess that brakes along planned states `line` (N + 1, 9), at most to the floor.

    It brakes with the usable friction that the curvature of the line leaves. Below the floor
    [m/s], by default `limits.least_speed_mps`, the prediction holds no more.
    """
    t = params.model.step_s * np.arange(len(line))
    available = params.limits.friction_use * min(car.mu_f, car.mu_r) * GRAVITY
    lateral = min(float(np.max(np.abs(line[:, 5] * line[:, 3]))), 0.8 * available)
    deceleration = math.sqrt(available**2 - lateral**2)
    floor = min(params.limits.least_speed_mps if floor is None else floor, x0.vx)
    vx = np.maximum(x0.vx - deceleration * t, floor)
    travelled = _travelled(vx, params.model.step_s)
    along = line[:, THETA] - line[0, THETA]
    along = np.maximum.accumulate(along + 1e-9 * np.arange(len(along)))
    beyond = np.maximum(travelled - along[-1], 0)
    X, Y, psi = (np.interp(travelled, along, line[:, i]) for i in range(3))
    X, Y = X + beyond * np.cos(psi), Y + beyond * np.sin(psi)
    return _steady_plan(X, Y, psi, vx, x0.theta + travelled, x0, car, params)


def name_of(sides: Sides) -> str:
    """Return the sides as words: `left of 1, right of 4`."""
    return ', '.join(f'{WORDS[side]} of {key}' for key, side in sides.items())


def braking_cost(guess: Plan, around: RoadAhead, params: ControllerParams) -> float:
    """Return the cost of the speed that a braking guess loses; no braking plan costs much less."""
    vx = guess.X[:, 3]
    lost = np.maximum(np.minimum(around.vx, around.v_ref) - vx, 0)
    return float(np.sum((lost / params.tolerances.velocity_mps) ** 2))


def regaining_cost(X: np.ndarray, scene: Scene, car: Car, params: ControllerParams) -> float:
    """Return what the velocity will cost after planned states (N + 1, 9), until it is desired.

    With the largest driving force from the last speed, the sum of the squared errors is about

        integral of (v_ref - v)^2 dt = (v_ref - v_N)^3 / (3 F / m).

    Within the horizon a plan that waits before an obstacle may be as cheap as one that passes it,
    and cheaper still at the next tick: it has what passing costs yet to pay. A car that cannot
    drive regains nothing, whatever the plan: 0.
    """
    if not params.limits.drive_n:
        return 0.0
    end = State(*X[-1])
    _, v_ref = reference_path.arcs_at(scene.path, np.array([end.theta]))
    lacking = max(float(v_ref[0]) - end.vx, 0.0)
    squares = lacking**3 / (3 * params.limits.drive_n / car.m) / params.model.step_s
    return squares / params.tolerances.velocity_mps**2


def _speeds(scene, x0, car, params) -> np.ndarray:
    """Return the speeds (N + 1,) [m/s] of a car that takes up the desired speed from below."""
    t = params.model.step_s * np.arange(params.model.horizon + 1)
    _, v_ref = reference_path.arcs_at(scene.path, np.array([x0.theta]))
    drive = params.limits.drive_n / car.m
    return np.minimum(x0.vx + drive * t, max(float(v_ref[0]), x0.vx))


def _travelled(vx, dt) -> np.ndarray:
    """Return the distances (N + 1,) [m] travelled at the speeds of the stages."""
    return np.concatenate(([0], np.cumsum((vx[1:] + vx[:-1]) / 2 * dt)))


def _hazard(obstacle, arcs, params) -> Hazard:
    """Return where a car along the path, at the speeds of `arcs`, meets an obstacle."""
    dt = params.model.step_s
    oX, oY = _positions((obstacle,), len(arcs.X), dt)
    cos_psi, sin_psi = np.cos(arcs.psi), np.sin(arcs.psi)
    ahead = np.abs(cos_psi * (oX[0] - arcs.X) + sin_psi * (oY[0] - arcs.Y))
    e = _left_of(arcs, oX[0], oY[0])
    touch = obstacle.r_obs + params.body.circle_radius_m
    nose = max(map(abs, params.body.circle_offsets_m))
    # the stretch around the stage that is beside it: it may come beside the car again on a lap
    closest = int(np.argmin(ahead))
    beside = ahead < max(touch + nose, ahead[closest] + 1e-9)
    first, final = closest, closest
    while first > 0 and beside[first - 1]:
        first -= 1
    while final < len(beside) - 1 and beside[final + 1]:
        final += 1
    lowest, highest = float(np.min(e[first : final + 1])), float(np.max(e[first : final + 1]))
    side = LEFT if highest < -touch else RIGHT if lowest > touch else BEHIND
    return Hazard(obstacle, dt * first, dt * final, lowest, highest, side)


def _lateral_motion(around, x0) -> tuple[float, float]:
    """Return the offset [m] from the path at stage 0, to the left, and its rate [m/s]."""
    here = Arc(*(float(field[0]) for field in around.arcs))
    pose = arc.Pose(here.X, here.Y, here.psi)
    course = x0.psi - here.psi
    rate = x0.vx * math.sin(course) + x0.vy * math.cos(course)
    return -float(arc.contouring_error(pose, x0.X, x0.Y)), rate


def _left_of(arcs, X, Y):
    """Return how far [m] points are to the left of the path at `arcs`."""
    return np.cos(arcs.psi) * (Y - arcs.Y) - np.sin(arcs.psi) * (X - arcs.X)


@lru_cache(maxsize=16)
def _positions(obstacles, count, dt):
    """Return X and Y (n, count) [m] of a tuple of obstacles at the stages, not to be changed.

    A tick asks for those of the same obstacles ten times and more.
    """
    t = dt * np.arange(count)
    X, Y = np.array([position(o, t) for o in obstacles]).transpose(1, 0, 2)
    X.flags.writeable = Y.flags.writeable = False
    return X, Y


def _quintic(tau, start, slope, end):
    """Return the quintic of tau in [0, 1] from `start` with `slope` to rest at `end`.

    Both ends have no acceleration.
    """
    rise = end - start
    cubic = 10 * rise - 6 * slope
    quartic, quintic = 8 * slope - 15 * rise, 6 * rise - 3 * slope
    return start + tau * (slope + tau**2 * (cubic + tau * (quartic + tau * quintic)))


def _steady_plan(X, Y, course, vx, theta, x0, car, params) -> Plan:
    """Return the plan of steady cornering along a line of positions and courses.

    Where it stands or is slower than SLOW it corners as at that speed.
    """
    dt = params.model.step_s
    Fx = np.clip(car.m * np.gradient(vx, dt), -params.limits.brake_n, params.limits.drive_n)
    v = np.maximum(vx, SLOW)
    available = 0.9 * min(car.mu_f, car.mu_r) * GRAVITY
    r = np.clip(np.gradient(course, dt), -available / v, available / v)
    wheelbase, ay = car.l_f + car.l_r, v * r
    slip_f = car.m * ay * car.l_r / wheelbase / car.C_f
    slip_r = car.m * ay * car.l_f / wheelbase / car.C_r
    vy = car.l_r * r - v * slip_r
    delta = wheelbase * r / v + slip_f - slip_r
    states = State(
        X=X,
        Y=Y,
        psi=course - vy / v,
        vx=vx,
        vy=vy,
        r=r,
        theta=theta,
        delta=np.clip(delta, -params.limits.steer_rad, params.limits.steer_rad),
        Fx=Fx,
    )
    constant = Input(d_delta=0.0, d_Fx=0.0, lambda_b=ideal_split(0.0, car), slack=0.0)
    U = np.tile(constant, (len(X) - 1, 1))
    rate, force_rate = params.limits.steer_rate_radps, params.limits.force_rate_nps
    U[:, 0] = np.clip(np.diff(states.delta) / dt, -rate, rate)
    U[:, 1] = np.clip(np.diff(Fx) / dt, -force_rate, force_rate)
    return initial_guess.start_at(Plan(np.column_stack(states), U), x0)
