"""The closed loop in process, without ROS: the steps of the nodes in lockstep, in their order."""

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np

from bags.errors import BagError
from bags.evaluation.drive import LATERAL_LIMIT, Drive, drive_from_columns
from bags.storage import columns
from bags.storage.columns import Columns
from experiments import plant_limit
from experiments.configuration import inputs, node_config
from experiments.estimation import Estimator
from mpcc_controller.driving.controller import Controller
from mpcc_controller.driving.records import TickInputs, TickRecord
from mpcc_controller.parameters import CarParams, ControllerParams
from msgs_yaml import conversions
from msgs_yaml.conversions import NS_PER_S
from msgs_yaml.types import VehicleState
from node_runtime import parameters, provenance
from scenario_publisher import scenario
from scenario_publisher.scenario import Scenario
from state_estimator.parameters import EstimatorParams
from vehicle_plant import road_friction
from vehicle_plant.car import FaultParams
from vehicle_plant.initial_state import Start
from vehicle_plant.parameters import PlantParams, load_sensors
from vehicle_plant.run_end import RunEnd
from vehicle_plant.sensors import TOPICS, SensorParams, Sensors
from vehicle_plant.simulator import Simulator
from vehicle_plant.state import join_trajectories
from vehicle_plant.stepping import LockstepStepper

# the plant's parameters that a simulation uses; start, end and patches are the scenario's, the
# others concern messages and wall time
PLANT_SETTINGS = (
    'friction',
    'model',
    'tyre_set',
    'command_delay_ms',
    'sensors',
    'sensors_seed',
    node_config.PLANT_DEFAULTS,
)
PLANT_GROUPS = (inputs.PLANT_CAR, 'faults.')
# how a script names another car file, and how it drives with any
IN_PYTHON = ("the setting 'controller.car_file': './my_car.yaml'", 'any_car=True')
SLOW_NS = 10_000_000  # between two messages of /vehicle/imu and /vehicle/wheels


class Setup(NamedTuple):
    """All that decides a simulation; it can be sent to another process."""

    controller: str  # its name
    scn: Scenario
    params: ControllerParams
    vehicle: CarParams
    plant: PlantParams
    friction: float  # of the road; the controller assumes params.model.friction
    knows_limit: bool = True  # whether what the plant holds in a steady turn is found, if it does
    sensors: SensorParams | None = None  # of the car; None: it has none
    sensors_seed: int = 0  # of their errors
    estimator: EstimatorParams | None = None  # None: the controller is fed the true state
    faults: FaultParams | None = None  # of the actuators

    def __repr__(self) -> str:
        return f'Setup({self.controller!r}, {self.scn.name!r}, friction={self.friction:g})'


def prepare(
    scenario_name: str,
    controller: str,
    settings: Mapping[str, Mapping[str, Any]] = node_config.NO_OVERRIDES,
    speed_mps: float | None = None,
    any_car: bool = False,
) -> Setup:
    """Return the setup that `experiments run` would use.

    `controller` is a name in mpcc_controller/config or a YAML file; `settings` are parameters of
    `plant` and `controller` by role and dotted name, as of --set; `speed_mps` replaces the
    scenario's desired speed by a constant. Raises BagError for unusable input, for a setting of
    the plant that has no effect in process, and, unless `any_car`, for a plant that is another car
    than the controller knows.
    """
    scn = inputs.load_scenario(scenario_name, speed_mps=speed_mps)
    return prepare_scenario(scn, controller, settings, scenario_name, any_car=any_car)


