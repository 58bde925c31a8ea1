"""The inputs of a run, read as the nodes will read them and checked before any node starts.

Loads no solver, and the controller's model only in `check_problem`: a mistake in the input is
reported at once.
"""

import traceback
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import yaml

from bags.errors import BagError
from bags.storage.message_filing import RecorderParams
from experiments.configuration import node_config
from experiments.configuration.node_config import NO_OVERRIDES, Controller, LoadedFacts, Node
from mpcc_controller import car_file
from mpcc_controller.parameters import CarParams, ControllerParams
from node_runtime import node_parameters, parameters
from scenario_publisher import scenario
from scenario_publisher.scenario import NodeParams as ScenarioParams
from scenario_publisher.scenario import Scenario
from state_estimator.parameters import EstimatorParams
from vehicle_plant import parameters as plant_parameters
from vehicle_plant.car import actuator_limits
from vehicle_plant.parameters import NodeParams, PlantParams, StopParams

CONTROLLER, ESTIMATOR = 'controller', 'estimator'  # roles
# where a controller has its state from in a ring with an estimator
ESTIMATED = 'vehicle/odometry:=estimator/odometry'
KPH = 3.6  # km/h per m/s
# of the plant, those of a start in a scenario, in their order
START = ('x_m', 'y_m', 'yaw_rad', 'speed_mps', 'lateral_mps', 'yaw_rate_radps')
# the scenario key that sets a parameter, or the parameters below a name; for error messages
SCENARIO_KEYS = {
    'controller': {'model.friction': 'friction'},
    'plant': {
        'friction': 'friction',
        'start': 'start',
        'stop': 'stop',
        'patches': 'friction_patches',
    },
}
# parameter class of each role, and the loader of the file that the parameters name
LOADERS = {
    'recorder': (RecorderParams, None),
    'scenario': (ScenarioParams, None),
    'controller': (ControllerParams, car_file.load),
    'plant': (NodeParams, plant_parameters.plant_params),
    ESTIMATOR: (EstimatorParams, None),
}
# parameters that the plant declares besides those of its class
PLANT_EXTRAS = {
    doc.name: parameters.Leaf(str, False, parameters.Choice(*doc.words) if doc.words else None)
    for doc in plant_parameters.EXTRAS.parameters
}
OTHER_AXLE = 0.5  # from this difference on the controller drives the other axle
# of masses and lengths, relative to the plant; a file of `identify` has those of the plant exactly
TOLERANCE = 0.05
VARIED_TOLERANCE = 0.2  # of a plant that is varied on purpose
PLANT_CAR = 'car.'  # begins the parameters of the plant's car
# set one by one, these make a car that is meant to differ from what the controller knows
VARIED = tuple(f'{PLANT_CAR}body.{name}' for name in ('mass_kg', 'cog_to_front_m', 'cog_to_rear_m'))


def stop_params(scn: Scenario) -> StopParams:
    """Return the finish line and time limit of a scenario as parameters of the plant."""
    return StopParams(*scn.stop)  # in the same order and units


def load_scenario(name_or_path: str, **changes: Any) -> Scenario:
    """Return a scenario, changed as by `change_scenario`. Raises BagError."""
    return change_scenario(scenario.load(name_or_path), name_or_path, **changes)


def change_scenario(
    scn: Scenario,
    source: str,
    speed_mps: float | None = None,
    friction: float | None = None,
    predictions: str | None = None,
) -> Scenario:
    """Return a scenario, where given at another constant desired speed, friction, or predictions.

    `source` names it in errors. Raises BagError.
    """
    if speed_mps is None and friction is None and predictions is None:
        return scn
    document = yaml.safe_load(scn.text)
    if speed_mps is not None:
        document['speed'] = {'constant_mps': float(speed_mps)}
        source += f' at {speed_mps:.2f} m/s'
    if friction is not None:
        document['friction'] = float(friction)
        source += f' at friction {friction:.2f}'
    if predictions is not None:
        document['predictions'] = predictions
    return scenario.parse(yaml.safe_dump(document), source)


