"""The lateral acceleration that a plant holds in a steady turn: a property of car and road."""

from functools import cache

import numpy as np

from node_runtime import parameters
from vehicle_plant import circular_driving
from vehicle_plant import parameters as plant_parameters
from vehicle_plant.circular_driving import CircleError
from vehicle_plant.parameters import PlantParams

GRID = 10  # frictions at which a plant drives the circle, per 1; linear between them to 0.2 %


def lateral_limit(plant: PlantParams, friction: float = 1.0) -> float:
    """Return the peak lateral acceleration [m/s^2] of quasi-steady circular driving (ISO 4138).

    The manoeuvre is that of `identify` (config/identify.yaml of vehicle_plant): the steering angle
    increases slowly until the front axle slides. Raises CircleError when it does not.
    """
    file = plant_parameters.config_file('identify.yaml')
    manoeuvre = parameters.load(circular_driving.CircleParams, file)
    return float(circular_driving.drive(plant, friction, manoeuvre).column('acceleration.ay').max())


def held_lateral_limit(plant: PlantParams, friction: float) -> float | None:
    """Return the `lateral_limit` at any friction, interpolated between those of a grid.

    A drive of the circle takes as long as a run: of a plant each friction of the grid is driven
    once per process. None for a plant that cannot drive the circle.
    """
    at = friction * GRID
    # the lowest friction of all, 0.05, is below the grid
    steps = (at,) if at < 1 else (float(np.floor(at)), float(np.ceil(at)))
    limits = [_limit_at(plant, step) for step in steps]
    return None if None in limits else float(np.interp(at, steps, limits))


@cache
def _limit_at(plant, step):
    try:
        return lateral_limit(plant, step / GRID)
    except CircleError:
        return None
