"""The car as the controller knows it: its file, and the limits that its actuators set."""

import dataclasses
from collections.abc import Mapping

from mpcc_controller.parameters import CarActuators, CarParams, ControllerParams
from node_runtime import node_parameters, parameters
from node_runtime.node_parameters import NO_SOURCES
from node_runtime.parameters import ParameterError

# limits of the controller and of the actuators with the same name and unit
SHARED_LIMITS = ('steer_rad', 'steer_rate_radps', 'brake_n', 'drive_n', 'force_rate_nps')


def load(params: ControllerParams, sources: Mapping[str, str] = NO_SOURCES) -> CarParams:
    """Read the file that the parameter `car_file` names; see `read`."""
    return read(params.car_file, sources)


def read(name: str, sources: Mapping[str, str] = NO_SOURCES) -> CarParams:
    """Read a car file; `node_parameters.find_config` explains names and paths.

    Raises ParameterError for a wrong value and for a file that does not exist; `sources` holds by
    parameter where its value comes from, for the error text.
    """
    path = node_parameters.find_named_config(
        'mpcc_controller', 'car_file', name, 'car.mass_kg', sources
    )
    return parameters.load(CarParams, path)


def exceeded_limits(params: ControllerParams, actuators: CarActuators) -> tuple[str, ...]:
    """Return the names of the limits that exceed those of the actuators."""
    limits = params.limits
    return tuple(n for n in SHARED_LIMITS if getattr(limits, n) > getattr(actuators, n))


def limit_to_car(params: ControllerParams, vehicle: CarParams) -> ControllerParams:
    """Return the parameters with every limit cut to that of the actuators."""
    exceeded = exceeded_limits(params, vehicle.actuators)
    limits = {name: getattr(vehicle.actuators, name) for name in exceeded}
    return dataclasses.replace(params, limits=dataclasses.replace(params.limits, **limits))


def check_limits(params: ControllerParams, vehicle: CarParams, sources: Mapping[str, str]) -> None:
    """Raise ParameterError for a limit that a user set and that exceeds the actuators.

    `sources` holds by dotted parameter name where a value that a user set comes from.
    """
    for name in exceeded_limits(params, vehicle.actuators):
        key = f'limits.{name}'
        if key in sources:
            value, limit = getattr(params.limits, name), getattr(vehicle.actuators, name)
            raise ParameterError(
                f'{sources[key]}: {key}: is {value:g}; allowed up to {limit:g}, which the car can '
                f'do (actuators.{name})'
            )


def describe_cut_limits(params: ControllerParams, vehicle: CarParams) -> str:
    """Return one line that names the limits cut to those of the car, '' if none is."""
    cuts = [
        f'limits.{name} from {getattr(params.limits, name):g} to '
        f'{getattr(vehicle.actuators, name):g}'
        for name in exceeded_limits(params, vehicle.actuators)
    ]
    if not cuts:
        return ''
    return (
        f'the controller may ask for more than the car of car_file {params.car_file} can do; cut: '
        + ', '.join(cuts)
    )
