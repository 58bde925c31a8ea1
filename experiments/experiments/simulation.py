"""The ring in process, without ROS: the same steps in the same order as the nodes in lockstep."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from bags.errors import BagError
from bags.storage import columns
from bags.storage.columns import Columns
from bags.verdict import recorded
from bags.verdict.drive import Drive
from experiments.configuration import inputs, node_config
from mpcc_controller.driving.controller import Controller
from mpcc_controller.parameters import CarParams, ControllerParams
from msgs_yaml import ring
from msgs_yaml.stamp import NS_PER_S
from node_runtime import parameters, provenance
from scenario_publisher import scenario
from scenario_publisher.scenario import Scenario
from vehicle_plant import road, track
from vehicle_plant.parameters import PlantParams
from vehicle_plant.ring import Lockstep
from vehicle_plant.run_end import RunEnd
from vehicle_plant.simulator import Simulator, Start

# of the plant's parameters, what a drive in process follows; start, end and patches are the
# scenario's, the others are about messages and wall time
HONOURED = ('friction', 'tyre_set', node_config.PLANT_DEFAULTS)
HONOURED_GROUP = 'car.'
SLOW_NS = 10_000_000  # between two messages of /vehicle/imu and /vehicle/wheels


class Setup(NamedTuple):
    """All that decides a drive in process; it can be sent to another process."""

    name: str  # of the controller
    scn: Scenario
    params: ControllerParams
    vehicle: CarParams
    plant: PlantParams
    friction: float  # of the road; what the controller believes is params.model.friction


def setup(
    scenario_name: str,
    controller: str,
    settings: Mapping[str, Mapping[str, Any]] = node_config.NO_OVERRIDES,
    speed_mps: float | None = None,
) -> Setup:
    """Return a drive as `experiments run` would make it.

    `controller` is a name in mpcc_controller/config or a YAML file; `settings` are parameters of
    `plant` and `controller` by role and dotted name, as of --set; `speed_mps` replaces the
    scenario's desired speed by a constant. Raises BagError for what cannot be used, and for a
    setting of the plant that a drive in process would not follow.
    """
    for name in settings.get('plant', ()):
        if name not in HONOURED and not name.startswith(HONOURED_GROUP):
            allowed = f'{", ".join(HONOURED)} and {HONOURED_GROUP}*'
            raise BagError(f'plant.{name} has no effect in process; allowed are {allowed}')
    chosen = node_config.find_controller(controller)
    scn = inputs.load_scenario(scenario_name, speed_mps)
    nowhere = Path()
    ring = node_config.build_nodes(
        inputs.scenario_facts(scn, scenario_name), chosen, 'lockstep', nowhere, nowhere, settings
    )
    read = inputs.check_parameters(ring)
    params, vehicle = read['controller']
    node, plant = read['plant']
    return Setup(chosen.name, scn, params, vehicle, plant, node.friction)


def drive(prepared: Setup) -> Drive:
    """Drive once and return what a recording of it would say, ready for `metrics.of`."""
    name, scn, params, vehicle, plant, friction = prepared
    columns = run(scn, params, vehicle, plant, friction)
    info = run_info(scn, name, params, vehicle, plant, friction)
    return recorded.of(columns, info, name)


def run(
    scn: Scenario,
    params: ControllerParams,
    vehicle: CarParams,
    plant: PlantParams,
    friction: float | None = None,
) -> dict[str, Columns]:
    """Drive a scenario until its end and return the columns, as `read.columns` does of a bag.

    `friction` is that of the road, the scenario's unless given; the controller believes its own
    parameter. The same arguments give the same columns, times of the solver excepted.
    """
    car = Simulator(
        plant,
        scn.friction if friction is None else friction,
        Start(*scn.start),
        patches=road.patches(*scn.patches),
    )
    plant_side = Lockstep(car, RunEnd(inputs.stop_params(scn), car.now))
    controller = Controller(params, vehicle)
    controller.reset(car.actuators)
    controller.set_reference(ring.reference(scn.reference))
    controller.set_edges(scn.edges)
    tracks, seen, answers = [car.now], [], []
    while True:
        t = (car.stamp_ns - scn.reference.stamp_ns) / NS_PER_S
        seen.append(scenario.obstacles_at(scn, t, car.stamp_ns))
        controller.set_obstacles(seen[-1])
        # over ROS, too, the state at the end is still answered
        answers.append(controller.step(ring.odometry(car.state)))
        if plant_side.outcome:
            break
        controller.prepare()
        command, _, _ = answers[-1]
        tracks.append(plant_side.tick(command))
    commands, predictions, whys = zip(*answers)
    values = {
        '/scenario/reference': [ring.reference(scn.reference)],
        '/scenario/road_edges': [scn.edges],
        '/scenario/obstacles': seen,
        '/controller/prediction': [ring.prediction(one) for one in predictions],
        '/controller/why': whys,
    }
    return tables_of(track.join(tracks), commands, values)


def run_info(
    scn: Scenario,
    controller: str,
    params: ControllerParams,
    vehicle: CarParams,
    plant: PlantParams,
    friction: float | None = None,
) -> dict[str, str]:
    """Return the notes that `experiments run` would write for the same run."""
    stop = parameters.flatten(inputs.stop_params(scn))
    noted = {
        'controller': parameters.flatten(vehicle) | parameters.flatten(params),
        'plant': {f'car.{name}': value for name, value in parameters.flatten(plant.car).items()}
        | {f'stop.{name}': value for name, value in stop.items()}
        | {'friction': scn.friction if friction is None else friction},
    }
    return {
        'scenario': scn.name,
        'scenario_text': scn.text,
        'scenario_sha256': provenance.digest(scn.text),
        'controller': controller,
        'mode': 'in process',
        'parameters': json.dumps(noted, sort_keys=True),
    }


def tables_of(
    track: Any,
    commands: Sequence[Any],
    values: dict[str, Sequence[Any]],
) -> dict[str, Columns]:
    """Return the tables by topic.

    track     the plant's, one row per millisecond, first row the start
    commands  one per tick
    values    values of `msgs_yaml.types` for every other topic, each with its stamp
    """
    zero_ns = int(track.stamp_ns[0])
    slow = track.where(track.stamp_ns % SLOW_NS == 0)
    tables = {
        '/vehicle/odometry': (columns.Odometry, [ring.odometry(x) for x in track.states()]),
        '/vehicle/actuators': (columns.Actuators, track.actuators()),
        '/vehicle/imu': (columns.Imu, slow.imu()),
        '/vehicle/wheels': (columns.Wheels, slow.wheels()),
        '/controller/command': (columns.Command, commands),
    }
    made = {topic: _table(form, rows, zero_ns) for topic, (form, rows) in tables.items()}
    return made | {topic: _values(rows, zero_ns) for topic, rows in values.items()}


def _table(form, rows, zero_ns):
    """The fields of the values and the columns after the time stand in the same order."""
    stamps, *fields = zip(*rows)
    stamp_ns = np.array(stamps, dtype=np.int64)
    return form(stamp_ns, _seconds(stamp_ns, zero_ns), *(np.array(f, float) for f in fields))


def _values(rows, zero_ns):
    stamp_ns = np.array([one.stamp_ns for one in rows], dtype=np.int64)
    return columns.Values(stamp_ns, _seconds(stamp_ns, zero_ns), tuple(rows))


def _seconds(stamp_ns, zero_ns):
    return (stamp_ns - zero_ns) / NS_PER_S
