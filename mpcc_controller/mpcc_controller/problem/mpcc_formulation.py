"""The paper's MPCC: states in the map, contouring and lag errors, Cartesian distances. SI units.

And trajectory tracking, which differs from it in the reference only.

Everything that may change while driving is a number in `Stage`; the graph is built once.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from mpcc_controller.model import single_track
from mpcc_controller.model.single_track import Car, Input, State
from mpcc_controller.path import arc, distance, reference_path, road_edges
from mpcc_controller.path.arc import Arc
from mpcc_controller.path.reference_path import ReferencePath
from mpcc_controller.problem import cost_terms, ocp, time_gaps
from mpcc_controller.problem.cost_terms import CostTerm, StageQuantities
from mpcc_controller.problem.formulation import Formulation
from mpcc_controller.problem.ocp import Constraints, Rules, SafetyDistance, VehicleCircles
from mpcc_controller.problem.stage_parameters import Scene
from mpcc_controller.problem.time_gaps import STRIPS, Lead

ARC, LEADS = Arc(*Arc._fields), (Lead(*Lead._fields),) * len(STRIPS)  # without meaning
LEAST_EDGE_M = 0.05  # D_sft,E on the narrowest road


class Stage(NamedTuple):
    """The parameters of one stage."""

    car: Car
    weights: Any  # of the cost terms, by name
    D_sft: SafetyDistance
    body: VehicleCircles
    envelope: Any  # shares at which the soft limits begin, by name; of the terms in the problem
    least_speed: Any  # m/s
    path: Arc
    v_ref: Any  # m/s
    centre: Arc  # of the road, along the distance of the path
    half_width: Any  # m, from the centre to the edges
    leads: tuple[Lead, ...]  # see `time_gaps.leads`
    edges: Any  # as in the distance frame
    obstacles: tuple  # the same


class TrackingErrors(NamedTuple):
    """Contouring and lag error (paper, section 3.1)."""

    con: Any  # m, left of the path positive
    lag: Any  # m, behind positive


def quantities(x: State, u: Input | None, p: Stage, rules: Rules) -> StageQuantities:
    """Return what the squared errors of a stage are computed from."""
    circles = [distance.circle(x, offset, p.body.radius) for offset in p.body.offsets]
    v2o, v2e = rules.frame.distances(circles, p)
    pose = arc.pose_at(p.path, x.theta)
    errors = TrackingErrors(arc.contouring_error(pose, x.X, x.Y), arc.lag_error(pose, x.X, x.Y))
    return StageQuantities(x, u, p, errors, x.psi - pose.psi, v2o, v2e, rules.priority)


def constraints(x: State, u: Input, p: Stage) -> Constraints:
    """Return the constrained quantities (paper, section 3.2)."""
    room, beyond = p.half_width - p.body.edge_radius, []
    for offset in ocp.track_offsets(p.body):
        point, centre = distance.circle(x, offset, 0.0), arc.pose_at(p.centre, x.theta + offset)
        square = (point.X - centre.X) ** 2 + (point.Y - centre.Y) ** 2
        beyond.append(ca.sqrt(square + ocp.LENGTH_ROUNDING) - room)
    return ocp.constraints(x, u, p, beyond)


class MpccFormulation(Formulation):
    """The paper's MPCC; see `formulation.Formulation`."""

    state, stage = State, Stage
    template = (('path', ARC), ('centre', ARC), ('half_width', 'half_width'), ('leads', LEADS))
    quantities, constraints = staticmethod(quantities), staticmethod(constraints)
    tuned_weights = (*cost_terms.TUNED, 'tolerances.lag_m')
    integrates_theta = True
    terms: Sequence[CostTerm] = cost_terms.MPCC

    @staticmethod
    def rates(x: State, u: Input, p: Stage) -> State:
        """Return dx/dt (paper, eq. 1)."""
        return single_track.derivative(x, u, p.car)

    def own_parameters(
        self, scene: Scene, x: State, arcs: Arc, v_ref: np.ndarray
    ) -> dict[str, Any]:
        """Return the parameters that only these stages have; see `formulation.Formulation`."""
        window = self.params.surroundings.edge_window_m
        aligned = bool(self.params.surroundings.align_track)
        track = road_edges.track_beside(scene.road, arcs, window, aligned)
        reference, v_ref = self.reference(scene.path, x)
        leads = time_gaps.leads(scene, x, self.params)
        own = {'path': reference, 'v_ref': v_ref, 'leads': leads, **track._asdict()}
        if self.params.safety.fit_edges:
            # where the road is narrow, at most the room beside a car in the middle: a distance that
            # no line keeps would cost wherever the car drives, and to stand before the passage
            # would be cheaper
            room = track.half_width - self.constants['body'].edge_radius
            D_sft = self.constants['D_sft']
            own['D_sft'] = D_sft._replace(e=np.clip(room, LEAST_EDGE_M, D_sft.e))
        return own

    def reference(self, path: ReferencePath, x: State) -> tuple[Arc, np.ndarray]:
        """Return the arcs of the path and the desired speeds [m/s] of the guessed states `x`."""
        return reference_path.arcs_at(path, x.theta)


def tracking_quantities(x: State, u: Input | None, p: Stage, rules: Rules) -> StageQuantities:
    """Return what the squared errors are computed from; errors are those to the moving point."""
    point = p.path
    errors = TrackingErrors(arc.contouring_error(point, x.X, x.Y), arc.lag_error(point, x.X, x.Y))
    moving = quantities(x, u, p, rules)
    return moving._replace(tracking=errors, heading_error=x.psi - point.psi)


class TrackingFormulation(MpccFormulation):
    """Trajectory tracking: follow a point that moves along the path at the desired speed.

    The MPCC chooses its progress along the path; here the reference of each stage is fixed in time,
    as in common tracking MPC. States, prediction model, distances and limits are those of the MPCC.
    """

    integrates_theta = False
    quantities = staticmethod(tracking_quantities)

    def reference(self, path: ReferencePath, x: State) -> tuple[Arc, np.ndarray]:
        """Return the arcs and the desired speeds [m/s] where the reference is at each stage.

        It starts at the point of the path closest to the car and moves at the desired speed.
        """
        theta = np.array(x.theta)
        for k in range(1, len(theta)):
            _, v = reference_path.arcs_at(path, theta[k - 1 : k])
            theta[k] = theta[k - 1] + self.params.model.step_s * v[0]
        return reference_path.arcs_at(path, theta)
