"""Plants with other parameters, and drives of them, for the tests of the plant."""

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from itertools import pairwise
from typing import Any

import numpy as np

from msgs_yaml.types import Command
from node_runtime import parameters as yaml_parameters
from vehicle_plant import circular_driving, integrator, manoeuvres, parameters
from vehicle_plant.circular_driving import CircleParams
from vehicle_plant.initial_state import Start
from vehicle_plant.manoeuvres import Case, Driven
from vehicle_plant.parameters import PlantParams
from vehicle_plant.simulator import TICK_STEPS, Simulator
from vehicle_plant.state import Trajectory, join_trajectories

OPEN_GATE = {'friction_use': 10.0, 'steer_rate_radps': 100.0, 'force_rate_nps': 1e7}


def altered(record: Any, **changes: Any) -> Any:
    """Return a dataclass with other values; a name leads into its parts by `__`."""
    for name, value in changes.items():
        first, _, rest = name.partition('__')
        if rest:
            value = altered(getattr(record, first), **{rest: value})
        record = replace(record, **{first: value})
    return record


@cache
def load(car: str = parameters.DEFAULT_CAR) -> PlantParams:
    """Return a car of config/ by the name of its file."""
    return parameters.load(parameters.config_file(car))


def ahead(speed: float) -> Start:
    """Return the start of a car that rolls straight ahead."""
    return Start(0.0, 0.0, 0.0, speed)


def drive(
    law: Callable[[float, Simulator], tuple[float, float, float]],
    seconds: float,
    start: Start | float = 20.0,
    plant: PlantParams | None = None,
    friction: float = 1.0,
    patches: np.ndarray | None = None,
) -> Trajectory:
    """Return the drive of a law(t, car) -> (delta, Fxf, Fxr); `start` may be a speed.

    Wheels may be locked on purpose: the gate lets everything through that the actuators can do.
    """
    plant = plant or load()
    plant = altered(plant, car__gate=replace(plant.car.gate, **OPEN_GATE))
    start = start if isinstance(start, Start) else ahead(start)
    car = Simulator(plant, friction, start, patches=patches)
    tracks = []
    for tick in range(round(seconds * 20)):
        delta, Fxf, Fxr = law(tick / 20, car)
        tracks.append(car.advance(Command(car.stamp_ns, delta, 0.0, Fxf, Fxr), TICK_STEPS))
    assert car.gate.rejected == 0, car.gate.last_reason
    return join_trajectories(tracks)


@cache
def perform(name: str, friction: float = 1.0, car: str = parameters.DEFAULT_CAR) -> Driven:
    """Return a manoeuvre of a car, driven once per session."""
    return manoeuvres.perform(name, Case(load(car), friction, manoeuvres.load_settings()))


def circle_params(**changes: Any) -> CircleParams:
    """Return config/identify.yaml with other values."""
    path = parameters.config_file('identify.yaml')
    return replace(yaml_parameters.load(CircleParams, path), **changes)


@cache
def circle(car: str = parameters.DEFAULT_CAR, friction: float = 1.0, **changes: Any) -> Trajectory:
    """Return the circular driving of a car, driven once per session."""
    return circular_driving.drive(load(car), friction, circle_params(**changes))


def advance_interpreted(x, set_points, p, patches=None, model=integrator.DOUBLE_TRACK):
    """Return the last state and the rows of `integrator.advance`, without compiled code."""
    derivative, projection = integrator.plant_functions(model)
    h, rows = integrator.STEP_S, []

    def local(x):
        return p if patches is None else integrator.with_local_friction(x, p, patches, model)

    for begin, end in pairwise(set_points):
        middle, here = (begin + end) * 0.5, local(x)
        k1 = derivative(x, begin, here)[0]
        k2 = derivative(x + h * 0.5 * k1, middle, here)[0]
        k3 = derivative(x + h * 0.5 * k2, middle, here)[0]
        k4 = derivative(x + h * k3, end, here)[0]
        x = np.asarray(projection(x + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4), here)).ravel()
        rows.append(integrator.row(x, end, local(x), model))
    return x, np.array(rows)
