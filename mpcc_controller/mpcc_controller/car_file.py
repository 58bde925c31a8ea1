"""The car as the controller knows it: its file, and the limits that its actuators set."""

import dataclasses
from collections.abc import Mapping

from mpcc_controller.parameters import CarActuators, CarParams, ControllerParams, Limits
from node_runtime import node_parameters, parameters
from node_runtime.node_parameters import NO_SOURCES
from node_runtime.parameters import ParameterError

# limits of the controller and of the actuators with the same name and unit
SHARED_LIMITS = ('steer_rad', 'steer_rate_radps', 'brake_n', 'drive_n', 'force_rate_nps')
EMERGENCY_LIMITS = ('steer_rad', 'steer_rate_radps', 'brake_n', 'force_rate_nps', 'friction_use')
# of what the car can do, or of the value at the start: what each of these is at least
LEAST_SHARE = 0.5
FULL_BRAKING_S = 1.0  # until the brakes have their largest force, at most


def load(params: ControllerParams, sources: Mapping[str, str] = NO_SOURCES) -> CarParams:
    """Read the file that the parameter `car_file` names; see `read`.

    Raises ParameterError, too, for limits with which that car can hardly brake or swerve.
    """
    vehicle = read(params.car_file, sources)
    check_emergency_limits(params, vehicle, sources)
    return vehicle


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


def check_emergency_limits(
    params: ControllerParams, vehicle: CarParams, sources: Mapping[str, str] = NO_SOURCES
) -> None:
    """Raise ParameterError for a limit with which the car can hardly brake or swerve.

    Gate, braking without a plan and changes while the controller drives start from these limits.
    `sources` is that of `check_limits`.
    """
    share, actuators = LEAST_SHARE, vehicle.actuators
    least = {
        name: (
            share * getattr(actuators, name),
            f'{share:g} of what the car can do (actuators.{name})',
        )
        for name in EMERGENCY_LIMITS[:-1]
    }
    full_braking = (
        actuators.brake_n / FULL_BRAKING_S,
        f'with which the brakes (actuators.brake_n) reach their largest force in '
        f'{FULL_BRAKING_S:g} s',
    )
    least['force_rate_nps'] = min(least['force_rate_nps'], full_braking)
    least['friction_use'] = (share, 'of the friction that the car has')
    require(params.limits, least, sources)


def require(
    limits: Limits, least: Mapping[str, tuple[float, str]], sources: Mapping[str, str]
) -> None:
    """Raise ParameterError for a limit below its `least` value, which comes with its reason."""
    for name, (allowed, why) in least.items():
        key, value = f'limits.{name}', getattr(limits, name)
        if value < allowed:
            source = f'{sources[key]}: ' if key in sources else ''
            raise ParameterError(f'{source}{key}: is {value:g}; allowed from {allowed:g}, {why}')
