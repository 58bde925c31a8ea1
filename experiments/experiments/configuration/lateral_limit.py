"""The lateral acceleration that the plant holds in a steady turn."""

from node_runtime import parameters
from vehicle_plant import circular_driving
from vehicle_plant import parameters as plant_parameters
from vehicle_plant.parameters import PlantParams


def lateral_limit(plant: PlantParams, friction: float = 1.0) -> float:
    """Return the peak lateral acceleration [m/s^2] of quasi-steady circular driving (ISO 4138).

    The manoeuvre is that of `identify` (config/identify.yaml of vehicle_plant): steering angle
    increases slowly until the front axle slides. Raises CircleError when it does not.
    """
    manoeuvre = parameters.load(
        circular_driving.CircleParams, plant_parameters.config_file('identify.yaml')
    )
    return float(circular_driving.drive(plant, friction, manoeuvre).column('acceleration.ay').max())
