"""An emergency that is not there, for controllers that warm up. SI units."""

from mpcc_controller.path import reference_path
from mpcc_controller.problem.stage_parameters import Scene
from msgs_yaml.types import Obstacle, Obstacles, VehicleState

AHEAD_S = 1.5  # of driving at the present or the desired speed
LEAST_AHEAD_M = 8.0
RADIUS_M = 0.5


def with_obstacle_ahead(scene: Scene, x: VehicleState) -> Scene:
    """Return a complete scene with one obstacle instead of its own, on the path ahead of the car.

    A car at `x` has to pass it or to brake for it.
    """
    theta = reference_path.project(scene.path, x.X, x.Y, None, 0.0)
    _, v_ref = reference_path.arcs_at(scene.path, theta)
    ahead = max(AHEAD_S * max(x.vx, float(v_ref)), LEAST_AHEAD_M)
    arcs, _ = reference_path.arcs_at(scene.path, theta + ahead)
    obstacle = Obstacle(1, float(arcs.X), float(arcs.Y), RADIUS_M, 0.0, 0.0)
    return scene._replace(obstacles=Obstacles(scene.obstacles.stamp_ns, (obstacle,)))
