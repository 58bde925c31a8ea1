"""Which column of a log is which signal, in which unit; and what is known of the car: a YAML file.

docs/howto/own_car.md has one. Axes are those of ISO 8855: left, turning left and accelerating are
positive; `sign: -1` turns a signal. A map of a bag has no signals.
"""

from dataclasses import make_dataclass
from pathlib import Path
from typing import Annotated, NamedTuple

import numpy as np

from bags.errors import BagError
from mpcc_controller.parameters import CarParams
from msgs_yaml.strict_yaml import EMPTY, Leaf, read
from node_runtime import node_parameters, parameters
from node_runtime.parameters import Choice, Range, Struct

GROUPS = ('car', 'actuators', 'outline')  # of the car, which no log tells
UNTOLD = ('mass_kg', 'yaw_inertia_kgm2', 'cog_to_front_m', 'cog_to_rear_m')  # nor does a car file
HHMMSS = 'hhmmss'  # of VBO files: a number whose digits are hours, minutes and seconds
ANGLE, SPEED = {'rad': 1.0, 'deg': np.pi / 180}, {'m/s': 1.0, 'km/h': 1 / 3.6, 'mph': 0.44704}
ACCELERATION = {'m/s^2': 1.0, 'g': 9.80665}
# of each signal that a log may have its units, and what they are in SI
UNITS = {
    'time': {'s': 1.0, 'ms': 1e-3, 'us': 1e-6, 'ns': 1e-9, HHMMSS: 1.0},
    'steer': ANGLE,
    'vx': SPEED,
    'vy': SPEED,
    'sideslip': ANGLE,
    'yaw_rate': {'rad/s': 1.0, 'deg/s': np.pi / 180},
    'ax': ACCELERATION,
    'ay': ACCELERATION,
}


class Signal(Struct):
    """A column; without its name the log lacks the signal."""

    column: str | None
    unit: str | None  # of UNITS
    sign: Annotated[int, Range(-1, 1, '-')] | None
    late_s: Annotated[float, Range(-0.5, 0.5, 's behind the other signals')] | None


Signals = make_dataclass('Signals', [(name, Signal) for name in UNITS], frozen=True)


class Sensor(Struct):
    """Where speeds are measured, from the CoG; at the CoG where left out."""

    ahead_m: Annotated[float, Range(-5.0, 5.0, 'm')] | None
    left_m: Annotated[float, Range(-3.0, 3.0, 'm')] | None


class Columns(Struct):
    """All of a map but the car."""

    like: str | None
    rate_hz: Annotated[float, Range(10.0, 10e3, 'different rows a second, without time')] | None
    steering_ratio: Annotated[float, Range(0.5, 40.0, '-')] | None
    signals: Signals  # type: ignore[valid-type]
    sensor: Sensor


class LogMap(NamedTuple):
    """A map, and the car as far as it is known: its tyres are those of the file `like`."""

    columns: Columns
    car: CarParams


def load(path: Path) -> LogMap:
    """Read a map. Raises BagError that names the file, the parameter and what is allowed."""
    given = {name: item.value() for name, item in read(path).items().items()}
    own = parameters.flatten_mapping({n: given.pop(n) for n in GROUPS if n in given})
    columns = parameters.build(Columns, given, path)
    file = node_parameters.find_config('mpcc_controller', columns.like or 'car.yaml', 'like')
    like = parameters.read_file(file).values
    for name in UNTOLD:
        like.pop(f'car.{name}', None)
    car = parameters.build(CarParams, like | own, path)
    for name, units in UNITS.items():
        signal = getattr(columns.signals, name)
        fault = Leaf(str, False, Choice(*units)).fault(signal.unit or EMPTY)
        if signal.column and fault:
            raise BagError(f'{path}: signals.{name}.unit: {fault}')
    return LogMap(columns, car)
