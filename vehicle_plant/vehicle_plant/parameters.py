"""The plant as a node, and where its files are: a car with its run, and the tyre it stands on."""

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from msgs_yaml import parameters, share
from msgs_yaml.parameters import ParameterError, Range
from vehicle_plant import tir
from vehicle_plant.car import Car, PlantParams
from vehicle_plant.tyre_set import TyreSet

DEFAULT_CAR = 'bmw_545i.yaml'


@dataclass(frozen=True)
class StartParams:
    """Where the car starts, rolling straight ahead."""

    x_m: Annotated[float, Range(-1e4, 1e4, 'm')]
    y_m: Annotated[float, Range(-1e4, 1e4, 'm')]
    yaw_rad: Annotated[float, Range(-10.0, 10.0, 'rad')]
    speed_mps: Annotated[float, Range(0.0, 80.0, 'm/s')]


@dataclass(frozen=True)
class StopParams:
    """When a run ends: a line that is crossed in the direction yaw_rad, or too late."""

    x_m: Annotated[float, Range(-1e4, 1e4, 'm')]
    y_m: Annotated[float, Range(-1e4, 1e4, 'm')]
    yaw_rad: Annotated[float, Range(-10.0, 10.0, 'rad')]
    armed_after_m: Annotated[float, Range(0.0, 1e5, 'm')]
    time_s: Annotated[float, Range(0.05, 1e5, 's')]


@dataclass(frozen=True)
class PatchParams:
    """Where the road has another friction: see `road`."""

    corners_m: Annotated[tuple[float, ...], Range(-1e5, 1e5, 'm')]
    friction: Annotated[tuple[float, ...], Range(0.05, 2.0, '-')]


@dataclass(frozen=True)
class NodeParams:
    """The plant as a node: config/bmw_545i.yaml."""

    friction: Annotated[float, Range(0.05, 2.0, '-')]
    patches: PatchParams
    tyre_set: str
    imu_wheels_period_ms: Annotated[int, Range(1, 50, 'ms')]
    command_age_s: Annotated[float, Range(0.05, 1.0, 's')]
    lockstep_timeout_s: Annotated[float, Range(0.1, 3600.0, 's')]
    start: StartParams
    stop: StopParams
    car: Car


def config(name: str) -> Path:
    """Return the path of a file: in config/, or, with a folder in its name, anywhere.

    Raises ParameterError when there is none.
    """
    try:
        path = Path(name) if os.sep in name else share.path('vehicle_plant', 'config', name)
    except FileNotFoundError as error:
        raise ParameterError(f'{name}: {error}') from None
    if not path.is_file():
        raise ParameterError(f'{name}: there is no such file')
    return path


def tyre(name: str) -> TyreSet:
    """Read a tyre from a .tir or YAML file found by `config`. Raises ParameterError."""
    path = config(name)
    return tir.load(path) if path.suffix.lower() == '.tir' else parameters.load(TyreSet, path)


def plant(node: NodeParams) -> PlantParams:
    """Return the car with the tyre that it names. Raises ParameterError."""
    return PlantParams(node.car, tyre(node.tyre_set))


def load(path: Path | None = None) -> PlantParams:
    """Read car and tyre, those of config/bmw_545i.yaml unless told otherwise."""
    return plant(parameters.load(NodeParams, path or config(DEFAULT_CAR)))