def build_nodes(
    scn: Scenario,
    source: str,
    controller: Controller,
    overrides: Mapping[str, Mapping[str, Any]] = NO_OVERRIDES,
    origins: Mapping[str, Mapping[str, str]] = NO_OVERRIDES,
    mode: str = 'lockstep',
    record: bool = True,
    plant_program: tuple[str, ...] = (),
) -> list[Node]:
    """Return the nodes of a run in starting order; `overrides` are parameters by role.

    source         name or path of the scenario, as scenario_node takes it
    origins        sources of overrides, by role and name, for errors; without one it is `--set`
    record         whether there is a recorder, which `record_to` tells where; else no node waits
                   for one
    plant_program  command that is started in place of plant_node, with its parameters

    A car with sensors has an estimator before the plant, and the controller has its state from it.
    Raises BagError for parameters of a controller that is a program, and of an estimator that there
    is not.
    """
    # of a start that does not slide, the first ones
    start = zip(START, scn.start if any(scn.start[4:]) else scn.start[:4])
    stop = parameters.flatten(stop_params(scn))
    plant = {
        'friction': scn.friction,
        'start.from': 'parameters',
        **{f'start.{name}': value for name, value in start},
        **{f'stop.{name}': value for name, value in stop.items() if value is not None},
        **{f'patches.{name}': [*v] for name, v in scn.patches._asdict().items() if v},
    }

    def node(role, own):
        """Return a node with its own parameters, over which those that are given win."""
        given = overrides.get(role, {})
        # the run starts when the recorder listens; the recorder does not wait for itself
        common = {'mode': mode, 'recorders': int(record and role != 'recorder')}
        program = {CONTROLLER: controller.program, 'plant': plant_program}.get(role, ())
        keys = SCENARIO_KEYS.get(role, {})
        by_name = {name: keys.get(name) or keys.get(name.partition('.')[0]) for name in own}
        sources = {
            **{name: f'scenario {source}: {key}' for name, key in by_name.items() if key},
            **{name: f'--set {role}.{name}' for name in given},
            **origins.get(role, {}),
        }
        files = (controller.config,) if role == CONTROLLER and not program else ()
        executable = Path(program[-1]).name if program else f'{role}_node'
        package, _ = node_config.DEFAULTS[role]
        return Node(role, package, executable, files, {**common, **own, **given}, sources, program)

    for name in overrides.get(CONTROLLER, ()) if controller.program else ():
        raise BagError(
            f'--set controller.{name}: the controller {controller.name} is a program, which has '
            'its parameters from elsewhere'
        )
    others = [*([node('recorder', {})] if record else []), node('scenario', {'scenario': source})]
    driver, car = node(CONTROLLER, {'model.friction': scn.friction}), node('plant', plant)
    known = _estimator_values(driver, car, scn, overrides.get(ESTIMATOR, ()))
    if known is None:
        return [*others, driver, car]
    return [*others, driver._replace(remappings=(ESTIMATED,)), node(ESTIMATOR, known), car]


def _estimator_values(controller, plant, scn, given):
    """Return the parameters of the estimator of a car with sensors, None where there is none."""
    try:
        has_sensors = node_config.all_values(plant).get('sensors') is not None
    except (parameters.ParameterError, OSError):
        return None  # `check_parameters` says what is wrong
    if not has_sensors:
        for name in given:
            # what a file gives to every node may be there
            if name not in node_parameters.MANAGED and not name.startswith(node_parameters.OF_ROS):
                raise BagError(f'estimator.{name} has no effect without plant.sensors')
        return None
    # imported late: filters take a while to load
    from experiments import estimation

    (params, own), (node, car) = _load(controller), _load(plant)
    common = {name: plant.parameters[name] for name in ('mode', 'recorders')}
    sensors, vehicle = plant_parameters.load_sensors(node), estimation.vehicle(own, car.car)
    known = estimation.known_values(sensors, params.model.friction, vehicle)
    return {**common, **known, 'yaw_rad': scn.start.psi}


