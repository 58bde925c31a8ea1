"""Initial state of a run: by parameters or at the first pose of the coarse path, wheels rolling."""

import math
from typing import NamedTuple

import numpy as np

from msgs_yaml.types import WHEELS, Reference
from node_runtime import named_vector
from vehicle_plant import suspension
from vehicle_plant.parameters import PlantParams, StartParams
from vehicle_plant.state import Planar, State


class Start(NamedTuple):
    """Initial pose and velocity of the CoG; without `vy` and `r` the car rolls straight ahead."""

    X: float  # m, map
    Y: float  # m, map
    psi: float  # rad, map
    speed: float  # m/s, forwards
    vy: float = 0.0  # m/s, to the left: the car slides
    r: float = 0.0  # rad/s


def start_from_parameters(p: StartParams) -> Start:
    """Return the start given by the parameters."""
    return Start(*(value or 0.0 for value in vars(p).values()))  # in the same order


def start_from_reference(path: Reference) -> Start:
    """Return the first pose of the path, with the speed desired in its first interval."""
    (X, X_next, *_), (Y, Y_next, *_), (t, t_next, *_) = path.X, path.Y, path.t
    speed = math.hypot(X_next - X, Y_next - Y) / (t_next - t)
    return Start(float(X), float(Y), float(path.psi[0]), float(speed))


def rolling_state(params: PlantParams, start: Start) -> np.ndarray:
    """Return the flat state (n_x,) of a car whose wheels roll without longitudinal slip.

    The wheels point straight ahead. The tyres have the lateral slip of steady sliding, so that
    their forces do not first have to build up.
    """
    x = dict.fromkeys(named_vector.names(State), 0.0)
    x |= zip((f'planar.{name}' for name in Planar._fields), start)
    wheel = params.car.wheel
    for w, corner in zip(WHEELS, suspension.wheel_corners(params.car)):
        Vx, Vy = start.speed - corner.y * start.r, start.vy + corner.x * start.r
        x[f'wheels.{w}.omega'] = Vx / wheel.radius_m
        x[f'wheels.{w}.windup'] = float(np.sign(Vx))
        slip = Vy / abs(Vx) if Vx else 0.0
        x[f'wheels.{w}.tan_alpha'] = min(max(slip, -wheel.greatest_slip), wheel.greatest_slip)
    return np.array(list(x.values()))
