"""Where the car starts: by parameters, or at the first pose of the coarse path."""

import math

from msgs_yaml.types import Reference
from vehicle_plant.parameters import StartParams
from vehicle_plant.simulator import Start


def from_parameters(p: StartParams) -> Start:
    """Return the start that the parameters give."""
    return Start(p.x_m, p.y_m, p.yaw_rad, p.speed_mps)


def from_reference(path: Reference) -> Start:
    """Return the path's first pose, with the speed desired in its first interval."""
    (X, X_next, *_), (Y, Y_next, *_), (t, t_next, *_) = path.X, path.Y, path.t
    speed = math.hypot(X_next - X, Y_next - Y) / (t_next - t)
    return Start(float(X), float(Y), float(path.psi[0]), float(speed))
