"""The plant as a node, and where its files are: a car with its run, and the tyre it stands on."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from node_runtime import node_parameters, parameters
from node_runtime.node_parameters import NO_SOURCES
from node_runtime.parameters import Choice, ParameterError, Range
from vehicle_plant import tyre_property_file
from vehicle_plant.car import Car, PlantParams
from vehicle_plant.tyre_coefficients import TyreCoefficients

DEFAULT_CAR = 'bmw_545i.yaml'
OF_A_CAR, OF_A_TYRE = 'tyre_set', 'reference.FNOMIN'  # a parameter that no other file has
START_FROM = Choice('reference', 'parameters')  # what start.from may be; the first is the default


@dataclass(frozen=True)
class StartParams:
    """Where the car starts, rolling straight ahead."""

    x_m: Annotated[float, Range(-1e4, 1e4, 'm')]
    y_m: Annotated[float, Range(-1e4, 1e4, 'm')]
    yaw_rad: Annotated[float, Range(-10.0, 10.0, 'rad')]
    # it may stand, too
    speed_mps: Annotated[float, Range(0.0, parameters.SPEED.high, parameters.SPEED.unit)]


@dataclass(frozen=True)
class StopParams:
    """When a run ends: a line that is crossed in the direction yaw_rad, or too late."""

    x_m: Annotated[float, Range(-1e4, 1e4, 'm')]
    y_m: Annotated[float, Range(-1e4, 1e4, 'm')]
    yaw_rad: Annotated[float, Range(-10.0, 10.0, 'rad')]
    armed_after_m: Annotated[float, Range(0.0, 1e5, 'm')]
    time_s: Annotated[float, parameters.RUN_TIME]


@dataclass(frozen=True)
class FrictionPatchParams:
    """Where the road has another friction: see `road`."""

    corners_m: Annotated[tuple[float, ...], Range(-1e5, 1e5, 'm')]
    friction: Annotated[tuple[float, ...], parameters.ROAD_FRICTION]


@dataclass(frozen=True)
class NodeParams:
    """The plant as a node: config/bmw_545i.yaml."""

    friction: Annotated[float, parameters.ROAD_FRICTION]
    patches: FrictionPatchParams
    tyre_set: str
    imu_wheels_period_ms: Annotated[int, Range(1, 50, 'ms')]
    command_age_s: Annotated[float, Range(0.05, 1.0, 's')]
    lockstep_timeout_s: Annotated[float, Range(0.1, 3600.0, 's')]
    start: StartParams
    stop: StopParams
    car: Car


def config_file(name: str) -> Path:
    """Return the path of a file of config/. Raises ParameterError when there is none."""
    try:
        return node_parameters.find_config('vehicle_plant', name)
    except FileNotFoundError as error:
        raise ParameterError(str(error)) from None


def car_file(name: str, named_by: str = 'plant_params') -> Path:
    """Return the path of the car that a parameter or option names. Raises ParameterError."""
    return node_parameters.find_named_config('vehicle_plant', named_by, name, OF_A_CAR)


def load_tyre(name: str, named_by: str = 'tyre_set') -> TyreCoefficients:
    """Read the tyre that a parameter or option names, a .tir or YAML file; ParameterError."""
    return _tyre(node_parameters.find_named_config('vehicle_plant', named_by, name, OF_A_TYRE))


def _tyre(path):
    return (
        tyre_property_file.load(path)
        if path.suffix.lower() == '.tir'
        else parameters.load(TyreCoefficients, path)
    )


def plant_params(node: NodeParams, sources: Mapping[str, str] = NO_SOURCES) -> PlantParams:
    """Return the car with the tyre that it names.

    Raises ParameterError; `sources` says by parameter where its value comes from.
    """
    path = node_parameters.find_named_config(
        'vehicle_plant', 'tyre_set', node.tyre_set, OF_A_TYRE, sources
    )
    return PlantParams(node.car, _tyre(path))


def load(path: Path | None = None) -> PlantParams:
    """Read car and tyre, those of config/bmw_545i.yaml unless told otherwise."""
    return plant_params(parameters.load(NodeParams, path or config_file(DEFAULT_CAR)))
