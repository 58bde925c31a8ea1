"""Which column of a log is which signal, in which unit; and what is known of the car: a YAML file.

    like: car.yaml             # car file with what is not given here: actuators, outline, drag
    steering_ratio: 17         # from steering wheel to road wheel; 1: the log has the road wheel
    signals:
      time: {column: time, unit: s}          # or rate_hz: 100 beside `like`
      steer: {column: SteerAng, unit: deg}
      vx: {column: speed, unit: km/h}
      sideslip: {column: slip, unit: deg}    # or vy
      yaw_rate: {column: YawRate, unit: deg/s, sign: -1}
      ay: {column: ay, unit: g}              # ax and ay may be missing
    sensor: {ahead_m: -0.7, left_m: 0.8}     # where vx and vy are measured, from the CoG
    car: {mass_kg: 1355, yaw_inertia_kgm2: 2380, cog_to_front_m: 1.046, cog_to_rear_m: 1.504,
          cog_height_m: 0.51}

Axes of ISO 8855: left, turning left and accelerating are positive; `sign: -1` turns a signal. A map
of a bag has no signals.
"""

from pathlib import Path
from typing import Annotated, Any, NamedTuple

import numpy as np

from bags.errors import BagError
from mpcc_controller.parameters import CarParams
from msgs_yaml.strict_yaml import YamlError, read
from node_runtime import node_parameters, parameters
from node_runtime.parameters import Choice, Range, Struct

GROUPS = ('car', 'actuators', 'outline')  # of the car, which no log tells
UNTOLD = ('mass_kg', 'yaw_inertia_kgm2', 'cog_to_front_m', 'cog_to_rear_m')  # nor does a car file
HHMMSS = 'hhmmss'  # of VBO files: a number whose digits are hours, minutes and seconds
SI = dict.fromkeys(('s', HHMMSS, 'm/s', 'rad', 'rad/s', 'm/s^2'), 1.0)
SI |= {'ms': 1e-3, 'us': 1e-6, 'ns': 1e-9, 'km/h': 1 / 3.6, 'mph': 0.44704, 'g': 9.80665}
SI |= dict.fromkeys(('deg', 'deg/s'), np.pi / 180)


def _signal(*units: str) -> type:
    class Signal(Struct):
        """A column; without its name the log lacks the signal."""

        column: str | None
        unit: Annotated[str, Choice(*units)] | None
        sign: Annotated[int, Range(-1, 1, '-')] | None

    return Signal


class Signals(Struct):
    """The signals of a log."""

    time: _signal('s', 'ms', 'us', 'ns', HHMMSS)  # type: ignore[valid-type]
    steer: _signal('rad', 'deg')  # type: ignore[valid-type]
    vx: _signal('m/s', 'km/h', 'mph')  # type: ignore[valid-type]
    vy: _signal('m/s', 'km/h', 'mph')  # type: ignore[valid-type]
    sideslip: _signal('rad', 'deg')  # type: ignore[valid-type]
    yaw_rate: _signal('rad/s', 'deg/s')  # type: ignore[valid-type]
    ax: _signal('m/s^2', 'g')  # type: ignore[valid-type]
    ay: _signal('m/s^2', 'g')  # type: ignore[valid-type]


class Sensor(Struct):
    """Where speeds are measured, from the CoG; at the CoG where left out."""

    ahead_m: Annotated[float, Range(-5.0, 5.0, 'm')] | None
    left_m: Annotated[float, Range(-3.0, 3.0, 'm')] | None


class Columns(Struct):
    """All of a map but the car."""

    like: str | None
    rate_hz: Annotated[float, Range(10.0, 10e3, 'different rows a second, without time')] | None
    steering_ratio: Annotated[float, Range(0.5, 40.0, '-')] | None
    signals: Signals
    sensor: Sensor


class LogMap(NamedTuple):
    """A map, and the car as far as it is known: its tyres are those of the file `like`."""

    columns: Columns
    car: CarParams


def load(path: Path) -> LogMap:
    """Read a map. Raises BagError that names the file and the parameter."""
    try:
        given: dict[str, Any] = read(path).value()
        if not isinstance(given, dict):
            raise BagError(f'{path}: must be a map, as of the manual')
        own = {name: given.pop(name, None) or {} for name in GROUPS}
        columns = parameters.build(Columns, given, path)
        for name in UNTOLD:
            if name not in own['car']:
                raise BagError(f'{path}: car.{name}: is missing; no log tells it')
        file = node_parameters.find_config('mpcc_controller', columns.like or 'car.yaml', 'like')
        values = parameters.read_file(file).values | parameters.flatten_mapping(own)
        car = parameters.build(CarParams, values, path)
    except (YamlError, parameters.ParameterError, AttributeError) as error:
        raise BagError(str(error)) from None
    for name in Signals.__dataclass_fields__:
        signal = getattr(columns.signals, name)
        if signal.column and not signal.unit:
            raise BagError(f'{path}: signals.{name}.unit: is missing')
    return LogMap(columns, car)
