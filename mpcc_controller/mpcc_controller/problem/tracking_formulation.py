"""Trajectory tracking: follow a point that moves along the path at the desired speed. SI units.

The MPCC chooses its progress along the path; here the reference of each stage is fixed in time, as
in common tracking MPC. States, prediction model, distances and limits are those of the MPCC.
"""

import numpy as np

from mpcc_controller.model.single_track import Input, State
from mpcc_controller.path import arc, reference_path
from mpcc_controller.path.arc import Arc, Pose
from mpcc_controller.path.reference_path import ReferencePath
from mpcc_controller.problem import mpcc_formulation
from mpcc_controller.problem.cost_terms import StageQuantities
from mpcc_controller.problem.mpcc_formulation import MpccFormulation, Stage, TrackingErrors
from mpcc_controller.problem.ocp import Rules


def quantities(x: State, u: Input | None, p: Stage, rules: Rules) -> StageQuantities:
    """Return what the squared errors are computed from; errors are those to the moving point."""
    pose = Pose(p.path.X, p.path.Y, p.path.psi)
    errors = TrackingErrors(arc.contouring_error(pose, x.X, x.Y), arc.lag_error(pose, x.X, x.Y))
    moving = mpcc_formulation.quantities(x, u, p, rules)
    return moving._replace(tracking=errors, heading_error=x.psi - pose.psi)


class TrackingFormulation(MpccFormulation):
    """Trajectory tracking; see `formulation.Formulation`."""

    integrates_theta = False
    quantities = staticmethod(quantities)

    def reference(self, path: ReferencePath, x: State) -> tuple[Arc, np.ndarray]:
        """Return the arcs and the desired speeds [m/s] where the reference is at each stage.

        It starts at the point of the path closest to the car and moves at the desired speed.
        """
        theta = np.array(x.theta)
        for k in range(1, len(theta)):
            _, v = reference_path.arcs_at(path, theta[k - 1 : k])
            theta[k] = theta[k - 1] + self.params.model.step_s * v[0]
        return reference_path.arcs_at(path, theta)
