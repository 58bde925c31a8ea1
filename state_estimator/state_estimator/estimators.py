"""The estimators by the name that the parameter `method` has."""

from state_estimator.filter import Filter
from state_estimator.parameters import EstimatorParams, Vehicle
from state_estimator.references import KinematicObserver, Raw

BY_METHOD = {'filter': Filter, 'kinematic': KinematicObserver, 'raw': Raw}


def create(params: EstimatorParams, vehicle: Vehicle, yaw_rad: float | None = None) -> Filter | Raw:
    """Return an estimator without a state; `yaw_rad` is the heading of a car at rest."""
    return BY_METHOD[params.method](params, vehicle, yaw_rad)
