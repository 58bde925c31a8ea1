"""The baseline: nonlinear MPC in coordinates along the coarse path. SI units.

Brown & Gerdes, "Coordinating tire forces to avoid obstacles using nonlinear model predictive
control", IEEE T-IV 2019, as far as it is public; docs/paper.md gives the source of every choice.
Inputs, prediction model and limits are those of the paper's MPCC.
"""

from collections import namedtuple
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from mpcc_controller.model import single_track
from mpcc_controller.model.single_track import Input, State
from mpcc_controller.path import frenet_frame
from mpcc_controller.path.arc import Arc
from mpcc_controller.path.distance import Circle
from mpcc_controller.path.frenet_frame import FrenetPoint
from mpcc_controller.path.reference_path import ReferencePath
from mpcc_controller.problem import cost_terms, distance_frame, ocp
from mpcc_controller.problem.cost_terms import StageQuantities
from mpcc_controller.problem.formulation import Formulation
from mpcc_controller.problem.ocp import Constraints, Rules
from mpcc_controller.problem.stage_parameters import CONSTANTS, Scene
from stage_solver.stage_problem import Plan

MIN_STEP_M = 1e-3  # of path in a step; below it the curvature is that of the point


class FrenetState(NamedTuple):
    """State x of the baseline."""

    s: Any  # m along the path
    e: Any  # m, left of the path positive
    dpsi: Any  # rad, heading relative to the path
    vx: Any  # m/s, body
    vy: Any  # m/s, body
    r: Any  # rad/s
    delta: Any  # rad, road-wheel angle
    Fx: Any  # N, total longitudinal force


# The parameters of one stage, as those of `mpcc_formulation.Stage`. kappa [1/m]: mean curvature of
# the path over the step, left positive
FrenetStage = namedtuple('FrenetStage', (*CONSTANTS, 'kappa', 'v_ref', 'edges', 'obstacles'))


class FrenetErrors(NamedTuple):
    """Lateral and heading error."""

    e: Any  # m, left of the path positive
    dpsi: Any  # rad


def rates(x: FrenetState, u: Input, p: FrenetStage) -> FrenetState:
    """Return dx/dt: the paper's car in path coordinates."""
    body = single_track.body_rates(x, u, p.car)
    path = frenet_frame.rates(x.e, x.dpsi, p.kappa, x.vx, x.vy, x.r)
    return FrenetState(*path, *body, delta=u.d_delta, Fx=u.d_Fx)


def quantities(x: FrenetState, u: Input | None, p: FrenetStage, rules: Rules) -> StageQuantities:
    """Return what the squared errors of a stage are computed from."""
    circles = [Circle(*point_ahead(x, offset), p.body.radius) for offset in p.body.offsets]
    v2o, v2e = distance_frame.distances(circles, p, frenet_frame.v2e)
    errors = FrenetErrors(x.e, x.dpsi)
    return StageQuantities(x, u, p, errors, x.dpsi, v2o, v2e, rules.priority)


def constraints(x: FrenetState, u: Input, p: FrenetStage) -> Constraints:
    """Return the constrained quantities, the same as those of the MPCC."""
    beyond = []
    for offset in ocp.track_offsets(p.body):
        point = point_ahead(x, offset)
        left, right = (frenet_frame.edge_offset(edge, point.s) for edge in p.edges)
        gap = ca.sqrt((point.e - (left + right) / 2) ** 2 + ocp.LENGTH_ROUNDING)
        beyond.append(gap - ((left - right) / 2 - p.body.edge_radius))
    return ocp.constraints(x, u, p, beyond)


def point_ahead(x: FrenetState, offset) -> FrenetPoint:
    """Return the point of the car `offset` [m] ahead of the CoG."""
    return FrenetPoint(x.s + offset * ca.cos(x.dpsi), x.e + offset * ca.sin(x.dpsi))


def mean_curvatures(arcs: Arc) -> np.ndarray:
    """Return the mean curvature of the path [1/m] over every step between points of it (k,).

    The heading of the frame then turns by as much as that of the path, however the curvature
    changes within a step. The last point keeps its own.
    """
    turn, length = np.diff(arcs.psi), np.diff(arcs.theta)
    moves = np.abs(length) > MIN_STEP_M
    mean = np.divide(turn, length, out=np.array(arcs.kappa[:-1]), where=moves)
    return np.append(mean, arcs.kappa[-1])


class FrenetFormulation(Formulation):
    """The baseline of Brown & Gerdes; see `formulation.Formulation`."""

    state, stage = FrenetState, FrenetStage
    template = (('kappa', 'kappa'),)
    rates, quantities, constraints = map(staticmethod, (rates, quantities, constraints))
    tuned_weights = (*cost_terms.TUNED, 'tolerances.heading_rad')
    integrates_theta = False
    terms = cost_terms.FRENET

    def place(self, path: ReferencePath, x: State) -> State:
        """Return guessed states with theta of their feet on the path."""
        return x._replace(theta=frenet_frame.refine(path, x.X, x.Y, x.theta).s)

    def own_parameters(
        self, scene: Scene, x: State, arcs: Arc, v_ref: np.ndarray
    ) -> dict[str, Any]:
        """Return the parameters that only these stages have; see `formulation.Formulation`."""
        return {'kappa': mean_curvatures(arcs), 'v_ref': v_ref}

    def to_local(self, plan: Plan, path: ReferencePath) -> Plan:
        """Return a plan in the map (N + 1, 9) in path coordinates (N + 1, 8)."""
        x = State(*plan.X.T)
        point = frenet_frame.refine(path, x.X, x.Y, x.theta)
        dpsi = x.psi - frenet_frame.to_cartesian(path, point).psi
        turns = np.round(dpsi / (2 * np.pi))
        states = FrenetState(*point, dpsi - 2 * np.pi * turns, x.vx, x.vy, x.r, x.delta, x.Fx)
        return plan._replace(X=np.column_stack(states))

    def to_map(self, plan: Plan, path: ReferencePath) -> Plan:
        """Return a plan in path coordinates in the map; theta is the distance along the path."""
        x = FrenetState(*plan.X.T)
        pose = frenet_frame.to_cartesian(path, FrenetPoint(x.s, x.e))
        states = State(pose.X, pose.Y, pose.psi + x.dpsi, x.vx, x.vy, x.r, x.s, x.delta, x.Fx)
        return plan._replace(X=np.column_stack(states))
