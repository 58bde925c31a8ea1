"""Parameters of the plant node, and the files of cars and tyres."""

import importlib.util
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Annotated

from node_runtime import node_parameters, parameters
from node_runtime.node_parameters import NO_SOURCES
from node_runtime.parameter_docs import GroupDoc, ParameterDoc
from node_runtime.parameters import Choice, ParameterError, Range, Struct
from vehicle_plant import tyre_property_file
from vehicle_plant.car import Car, FaultParams, MultiBodyParams, PlantParams, add_delay
from vehicle_plant.sensors import SensorParams
from vehicle_plant.tyre_coefficients import TyreCoefficients

DEFAULT_CAR = 'bmw_545i.yaml'
# parameters that no other file has
CAR_KEY, TYRE_KEY, SENSORS_KEY = 'tyre_set', 'reference.FNOMIN', 'receiver.outage'
_find = partial(node_parameters.find_named_config, 'vehicle_plant')
DOUBLE_TRACK, MULTI_BODY = 'double_track', 'commonroad_multi_body'  # models
# the multi-body model is one car, which this file describes; parts of `car` that change with it
MULTI_BODY_CAR = 'commonroad_320i.yaml'
_WITH_EVERY_MODEL = (
    *('outline.', 'steering.', 'force.', 'gate.', 'safe_stop.'),
    *(f'scaling.{axle}.{factor}' for axle in ('front', 'rear') for factor in ('LMUX', 'LMUY')),
)
_MOST_STEERING = {'limit_rad': 1.066, 'rate_radps': 0.4}  # of the multi-body model
# of plant_node, beside those of its file; `from` is no name for a field
_START_FROM = (
    'where the car starts: at the first pose of the path at its speed there, or as the other '
    '`start.` parameters say; `experiments run` sets parameters'
)
EXTRAS = GroupDoc(
    '',
    'Of plant_node, not in a file of a car.',
    tuple(
        ParameterDoc(name, 'text', '-', None, None, words, default, False, meaning)
        for name, words, default, meaning in (
            ('plant_params', (), DEFAULT_CAR, 'file of the car: in config/, or a path'),
            ('start.from', ('reference', 'parameters'), 'reference', _START_FROM),
        )
    ),
)


class StartParams(Struct):
    """Initial pose and velocity of the car, and whether it slides sideways or turns."""

    x_m: Annotated[float, Range(-1e4, 1e4, 'm')]  # of the CoG in the map
    y_m: Annotated[float, Range(-1e4, 1e4, 'm')]  # of the CoG in the map
    yaw_rad: Annotated[float, Range(-10.0, 10.0, 'rad')]  # heading
    # 0: at standstill
    speed_mps: Annotated[float, parameters.START_SPEED]
    # left out: 0
    lateral_mps: Annotated[float, parameters.LATERAL_SPEED] | None
    yaw_rate_radps: Annotated[float, parameters.YAW_RATE] | None  # left out: 0


class StopParams(Struct):
    """End of a run: finish line, crossed in the direction yaw_rad, or time limit."""

    x_m: Annotated[float, Range(-1e4, 1e4, 'm')]  # a point of the finish line
    y_m: Annotated[float, Range(-1e4, 1e4, 'm')]  # a point of the finish line
    yaw_rad: Annotated[float, Range(-10.0, 10.0, 'rad')]  # direction in which it is crossed
    armed_after_m: Annotated[float, Range(0.0, 1e5, 'm')]
    time_s: Annotated[float, parameters.RUN_TIME]
    # a car that has moved and stands for so long ends the run; left out: 1 s
    standstill_s: Annotated[float, parameters.RUN_TIME] | None


class FrictionPatchParams(Struct):
    """Areas of another friction, see `road_friction`."""

    corners_m: Annotated[tuple[float, ...], Range(-1e5, 1e5, 'm')]
    friction: Annotated[tuple[float, ...], parameters.ROAD_FRICTION]