def record_to(nodes: Sequence[Node], bag: Path, run_info: Path) -> list[Node]:
    """Return nodes whose recorder makes the folder `bag` and has the file of run information."""
    places = {'out': str(bag), 'run_info': str(run_info)}
    return [
        node._replace(parameters=node.parameters | places) if node.role == 'recorder' else node
        for node in nodes
    ]


def build_mpcc_nodes(
    road: str, mode: str, folder: Path, overrides: Mapping[str, Mapping[str, Any]]
) -> list[Node]:
    """Return the nodes of a run of `mpcc`, recorded to `folder`/bag without run information.

    `road` is the name or file of a scenario. Raises BagError.
    """
    run_info = folder / node_config.RUN_INFO_FILE
    run_info.write_text('{}')
    mpcc = node_config.find_controller('mpcc')
    nodes = build_nodes(load_scenario(road), road, mpcc, overrides, mode=mode)
    return record_to(nodes, folder / node_config.BAG_FOLDER, run_info)


def controller_params(name_or_path: str) -> ControllerParams:
    """Return the parameters of a controller as its node takes them. Raises BagError."""
    file = node_config.find_controller(name_or_path).config
    package, _ = node_config.DEFAULTS[CONTROLLER]
    node = Node(CONTROLLER, package, 'controller_node', (file,), {})
    return _load(node)[0]


def check_parameters(nodes: Sequence[Node]) -> dict[str, tuple[Any, Any]]:
    """Load the parameters of scenario, controller, plant and recorder as the nodes will.

    Returns by role the parameters and the contents of the file that they name (car, plant), None
    without one. Raises BagError for what a node refuses, and for a limit of the controller that is
    set beyond the car's ability: it would have no effect.
    """
    checked = {node.role: _load(node) for node in nodes if node.role in LOADERS}
    for node in nodes:
        if node.role == CONTROLLER:
            car_file.check_limits(*checked[CONTROLLER], node.origins)
    return checked


def _load(node):
    """Return the parameters of a node, and those in the file that they name."""
    cls, load = LOADERS[node.role]
    try:
        given, sources = node_config.given_parameters(node), node_config.parameter_sources(node)
        extras = PLANT_EXTRAS if node.role == 'plant' else {}
        for name in extras.keys() & given.keys():
            parameters.check(extras[name], given.pop(name), name, sources.get)
        defaults = node_config.defaults_file(node)
        params, _ = node_parameters.resolve(cls, defaults, given, sources)
        if load is None:
            return params, None
        return params, load(params, parameters.read_file(defaults).sources | sources)
    except (parameters.ParameterError, OSError) as error:
        files = ''.join(f' ({file})' for file in node.files)
        raise BagError(f'the {node.role}{files} would not start: {error}') from None


def file_values(checked: Mapping[str, tuple[Any, Any]]) -> dict[str, dict[str, Any]]:
    """Return {role: {dotted name: value}} of the files that controller and plant name.

    These are the controller's car and the plant's tyre; `checked` is from `check_parameters`.
    """
    return {
        role: parameters.flatten(named.tyre if isinstance(named, PlantParams) else named)
        for role, (_, named) in checked.items()
        if named is not None
    }


def loaded_facts(
    checked: Mapping[str, tuple[Any, Any]], is_shipped_plant: bool = True
) -> LoadedFacts:
    """Return what a run records of the loaded files; `checked` is from `check_parameters`.

    What the plant holds in a steady turn is known of the plants of this system only.
    """
    if not is_shipped_plant:
        return LoadedFacts(file_values(checked))
    # its plant and compiler take time to import: errors in the input come before
    from experiments import plant_limit

    node, plant = checked['plant']
    # on a road with patches no single friction tells what the plant holds
    limit = None if node.patches.friction else plant_limit.held_lateral_limit(plant, node.friction)
    return LoadedFacts(file_values(checked), limit)