def prepare_scenario(
    scn: Scenario,
    controller: str,
    settings: Mapping[str, Mapping[str, Any]] = node_config.NO_OVERRIDES,
    source: str = '',
    written: Callable[[str], str] = '--set {}'.format,
    any_car: bool = False,
) -> Setup:
    """Return the setup of a loaded scenario, as `prepare`.

    For errors: `source` is the file of the scenario, `written` says how the caller wrote a setting.
    """
    for name in settings.get('plant', ()):
        if name not in PLANT_SETTINGS and not name.startswith(PLANT_GROUPS):
            groups = ' and '.join(f'{group}*' for group in PLANT_GROUPS)
            allowed = f'{", ".join(PLANT_SETTINGS)}, {groups}'
            raise BagError(f'plant.{name} has no effect in process; allowed are {allowed}')
    chosen = node_config.find_controller(controller)
    origins = {
        role: {name: written(f'{role}.{name}') for name in values}
        for role, values in settings.items()
    }
    nodes = inputs.build_nodes(scn, source or scn.name, chosen, settings, origins)
    checked = inputs.check_parameters(nodes)
    if not any_car:
        inputs.check_car_fits(nodes, checked, *IN_PYTHON)
    params, vehicle = checked['controller']
    node, plant = checked['plant']
    return Setup(
        chosen.name,
        scn,
        params,
        vehicle,
        plant,
        node.friction,
        sensors=load_sensors(node),
        sensors_seed=node.sensors_seed or 0,
        estimator=checked.get(inputs.ESTIMATOR, (None,))[0],
        faults=node.faults,
    )


def drive(setup: Setup) -> Drive:
    """Simulate once and return the Drive of an equivalent recording, ready for the metrics."""
    return drive_from_columns(run(setup, explain=False), run_info(setup), setup.controller)


class Step(NamedTuple):
    """One tick of a simulation: what was there, and the answer to it.

    Controller, car and estimator are those of the simulation, which the next step changes.
    """

    controller: Controller
    car: Simulator
    estimator: Estimator | None
    track: Any  # of the plant since the step before, one row per millisecond; at first the start
    readings: Sequence[Any]  # of the sensors, since the step before
    obstacles: Any
    predictions: Any  # None where the scenario predicts nothing
    record: TickRecord


def steps(setup: Setup, controller: Controller | None = None) -> Iterator[Step]:
    """Simulate until the run ends; yield after every answer, before the plant follows it.

    A given controller is a new one of the setup.
    """
    scn = setup.scn
    car = make_car(setup)
    plant_side = LockstepStepper(car, RunEnd(inputs.stop_params(scn), car.now))
    controller = controller or Controller(setup.params, setup.vehicle)
    controller.reset(car.actuators)
    controller.set_reference(conversions.reference_as_received(scn.reference))
    controller.set_edges(scn.edges)
    sensors = setup.sensors and Sensors(setup.sensors, setup.plant.car, setup.sensors_seed, car.now)
    estimator = setup.estimator and Estimator(setup.estimator)
    track, predictions = car.now, None
    while True:
        readings = sensors.measure(track) if sensors else []
        if estimator:
            estimator.read(readings)
        t = (car.stamp_ns - scn.reference.stamp_ns) / NS_PER_S
        obstacles = scenario.obstacles_at(scn, t, car.stamp_ns, (car.state.X, car.state.Y))
        controller.set_obstacles(obstacles)
        if scn.predicts:
            predictions = scenario.predictions_at(scn, t, obstacles)
            controller.set_predictions(predictions)
        # as over ROS, the final state is still answered
        state = estimator.state(car.stamp_ns) if estimator else car.state
        state = conversions.odometry_as_received(state)
        record = controller.step(TickInputs(state, actuators=car.actuators))
        yield Step(controller, car, estimator, track, readings, obstacles, predictions, record)
        if plant_side.outcome:
            return
        controller.prepare()
        track = plant_side.tick(record.command)


def run(
    setup: Setup,
    explain: bool = True,
    give_up: Callable[[VehicleState], bool] = lambda state: False,
) -> dict[str, Columns]:
    """Simulate until the run ends and return the columns by topic, as `read.columns` of a bag.

    The same setup gives the same columns, except for the times of the solver. With `explain` false,
    which saves a third of the time, no plans are among them, and /controller/why has the
    values alone that do not need the plan (`TickReporter.why`). A drive also ends after the first
    tick in whose state `give_up` is true.
    """
    tracks, readings, obstacles, predictions, commands, reports, plans, stops = (
        [] for _ in range(8)
    )
    for step in steps(setup):
        tracks.append(step.track)
        readings += step.readings
        obstacles.append(step.obstacles)
        predictions.append(step.predictions)
        commands.append(step.record.command)
        reports.append(step.controller.reporter.why(step.record, explain))
        if explain:
            plan = step.controller.reporter.prediction(step.record)
            plans.append(conversions.prediction_as_received(plan))
            stop = step.controller.stop_plan(step.record)
            stops += [conversions.stop_plan_as_received(stop)] if stop is not None else []
        if give_up(step.car.state):
            break
    values = {
        '/scenario/reference': [conversions.reference_as_received(setup.scn.reference)],
        '/scenario/road_edges': [setup.scn.edges],
        '/scenario/obstacles': obstacles,
        '/controller/why': reports,
    }
    if setup.scn.predicts:
        values['/scenario/predictions'] = predictions
    if explain:
        values['/controller/prediction'] = plans
    if stops:
        values['/controller/stop_plan'] = stops
    measured = {}
    if setup.sensors:
        measured = {topic: [r.value for r in readings if r.topic == topic] for topic in TOPICS}
    if step.estimator:
        believed = (e.as_message() for e in step.estimator.estimates)
        measured['/estimator/odometry'] = [*map(conversions.odometry_as_received, believed)]
    return build_columns(join_trajectories(tracks), commands, values, measured)


