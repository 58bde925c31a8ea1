"""Scenario and parameters as the nodes will read them, checked before anything starts.

Loads no model and no solver: an error in the input is found at once.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import yaml

from bags.errors import BagError
from bags.storage.recorder_params import RecorderParams
from bags.verdict import metrics
from experiments.configuration import experiment, warnings
from experiments.configuration.experiment import Node, ScenarioFacts
from mpcc_controller import car_file, limits_in_force
from mpcc_controller.parameters import ControllerParams
from node_runtime import overrides, parameters
from scenario_publisher import scenario
from scenario_publisher.parameters import NodeParams as ScenarioParams
from scenario_publisher.scenario import Scenario
from vehicle_plant import parameters as plant_parameters
from vehicle_plant.parameters import NodeParams, PlantParams, StopParams

# what a node reads, and how the file that this names is read, None where it names none
READ = {
    'recorder_node': (RecorderParams, None),
    'scenario_node': (ScenarioParams, None),
    'mpcc_node': (ControllerParams, car_file.load),
    'frenet_node': (ControllerParams, car_file.load),
    'plant_node': (NodeParams, plant_parameters.plant),
}
# what the plant declares beside them
BY_HAND = {
    'start.from': parameters.Leaf(str, False, plant_parameters.START_FROM),
    experiment.DEFAULTS_NAMED: parameters.Leaf(str, False, None),
}


def stop_params(scn: Scenario) -> StopParams:
    """Return the end of a scenario as the plant takes it."""
    x, y, yaw, armed_after, time = scn.stop
    return StopParams(x_m=x, y_m=y, yaw_rad=yaw, armed_after_m=armed_after, time_s=time)


def load_scenario(name_or_path: str, speed_mps: float | None = None) -> Scenario:
    """Return a scenario, at another constant desired speed where given. Raises BagError."""
    try:
        scn = scenario.load(name_or_path)
        if speed_mps is None:
            return scn
        document = yaml.safe_load(scn.text)
        document['speed'] = {'constant_mps': float(speed_mps)}
        return scenario.parse(yaml.safe_dump(document), f'{name_or_path} at {speed_mps:.2f} m/s')
    except scenario.ScenarioError as error:
        raise BagError(str(error)) from None


def scenario_facts(name_or_path: str) -> ScenarioFacts:
    """Return what the nodes are told about a scenario. Raises BagError when it cannot be used."""
    return facts(load_scenario(name_or_path), name_or_path)


def facts(scn: Scenario, source: str) -> ScenarioFacts:
    """Return the same of a loaded scenario; `source` is how scenario_node finds it."""
    x, y, yaw, speed = scn.start
    path = np.column_stack([scn.reference.X, scn.reference.Y])
    return ScenarioFacts(
        name=scn.name,
        text=scn.text,
        source=source,
        friction=scn.friction,
        start={'x_m': x, 'y_m': y, 'yaw_rad': yaw, 'speed_mps': speed},
        stop=parameters.flatten(stop_params(scn)),
        patches=scn.patches._asdict(),
        path=path,
        length_m=metrics.stop_station(path, (scn.stop.X, scn.stop.Y), scn.stop.armed_after),
        speeds=scn.speeds,
    )


def check_parameters(nodes: Sequence[Node]) -> dict[str, tuple[Any, Any]]:
    """Read the parameters of scenario, controller, plant and recorder as they will.

    Returns by role the parameters and what is read from the file that they name, None where they
    name none. Raises BagError for what a node refuses, and for a limit of the controller that is
    set beyond what the car can do: it would have no effect.
    """
    read = {node.role: _read(node) for node in nodes if node.executable in READ}
    for node in nodes:
        if node.role == 'controller':
            _refuse_impossible(node, *read[node.role])
    return read


def file_values(read: Mapping[str, tuple[Any, Any]]) -> dict[str, dict[str, Any]]:
    """Return the parameters in the files that controller and plant name, for the notes of a run.

    By role and dotted name: the controller's car, the plant's tyre. `read` is from
    `check_parameters`.
    """
    return {
        role: parameters.flatten(named.tyre if isinstance(named, PlantParams) else named)
        for role, (_, named) in read.items()
        if named is not None
    }


def warnings_of(facts: ScenarioFacts, read: Mapping[str, tuple[Any, Any]]) -> list[str]:
    """Return what to tell a user before a run; `read` is from `check_parameters`."""
    node, plant = read['plant']
    return warnings.of(facts, node.start.speed_mps, read['controller'], plant)


def _read(node):
    """Return the parameters of a node, and those in the file that they name."""
    cls, load = READ[node.executable]
    try:
        given, sources = experiment.given(node), experiment.sources(node)
        by_hand = BY_HAND if node.role == 'plant' else {}
        for name in by_hand.keys() & given.keys():
            parameters.check(by_hand[name], given.pop(name), name, sources.get)
        defaults = experiment.defaults(node)
        made, _ = overrides.resolve(cls, defaults, given, sources)
        if load is None:
            return made, None
        lines = parameters.read_file(defaults)[1].items()
        return made, load(made, {name: f'{defaults}:{line}' for name, line in lines} | sources)
    except (parameters.ParameterError, OSError) as error:
        files = ''.join(f' ({file})' for file in node.files)
        raise BagError(f'the {node.role}{files} would not start: {error}') from None


def _refuse_impossible(node, params, vehicle):
    try:
        limits_in_force.refuse(params, vehicle, node.origins)
    except parameters.ParameterError as error:
        raise BagError(str(error)) from None