def check_problem(checked: Mapping[str, tuple[Any, Any]], file: str = '') -> None:
    """Raise BagError for a problem that the controller cannot build or no solver can use.

    `checked` is from `check_parameters`, `file` is that of the controller. It builds the problem as
    the node will; what is wrong in the source of a cost term or a formulation is found here.
    """
    # its model takes time to import: errors in the input come before
    try:
        from mpcc_controller.driving.prediction_model import PredictionModel

        PredictionModel(*checked[CONTROLLER])
    except Exception as error:
        # an error of the user's source has no other place in its text
        where = ''
        if isinstance(error, SyntaxError):
            where = f'{type(error).__name__} in {error.filename}:{error.lineno}: '
        elif not isinstance(error, parameters.ParameterError | OSError):
            last = traceback.extract_tb(error.__traceback__)[-1]
            where = f'{type(error).__name__} in {last.filename}:{last.lineno}: '
        named = f' ({file})' if file else ''
        raise BagError(f'the controller{named} would not start: {where}{error}') from error


def check_car_fits(
    nodes: Sequence[Node],
    checked: Mapping[str, tuple[Any, Any]],
    setting: str = '--set controller.car_file=./my_car.yaml',
    any_car: str = '--any-car',
) -> None:
    """Raise BagError when the controller's car file is that of another car than the plant is.

    `checked` is from `check_parameters(nodes)`. The message says how to mend it: `setting` is how
    the caller names another file, `any_car` what allows such a run.
    """
    for misfit in describe_misfit(nodes, checked):
        raise BagError(
            f'{misfit}. Write one that does: identify --car PLANT.yaml --out my_car.yaml, then '
            f'{setting} (or drive as it is, with {any_car})'
        )


def describe_misfit(nodes: Sequence[Node], checked: Mapping[str, tuple[Any, Any]]) -> list[str]:
    """Return one line on how the controller's car file differs from the plant, [] if it fits.

    `checked` is from `check_parameters(nodes)`.
    """
    (params, vehicle), (_, plant) = checked[CONTROLLER], checked['plant']
    given = [name for node in nodes if node.role == 'plant' for name in node.parameters]
    reasons = car_mismatches(params, vehicle, plant, any(name in VARIED for name in given))
    if not reasons:
        return []
    return [f'car_file {params.car_file} does not fit the plant: {"; ".join(reasons)}']


def car_mismatches(
    params: ControllerParams, vehicle: CarParams, plant: PlantParams, is_varied: bool = False
) -> tuple[str, ...]:
    """Return what the controller's car file says too wrongly of the plant, () if it fits.

    Mass, axle loads at rest and wheelbase beyond TOLERANCE, or the other driven axle. A plant whose
    parameters are set one by one (`is_varied`) is meant to differ from what the controller knows,
    by up to VARIED_TOLERANCE of its mass and loads. A drive layout that the controller's own
    parameters set is deliberate.
    """
    reasons = []
    for (what, unit, own), (_, _, other) in zip(_sizes(vehicle.car), _sizes(plant.car.body)):
        allowed = VARIED_TOLERANCE if is_varied and unit == 'kg' else TOLERANCE
        if abs(own - other) > allowed * other:
            there = f'the plant has {other:.4g} {unit} (allowed within {allowed:.0%})'
            reasons.append(f'{what} {own:.4g} {unit}, {there}')
    share, driven = (
        vehicle.actuators.drive_front_share,
        actuator_limits(plant.car).drive_front_share,
    )
    if params.model.drive_front_share is None and abs(share - driven) > OTHER_AXLE:
        reasons.append(f'{share:.0%} of the drive at the front axle, the plant has {driven:.0%}')
    return tuple(reasons)


def _sizes(body):
    """Yield name, unit and value of what is compared of a car."""
    wheelbase = body.cog_to_front_m + body.cog_to_rear_m
    front = body.cog_to_rear_m / wheelbase
    yield 'mass', 'kg', body.mass_kg
    yield 'wheelbase', 'm', wheelbase
    yield 'load of the front axle', 'kg', front * body.mass_kg
    yield 'load of the rear axle', 'kg', (1 - front) * body.mass_kg
