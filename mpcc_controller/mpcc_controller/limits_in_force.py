"""The limits that a controller keeps: its own, cut to what the actuators of the car can do."""

import dataclasses
from collections.abc import Mapping

from mpcc_controller.parameters import CarActuators, CarParams, ControllerParams
from node_runtime.parameters import ParameterError

# a limit of the controller and what the car can do have the same name and unit
SHARED = ('steer_rad', 'steer_rate_radps', 'brake_n', 'drive_n', 'force_rate_nps')


def apply(params: ControllerParams, vehicle: CarParams) -> ControllerParams:
    """Return the parameters with every limit at most what the car can do."""
    cut = {name: getattr(vehicle.actuators, name) for name in exceeded(params, vehicle.actuators)}
    return dataclasses.replace(params, limits=dataclasses.replace(params.limits, **cut))


def exceeded(params: ControllerParams, actuators: CarActuators) -> tuple[str, ...]:
    """Return the names of the limits that are more than the car can do."""
    return tuple(name for name in SHARED if getattr(params.limits, name) > getattr(actuators, name))


def refuse(params: ControllerParams, vehicle: CarParams, sources: Mapping[str, str]) -> None:
    """Raise ParameterError for a limit that was asked for and that the car would cut.

    `sources` says by parameter who asked, for those that were asked for.
    """
    for name in exceeded(params, vehicle.actuators):
        key = f'limits.{name}'
        if key in sources:
            asked, most = getattr(params.limits, name), getattr(vehicle.actuators, name)
            raise ParameterError(
                f'{sources[key]}: {key}: is {asked:g}; allowed up to {most:g}, which the car can '
                f'do (actuators.{name})'
            )


def told(params: ControllerParams, vehicle: CarParams) -> str:
    """Return which limits are cut, one line, '' where none is."""
    cut = [
        f'limits.{name} from {getattr(params.limits, name):g} to '
        f'{getattr(vehicle.actuators, name):g}'
        for name in exceeded(params, vehicle.actuators)
    ]
    if not cut:
        return ''
    return (
        f'the controller may ask for more than the car of car_file {params.car_file} can do; cut: '
        + ', '.join(cut)
    )
