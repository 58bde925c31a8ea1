"""The lateral acceleration that the plant holds in a steady turn."""

from node_runtime import parameters
from vehicle_plant import circle
from vehicle_plant import parameters as plant_parameters
from vehicle_plant.parameters import PlantParams


def lateral_limit(plant: PlantParams, friction: float = 1.0) -> float:
    """Return the peak lateral acceleration [m/s^2] of quasi-steady circular driving (ISO 4138).

    The manoeuvre is that of `identify` (config/identify.yaml of vehicle_plant): steering angle
    increases slowly until the front axle slides. Raises circle.CircleError when it never does.
    """
    manoeuvre = parameters.load(circle.Circle, plant_parameters.config('identify.yaml'))
    return float(circle.drive(plant, friction, manoeuvre).column('acceleration.ay').max())