class NodeParams(Struct):
    """Parameters of plant_node: config/bmw_545i.yaml."""

    # left out: double_track
    model: Annotated[str, Choice(DOUBLE_TRACK, MULTI_BODY)] | None
    friction: Annotated[float, parameters.ROAD_FRICTION]
    patches: FrictionPatchParams
    tyre_set: str
    # left out: 0. Beside the delay of each servo
    command_delay_ms: Annotated[int, Range(0, 200, 'ms, from a command to the servos')] | None
    faults: FaultParams
    # left out: true. Whether to send /tf and /tf_static, where tf2_msgs is installed
    publish_tf: bool | None
    imu_wheels_period_ms: Annotated[int, Range(1, 50, 'ms')]
    # file of what the car senses, as sensors_automotive.yaml; left out: no sensors, truth alone
    sensors: str | None
    sensors_seed: Annotated[int, Range(0, 2**31 - 1, 'of their errors')] | None  # left out: 0
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
    return _find(named_by, name, CAR_KEY)


def load_tyre(
    name: str, named_by: str = 'tyre_set', sources: Mapping[str, str] = NO_SOURCES
) -> TyreCoefficients:
    """Read the tyre that a parameter or option names, a .tir or YAML file; ParameterError.

    `sources` gives the origin of parameters, for errors.
    """
    path = _find(named_by, name, TYRE_KEY, sources)
    if path.suffix.lower() == '.tir':
        return tyre_property_file.load(path)
    return parameters.load(TyreCoefficients, path)


def load_sensors(node: NodeParams, sources: Mapping[str, str] = NO_SOURCES) -> SensorParams | None:
    """Return the errors of the sensors that the parameters name, None without. ParameterError."""
    if node.sensors is None:
        return None
    return parameters.load(SensorParams, _find('sensors', node.sensors, SENSORS_KEY, sources))


def plant_params(node: NodeParams, sources: Mapping[str, str] = NO_SOURCES) -> PlantParams:
    """Return the car with the tyre that it names; the delay of commands is in that of its servos.

    `sources` gives the origin of parameters, for errors. Raises ParameterError.
    """
    load_sensors(node, sources)  # what is wrong with their file is found as early
    begin, end = node.faults.from_s or 0.0, node.faults.until_s
    if end is not None and end <= begin:
        allowed = f'allowed more than faults.from_s, {begin:g} s'
        raise ParameterError(f'faults.until_s: is {end:g} s; {allowed}')
    tyre = load_tyre(node.tyre_set, sources=sources)
    car = add_delay(node.car, node.command_delay_ms or 0)
    if node.model != MULTI_BODY:
        return PlantParams(car, tyre)
    for name, fault in _multi_body_faults(node):
        raise ParameterError(
            f'{sources[name]}: {name}: {fault}' if name in sources else f'{name}: {fault}'
        )
    return MultiBodyParams(car, tyre)


def _multi_body_faults(node):
    """Yield (name, fault): the package of the model is missing, or what does not change it."""
    if importlib.util.find_spec('vehiclemodels') is None:
        yield (
            'model',
            f'{MULTI_BODY} needs the package commonroad-vehicle-models, which is not installed: '
            "pip install 'vehicle_plant[commonroad]'",
        )
    own = parameters.load(NodeParams, config_file(MULTI_BODY_CAR))
    allowed = parameters.flatten(own.car)
    for name, value in parameters.flatten(node.car).items():
        if value != allowed[name] and not name.startswith(_WITH_EVERY_MODEL):
            fault = f'it does not change {MULTI_BODY}, allowed {allowed[name]!r}'
            yield f'car.{name}', f'is {value!r}; {fault}'
    if node.tyre_set != own.tyre_set:
        yield 'tyre_set', f'does not change {MULTI_BODY}, allowed {own.tyre_set!r}'
    for name, most in _MOST_STEERING.items():
        value = getattr(node.car.steering, name)
        if value > most:
            yield f'car.steering.{name}', f'is {value!r}; {MULTI_BODY} allows at most {most!r}'


def load(path: Path | None = None) -> PlantParams:
    """Read car and tyre from a parameter file of the node, by default config/bmw_545i.yaml."""
    return plant_params(parameters.load(NodeParams, path or config_file(DEFAULT_CAR)))
