"""The limits that a controller keeps: its own, cut to what the actuators of the car can do."""

import dataclasses

from mpcc_controller.parameters import CarActuators, CarParams, ControllerParams

# a limit of the controller and what the car can do have the same name and unit
SHARED = ('steer_rad', 'steer_rate_radps', 'brake_n', 'drive_n', 'force_rate_nps')


def apply(params: ControllerParams, vehicle: CarParams) -> ControllerParams:
    """Return the parameters with every limit at most what the car can do."""
    cut = {name: getattr(vehicle.actuators, name) for name in exceeded(params, vehicle.actuators)}
    return dataclasses.replace(params, limits=dataclasses.replace(params.limits, **cut))


def exceeded(params: ControllerParams, actuators: CarActuators) -> tuple[str, ...]:
    """Return the names of the limits that are more than the car can do."""
    return tuple(name for name in SHARED if getattr(params.limits, name) > getattr(actuators, name))
