"""Where on the path the car is from tick to tick: theta of stage 0. SI units; instants in ns."""

import math

import numpy as np

from mpcc_controller.driving.setpoints import Setpoints
from mpcc_controller.model.single_track import State
from mpcc_controller.parameters import INTEGRATED, ControllerParams
from mpcc_controller.path import reference_path
from mpcc_controller.path.reference_path import ReferencePath
from mpcc_controller.problem.stage_parameters import Scene
from msgs_yaml.conversions import add_seconds, ns_to_s
from msgs_yaml.types import VehicleState
from stage_solver.stage_problem import Plan

LOST_M = 5.0  # from the projection, beyond it an integrated theta starts from there again
FARTHEST_M = 50.0  # of a path from the car
MOVES_MPS = 3.0  # faster, the course counts, not the heading: a car that spins keeps its path


def objection(path: ReferencePath, x: VehicleState) -> str:
    """Return why the car cannot be on its way along a path, or ''.

    The path is far away, or runs against the car wherever it is near. A state that is not finite
    fits every path.
    """
    if not np.all(np.isfinite(x)):
        return ''
    theta = min(max(reference_path.project(path, x.X, x.Y, None, 0.0), 0.0), path.length)
    foot, _ = reference_path.arcs_at(path, theta)
    distance = math.hypot(foot.X - x.X, foot.Y - x.Y)
    if distance > FARTHEST_M:
        return f'the path is {distance:.0f} m from the car; allowed up to {FARTHEST_M:g} m'
    course = x.psi
    if math.hypot(x.vx, x.vy) > MOVES_MPS:
        course += math.atan2(x.vy, x.vx)
    arcs = path.arcs
    near = np.hypot(arcs.X - x.X, arcs.Y - x.Y) <= FARTHEST_M
    if np.cos(foot.psi - course) > 0 or np.any(np.cos(arcs.psi[near] - course) > 0):
        return ''
    return 'the path runs against the motion of the car'


class PathProgress:
    """Projects the car on the path, from where it was in the tick before."""

    def __init__(self, params: ControllerParams):
        self._reach_m = params.surroundings.path_search_m
        self._model = params.model
        self.reset()

    def reset(self) -> None:
        """Forget where the car was: another path, or another drive."""
        self.theta: float | None = None  # m, last projection on the path
        self._stage_ns = 0  # when stage 0 of the last plan was

    def project(self, x: VehicleState, scene: Scene) -> float:
        """Return the distance [m] along the path of the point closest to the car."""
        self.theta = reference_path.project(scene.path, x.X, x.Y, self.theta, self._reach_m)
        return self.theta

    def initial_state(
        self, x: VehicleState, now: Setpoints, scene: Scene, last_plan: Plan | None
    ) -> State:
        """Return the state of stage 0: heading within pi of the path's, theta by projection.

        With `model.theta` integrated, theta is where the last plan predicted it: the lag error of
        stage 0 is what the prediction has missed. It starts from the projection again where there
        is no last plan, after a change of the path, and beyond LOST_M from the projection.
        """
        is_new_path = self.theta is None
        theta = self.project(x, scene)
        if self._model.theta == INTEGRATED:
            if not is_new_path and last_plan is not None:
                predicted = self._predicted_theta(last_plan, x.stamp_ns)
                if abs(predicted - theta) <= LOST_M:
                    theta = predicted
            self._stage_ns = x.stamp_ns
        arcs, _ = reference_path.arcs_at(scene.path, theta)
        turns = np.round((arcs.psi - x.psi) / (2 * np.pi))
        return State(
            X=x.X,
            Y=x.Y,
            psi=float(x.psi + 2 * np.pi * turns),
            vx=x.vx,
            vy=x.vy,
            r=x.r,
            theta=theta,
            delta=now.delta,
            Fx=now.Fx,
        )

    def skip_tick(self) -> None:
        """Follow a last plan that was shifted by a tick without a new initial state."""
        self._stage_ns = add_seconds(self._stage_ns, self._model.step_s)

    def _predicted_theta(self, plan: Plan, stamp_ns: int) -> float:
        """Return the theta [m] of a plan at an instant."""
        t = self._model.step_s * np.arange(self._model.horizon + 1)
        theta = plan.X[:, State._fields.index('theta')]
        return float(np.interp(ns_to_s(stamp_ns - self._stage_ns), t, theta))
