"""Where on the path the car is from tick to tick: theta of stage 0. SI units; instants in ns."""

import math
from typing import NamedTuple

import numpy as np

from mpcc_controller.driving.setpoints import Setpoints
from mpcc_controller.model.single_track import State
from mpcc_controller.parameters import INTEGRATED, ControllerParams
from mpcc_controller.path import reference_path
from mpcc_controller.path.reference_path import ReferencePath, project
from mpcc_controller.problem.stage_parameters import Scene
from msgs_yaml.conversions import ns_to_s
from msgs_yaml.types import VehicleState
from stage_solver.stage_problem import Plan

# from the projection: beyond it an integrated theta starts from there again, and the car begins on
# no other stretch of the path
LOST_M = 5.0
FARTHEST_M = 50.0  # of a path from the car
MOVES_MPS = 3.0  # faster, the course counts, not the heading: a car that spins keeps its path


def objection(path: ReferencePath, x: VehicleState) -> str:
    """Return why the car cannot be on its way along a path, or ''.

    The path is far away, or runs against the car wherever it is near. A state that is not finite
    fits every path.
    """
    if not np.all(np.isfinite(x)):
        return ''
    theta = min(max(project(path, x.X, x.Y, None, 0.0), 0.0), path.length)
    foot, _ = reference_path.arcs_at(path, theta)
    distance = math.hypot(foot.X - x.X, foot.Y - x.Y)
    if distance > FARTHEST_M:
        return f'the path is {distance:.0f} m from the car; allowed up to {FARTHEST_M:g} m'
    arcs, course = path.arcs, _course(x)
    near = np.hypot(arcs.X - x.X, arcs.Y - x.Y) <= FARTHEST_M
    if np.cos(foot.psi - course) > 0 or np.any(np.cos(arcs.psi[near] - course) > 0):
        return ''
    return 'the path runs against the motion of the car'


def _course(x):
    """Return the direction in which the car moves [rad, map]; while it is slow, its heading."""
    return x.psi + (math.atan2(x.vy, x.vx) if math.hypot(x.vx, x.vy) > MOVES_MPS else 0.0)


def find_theta(
    path: ReferencePath, x: VehicleState | State, near: float | None, reach: float
) -> float:
    """Return theta [m] of a car, projected within `reach` [m] of `near`.

    With None, of a car that was not on the path before, on a stretch that runs with it: where the
    closest point runs against the car, the way back may be closer than the way there.
    """
    theta = project(path, x.X, x.Y, near, reach)
    if near is not None:
        return theta
    foot, _ = reference_path.arcs_at(path, theta)
    if np.cos(foot.psi - _course(x)) <= 0:
        arcs = path.arcs
        away = np.hypot(arcs.X - x.X, arcs.Y - x.Y)
        away[np.cos(arcs.psi - _course(x)) <= 0] = np.inf
        best = int(np.argmin(away))
        if away[best] <= math.hypot(foot.X - x.X, foot.Y - x.Y) + LOST_M:
            theta = project(path, x.X, x.Y, arcs.theta[best], reach)
    return theta


class Progress(NamedTuple):
    """Where on the path the car was; nothing on another path or in another drive."""

    theta: float | None = None  # m, last projection on the path
    stage_ns: int = 0  # when stage 0 of the last plan was


def initial_state(
    progress: Progress,
    x: VehicleState,
    now: Setpoints,
    scene: Scene,
    last_plan: Plan | None,
    params: ControllerParams,
) -> tuple[Progress, State]:
    """Return the state of stage 0: heading within pi of the path's, theta by projection.

    With `model.theta` integrated, theta is where the last plan predicted it: the lag error of
    stage 0 is what the prediction has missed. It starts from the projection again where there
    is no last plan, after a change of the path, and beyond LOST_M from the projection.
    """
    model, reach = params.model, params.surroundings.path_search_m
    here = theta = find_theta(scene.path, x, progress.theta, reach)
    stage_ns = progress.stage_ns
    if model.theta == INTEGRATED:
        if progress.theta is not None and last_plan is not None:
            t = model.step_s * np.arange(model.horizon + 1)
            planned = last_plan.X[:, State._fields.index('theta')]
            predicted = float(np.interp(ns_to_s(x.stamp_ns - stage_ns), t, planned))
            if abs(predicted - here) <= LOST_M:
                theta = predicted
        stage_ns = x.stamp_ns
    arcs, _ = reference_path.arcs_at(scene.path, theta)
    turns = np.round((arcs.psi - x.psi) / (2 * np.pi))
    psi = float(x.psi + 2 * np.pi * turns)
    x0 = State(x.X, x.Y, psi, x.vx, x.vy, x.r, theta, now.delta, now.Fx)
    return Progress(here, stage_ns), x0