def make_car(setup: Setup) -> Simulator:
    """Return the car of a setup at its start."""
    scn = setup.scn
    patches = road_friction.patch_array(*scn.patches)
    start = Start(*scn.start)
    return Simulator(setup.plant, setup.friction, start, patches=patches, faults=setup.faults)


def run_info(setup: Setup) -> dict[str, str]:
    """Return the run information that `experiments run` would record for the same run.

    And the lateral acceleration that the plant holds, where it drives the circle and the road has
    one friction.
    """
    scn = setup.scn
    limit = None
    if setup.knows_limit and not scn.patches.friction:
        limit = plant_limit.held_lateral_limit(setup.plant, setup.friction)
    stop = parameters.flatten(inputs.stop_params(scn))
    car = parameters.flatten(setup.plant.car)
    faults = {k: v for k, v in vars(setup.faults).items() if v is not None} if setup.faults else {}
    values = {
        'controller': parameters.flatten(setup.vehicle) | parameters.flatten(setup.params),
        'plant': {f'car.{name}': value for name, value in car.items()}
        | {f'stop.{name}': value for name, value in stop.items()}
        | {f'faults.{name}': value for name, value in faults.items()}
        | {'friction': setup.friction},
    }
    return {
        'scenario': scn.name,
        'scenario_text': scn.text,
        'scenario_sha256': provenance.digest(scn.text),
        'controller': setup.controller,
        'mode': 'in process',
        'parameters': json.dumps(values, sort_keys=True),
        **({} if limit is None else {LATERAL_LIMIT: repr(limit)}),
    }


def build_columns(
    track: Any,
    commands: Sequence[Any],
    values: Mapping[str, Sequence[Any]],
    measured: Mapping[str, Sequence[Any]] = MappingProxyType({}),
) -> dict[str, Columns]:
    """Return the columns by topic.

    track     states of the plant, one row per millisecond, the first row is the start
    commands  one per tick
    values    values of `msgs_yaml.types` of every other topic, each with its stamp
    measured  the messages of the sensors by topic
    """
    zero_ns = int(track.stamp_ns[0])
    slow = track.where(track.stamp_ns % SLOW_NS == 0)
    states = track.state_columns()
    odometry = states._replace(psi=conversions.headings_as_received(states.psi))
    tables = {
        '/vehicle/odometry': odometry,
        '/vehicle/actuators': track.actuator_columns(),
        '/vehicle/imu': slow.imu_columns(),
        '/vehicle/wheels': slow.wheel_columns(),
        '/controller/command': tuple(map(np.array, zip(*commands))),
        **{topic: tuple(map(np.array, zip(*rows))) for topic, rows in measured.items()},
    }
    built = {}
    for topic, (stamp_ns, *fields) in tables.items():
        # fields of messages and columns after the time have the same order
        arrays = [np.ascontiguousarray(column, float) for column in fields]
        named = dict(zip(columns.names(topic)[2:], arrays, strict=True))
        built[topic] = _columns(stamp_ns, zero_ns, **named)
    for topic, rows in values.items():
        built[topic] = _columns([row.stamp_ns for row in rows], zero_ns, values=tuple(rows))
    return built


def _columns(stamp_ns, zero_ns, **fields):
    stamp_ns = np.asarray(stamp_ns, dtype=np.int64)
    return Columns(stamp_ns, (stamp_ns - zero_ns) / NS_PER_S, **fields)
