"""The road ahead and the dangerous obstacles on it, before any plan of a tick. SI units."""

import math
from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from mpcc_controller.driving.obstacle_passing import BEHIND, LEFT, RIGHT, least_gaps, positions
from mpcc_controller.model.single_track import Car, State
from mpcc_controller.parameters import ControllerParams
from mpcc_controller.path import arc, reference_path, road_edges
from mpcc_controller.path.arc import Arc
from mpcc_controller.problem.stage_parameters import Scene
from msgs_yaml.types import Obstacle


class Hazard(NamedTuple):
    """A dangerous obstacle beside the path, as a car that takes up the desired speed meets it."""

    obstacle: Obstacle
    enter: float  # s, from then on it is beside the car
    leave: float  # s, until then
    lowest: float  # m, left of the path, its centre meanwhile
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
    theta = x0.theta + travelled(vx, params.model.step_s)
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


def lateral_motion(around: RoadAhead, x0: State) -> tuple[float, float]:
    """Return the offset [m] from the path at stage 0, to the left, and its rate [m/s]."""
    here = Arc(*(float(field[0]) for field in around.arcs))
    pose = arc.Pose(here.X, here.Y, here.psi)
    course = x0.psi - here.psi
    rate = x0.vx * math.sin(course) + x0.vy * math.cos(course)
    return float(arc.contouring_error(pose, x0.X, x0.Y)), rate


def travelled(vx: np.ndarray, dt: float) -> np.ndarray:
    """Return the distances (N + 1,) [m] travelled at the speeds of the stages."""
    return np.concatenate(([0], np.cumsum((vx[1:] + vx[:-1]) / 2 * dt)))


def _speeds(scene, x0, car, params) -> np.ndarray:
    """Return the speeds (N + 1,) [m/s] of a car that takes up the desired speed from below."""
    t = params.model.step_s * np.arange(params.model.horizon + 1)
    _, v_ref = reference_path.arcs_at(scene.path, np.array([x0.theta]))
    drive = params.limits.drive_n / car.m
    return np.minimum(x0.vx + drive * t, max(float(v_ref[0]), x0.vx))


def _hazard(obstacle, arcs, params) -> Hazard:
    """Return where a car along the path, at the speeds of `arcs`, meets an obstacle."""
    dt = params.model.step_s
    oX, oY = positions((obstacle,), len(arcs.X), dt)
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


def _left_of(arcs, X, Y):
    """Return how far [m] points are to the left of the path at `arcs`."""
    return np.cos(arcs.psi) * (Y - arcs.Y) - np.sin(arcs.psi) * (X - arcs.X)
