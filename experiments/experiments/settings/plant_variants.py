"""Plants of the study, their steady lateral limits, and the car files identified on them.

Everything is computed once per machine and kept beside the compiled solvers, under the digest of
the plant's parameters and of the code that decides them.
"""

import dataclasses
import hashlib
import json
import os
import tempfile
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

from experiments import code_version, plant_limit
from experiments.configuration import node_config
from node_runtime import parameters
from stage_solver import compile_cache
from vehicle_plant import identify
from vehicle_plant import parameters as plant_parameters
from vehicle_plant.car import MultiBodyParams
from vehicle_plant.circular_driving import CircleError, CircleParams
from vehicle_plant.parameters import PlantParams

ROOTS = ('vehicle_plant.identify',)


class Variant(NamedTuple):
    """The drawn values that choose a plant."""

    car: str  # file in config/ of vehicle_plant, or a path
    rear_cornering: float  # over the car's own
    roll_share: float  # of the front axle in the roll stiffness


class Plant(NamedTuple):
    """What a setting needs to know of its plant."""

    settings: Mapping[str, Any]  # parameters of the plant by dotted name
    car_file: str  # of the controller
    limit: float  # m/s^2, peak lateral acceleration of quasi-steady circular driving
    front: float  # m, from the centre of gravity to the front end
    rear: float  # m, to the rear end
    width: float  # m

    def __repr__(self) -> str:
        return f'Plant({dict(self.settings)}, limit={self.limit:.2f} m/s^2)'


def variant_of(values: Mapping[str, Any]) -> Variant:
    """Return the plant that drawn values choose."""
    return Variant(*(values[name] for name in Variant._fields))


def plant_settings(variant: Variant) -> dict[str, Any]:
    """Return the parameters of the plant node by dotted name.

    The rear cornering stiffness is scaled, and the anti-roll bars are changed so that the front
    axle has the share of an unchanged roll stiffness. The multi-body model has neither: what is
    drawn for them has no effect on it. A roll angle phi moves either wheel of an
    axle by phi t / 2 and both against each other by phi t, so the stiffness of an axle is
    t^2 (ride rate / 2 + anti-roll rate). Raises ValueError for a share that its springs exceed.
    """
    plant = _load(variant.car)
    if isinstance(plant, MultiBodyParams):
        return {node_config.PLANT_DEFAULTS: variant.car}
    car = plant.car
    axles = {'front': car.suspension.front, 'rear': car.suspension.rear}
    total = sum(_roll_stiffness(axle) for axle in axles.values())
    shares = {'front': variant.roll_share, 'rear': 1.0 - variant.roll_share}
    bars = {}
    for name, axle in axles.items():
        bars[name] = shares[name] * total / axle.track_m**2 - axle.ride_rate_npm / 2
        if bars[name] < 0.0:
            raise ValueError(
                f'roll_share: is {variant.roll_share:g}; the springs of the {name} axle of '
                f'{variant.car} alone are stiffer than that'
            )
    return {
        node_config.PLANT_DEFAULTS: variant.car,
        'car.scaling.rear.LKY': variant.rear_cornering * car.scaling.rear.LKY,
        **{f'car.suspension.{name}.antiroll_npm': bar for name, bar in bars.items()},
    }


def _roll_stiffness(axle):
    return axle.track_m**2 * (axle.ride_rate_npm / 2 + axle.antiroll_npm)


@cache
def _load(car: str) -> PlantParams:
    return plant_parameters.load(plant_parameters.car_file(car))


@cache
def digest(car: str) -> str:
    """Return the SHA-256 of every parameter of a plant's file, tyre included."""
    return identify.digest(_load(car))


@cache
def build(variant: Variant) -> Plant:
    """Return a plant with its limit and the car file identified on it, from the cache or new.

    Raises CircleError and RefusedError for a car that cannot drive the manoeuvres.
    """
    settings = plant_settings(variant)
    plant = _with_settings(_load(variant.car), settings)
    car_file = _car_file(plant)
    limit = plant_limit.held_lateral_limit(plant, 1.0)
    if limit is None:
        raise CircleError(f'{variant.car}: its front axle does not slide in a circle')
    body, outline = plant.car.body, plant.car.outline
    return Plant(
        settings,
        str(car_file),
        limit,
        body.cog_to_front_m + outline.front_overhang_m,
        body.cog_to_rear_m + outline.rear_overhang_m,
        outline.width_m,
    )


def _with_settings(plant, settings):
    if isinstance(plant, MultiBodyParams):
        return plant
    car = plant.car
    suspension = car.suspension
    for name in ('front', 'rear'):
        bar = settings[f'car.suspension.{name}.antiroll_npm']
        axle = dataclasses.replace(getattr(suspension, name), antiroll_npm=bar)
        suspension = dataclasses.replace(suspension, **{name: axle})
    rear = dataclasses.replace(car.scaling.rear, LKY=settings['car.scaling.rear.LKY'])
    scaling = dataclasses.replace(car.scaling, rear=rear)
    car = dataclasses.replace(car, suspension=suspension, scaling=scaling)
    return dataclasses.replace(plant, car=car)


def _car_file(plant: PlantParams) -> Path:
    """Return the car file that was identified on a plant, from the cache or new."""
    folder = compile_cache.cache_dir() / 'plants'
    content = [identify.digest(plant), code_version.digest(ROOTS)]
    file = folder / f'{hashlib.sha256(json.dumps(content).encode()).hexdigest()[:32]}.yaml'
    if not file.is_file():
        circle = parameters.load(CircleParams, plant_parameters.config_file('identify.yaml'))
        text, _ = identify.identify(plant, 1.0, circle, ' (a plant of the study over settings)')
        folder.mkdir(parents=True, exist_ok=True)
        # written whole or not at all, also when another process writes the same file
        with tempfile.NamedTemporaryFile('w', dir=folder, suffix='.part', delete=False) as part:
            part.write(text)
        os.replace(part.name, file)
    return file
