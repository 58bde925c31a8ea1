"""Initial state of a run: by parameters or at the first pose of the coarse path, rolling freely."""

import math
from typing import NamedTuple

import numpy as np

from msgs_yaml.types import WHEELS, Reference
from node_runtime import named_vector
from vehicle_plant.parameters import PlantParams, StartParams
from vehicle_plant.state import State


class Start(NamedTuple):
    """Initial pose and speed of the CoG; the car rolls straight ahead."""

    X: float  # m, map
    Y: float  # m, map
    psi: float  # rad, map
    speed: float  # m/s


def start_from_parameters(p: StartParams) -> Start:
    """Return the start given by the parameters."""
    return Start(p.x_m, p.y_m, p.yaw_rad, p.speed_mps)


def start_from_reference(path: Reference) -> Start:
    """Return the first pose of the path, with the speed desired in its first interval."""
    (X, X_next, *_), (Y, Y_next, *_), (t, t_next, *_) = path.X, path.Y, path.t
    speed = math.hypot(X_next - X, Y_next - Y) / (t_next - t)
    return Start(float(X), float(Y), float(path.psi[0]), float(speed))


def rolling_state(params: PlantParams, start: Start) -> np.ndarray:
    """Return the flat state (n_x,) of a car that rolls straight ahead without slip."""
    x = dict.fromkeys(named_vector.names(State), 0.0)
    x |= zip(('planar.X', 'planar.Y', 'planar.psi', 'planar.vx'), start)
    for w in WHEELS:
        x[f'wheels.{w}.omega'] = start.speed / params.car.wheel.radius_m
        x[f'wheels.{w}.windup'] = float(np.sign(start.speed))
    return np.array(list(x.values()))
