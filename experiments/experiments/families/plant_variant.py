"""Plants with another balance, their steady lateral limits, and the cars identified on them.

What is identified is kept beside the compiled solvers, under the digest of the plant's parameters
and of the code that decides it.
"""

import re
from collections.abc import Mapping
from functools import cache
from typing import Any, NamedTuple

from experiments import code_version, plant_limit, simulation
from experiments.configuration.node_config import PLANT_DEFAULTS
from node_runtime import parameters
from vehicle_plant import identify
from vehicle_plant import parameters as plant_parameters
from vehicle_plant.circular_driving import CircleError, CircleParams
from vehicle_plant.parameters import PlantParams

ANY_DRIVE = ('straight', 'mpcc')  # scenario and controller, where the plant alone matters
ROOTS = ('vehicle_plant.identify', __name__)
LAGS = re.compile(r'\b(steer_lag_s|force_lag_s): ([0-9.]+)')


class Variant(NamedTuple):
    """The values that choose a plant, and what its controllers know of the latency."""

    car: str  # file in config/ of vehicle_plant
    rear_cornering: float  # cornering stiffness of the rear axle, over the car's own
    roll_share: float  # of the front axle in the roll stiffness
    known_latency_s: float = 0.0  # added to the lags of the car file


class Plant(NamedTuple):
    """What a task needs to know of its plant."""

    settings: Mapping[str, Any]  # parameters of the plant by dotted name
    car_file: str  # of the controller
    limit: float  # m/s^2, that it holds in a steady turn on friction 1


@cache
def build(variant: Variant) -> Plant:
    """Return a plant with its limit and the car file identified on it, from the cache or new.

    Raises CircleError and RefusedError for a car that cannot drive the manoeuvres.
    """
    settings = plant_settings(variant)
    plant = _load(settings)
    limit = plant_limit.held_lateral_limit(plant, 1.0)
    if limit is None:
        raise CircleError(f'{variant.car}: its front axle does not slide in a circle')

    def find():
        manoeuvre = plant_parameters.config_file(plant_limit.MANOEUVRE)
        circle = parameters.load(CircleParams, manoeuvre)
        text, _ = identify.identify(plant, 1.0, circle, ' (a plant of a study)')
        return LAGS.sub(lambda lag: f'{lag[1]}: {float(lag[2]) + later_s:.4f}', text)

    later_s = variant.known_latency_s
    content = repr((identify.digest(plant), code_version.digest(ROOTS), later_s))
    return Plant(settings, str(plant_limit.kept_text('plants/{}.yaml', content, find)), limit)


def plant_settings(variant: Variant) -> dict[str, Any]:
    """Return the parameters of the plant node by dotted name.

    The rear cornering stiffness is scaled, and the anti-roll bars are changed so that the front
    axle has the share of an unchanged roll stiffness: a roll angle phi moves either wheel of an
    axle by phi t / 2 and both against each other by phi t, so the stiffness of an axle is
    t^2 (ride rate / 2 + anti-roll rate). Raises ValueError for a share that its springs exceed.
    """
    car = _load({PLANT_DEFAULTS: variant.car}).car
    axles = {'front': car.suspension.front, 'rear': car.suspension.rear}
    total = sum(
        axle.track_m**2 * (axle.ride_rate_npm / 2 + axle.antiroll_npm) for axle in axles.values()
    )
    bars = {}
    for (name, axle), share in zip(axles.items(), (variant.roll_share, 1.0 - variant.roll_share)):
        bars[name] = share * total / axle.track_m**2 - axle.ride_rate_npm / 2
        if bars[name] < 0.0:
            raise ValueError(
                f'roll_share: is {variant.roll_share:g}; the springs of the {name} axle of '
                f'{variant.car} alone are stiffer than that'
            )
    return {
        PLANT_DEFAULTS: variant.car,
        'car.scaling.rear.LKY': variant.rear_cornering * car.scaling.rear.LKY,
        **{f'car.suspension.{name}.antiroll_npm': bar for name, bar in bars.items()},
    }


def _load(settings) -> PlantParams:
    return simulation.prepare(*ANY_DRIVE, {'plant': settings}, any_car=True).plant
