"""Which nodes make the ring, and with which parameters each is started."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import yaml

from bags.errors import BagError
from msgs_yaml import parameters, share

ROLES = ('recorder', 'scenario', 'controller', 'plant')
# for the notes of a run: the defaults that a node reads by itself, and which of its parameters
# name further files, in its package's config/ or anywhere
DEFAULTS = {'recorder': ('bags', 'recorder.yaml'), 'plant': ('vehicle_plant', 'bmw_545i.yaml')}
NAMED_FILES = {
    'controller': ('mpcc_controller', 'car_file'),
    'plant': ('vehicle_plant', 'tyre_set'),
}


class ScenarioFacts(NamedTuple):
    """What the nodes are told about a scenario, and what is noted about it."""

    name: str
    text: str  # of the file
    source: str  # name or absolute path, as scenario_node takes it
    friction: float
    start: Mapping[str, float]  # x_m, y_m, yaw_rad, speed_mps
    stop: Mapping[str, float]  # x_m, y_m, yaw_rad, armed_after_m, time_s
    path: np.ndarray  # (n, 2) m, the coarse path
    length_m: float  # along it to the stop


class Controller(NamedTuple):
    """One controller: a configuration and the node that runs it."""

    name: str
    executable: str
    config: Path


class Node(NamedTuple):
    """One node as it is started."""

    role: str
    package: str
    executable: str
    files: tuple[Path, ...]  # parameter files, the later ones win
    parameters: dict[str, Any]  # dotted; they win over the files


def controller(name_or_path: str) -> Controller:
    """Return the controller of a name in mpcc_controller/config, or of a YAML file.

    Raises BagError when there is none.
    """
    path = Path(name_or_path)
    if path.suffix not in ('.yaml', '.yml'):
        try:
            path = share.path('mpcc_controller', 'config', f'{name_or_path}.yaml')
        except FileNotFoundError as error:
            raise BagError(f'no controller {name_or_path!r}: {error}') from None
    if not path.is_file():
        raise BagError(f'no controller {name_or_path!r}: there is no such file')
    executable = 'frenet_node' if path.stem.startswith('frenet') else 'mpcc_node'
    return Controller(path.stem, executable, path.absolute())


def nodes(
    facts: ScenarioFacts,
    chosen: Controller,
    mode: str,
    bag: Path,
    notes: Path,
    overrides: Mapping[str, Mapping[str, Any]],
) -> list[Node]:
    """Return the nodes in the order in which they are started; `overrides` are by role."""
    plant = {
        'friction': facts.friction,
        'start.from': 'parameters',
        **{f'start.{name}': value for name, value in facts.start.items()},
        **{f'stop.{name}': value for name, value in facts.stop.items()},
    }
    ring = (
        Node('recorder', 'bags', 'recorder_node', (), {'out': str(bag), 'run_info': str(notes)}),
        Node('scenario', 'scenario_publisher', 'scenario_node', (), {'scenario': facts.source}),
        Node(
            'controller',
            'mpcc_controller',
            chosen.executable,
            (chosen.config,),
            {'model.friction': facts.friction},
        ),
        Node('plant', 'vehicle_plant', 'plant_node', (), plant),
    )
    return [
        node._replace(
            parameters={
                'mode': mode,
                # nobody begins before the recorder listens; it does not wait for itself
                'recorders': int(node.role != 'recorder'),
                **node.parameters,
                **overrides.get(node.role, {}),
            }
        )
        for node in ring
    ]


def noted(ring: list[Node]) -> dict[str, dict[str, Any]]:
    """Return every parameter of every node by role: files, then what was set."""
    return {node.role: _values(node) for node in ring}


def _values(node):
    values = {}
    if node.role in DEFAULTS:
        package, name = DEFAULTS[node.role]
        values |= parameters.read_file(share.path(package, 'config', name))[0]
    for file in node.files:
        values |= parameters.read_file(file)[0]
    values |= node.parameters
    if node.role in NAMED_FILES:
        package, parameter = NAMED_FILES[node.role]
        named = Path(values[parameter])
        inside = named.parent == Path()
        path = share.path(package, 'config', named.name) if inside else named
        values = parameters.read_file(path)[0] | values
    return values


def write_parameters(node: Node, path: Path) -> None:
    """Write what is set for a node as a ROS parameter file."""
    path.write_text(yaml.safe_dump({'/**': {'ros__parameters': node.parameters}}))


def arguments(node: Node, written: Path) -> list[str]:
    """Return the command line of a node whose parameters were written to a file."""
    files = [part for file in (*node.files, written) for part in ('--params-file', str(file))]
    return ['--ros-args', *files]


def overrides(settings: list[str]) -> dict[str, dict[str, Any]]:
    """Return {role: {parameter: value}} of `ROLE.parameter=value` texts; values are YAML.

    Raises BagError that shows the form.
    """
    found = {}
    for text in settings:
        target, equals, value = text.partition('=')
        role, _, name = target.partition('.')
        if not equals or not name or role not in ROLES:
            raise BagError(
                f'--set {text}: must be NODE.parameter=value, NODE one of {", ".join(ROLES)}'
            )
        try:
            found.setdefault(role, {})[name] = yaml.safe_load(value)
        except yaml.YAMLError:
            raise BagError(f'--set {text}: {value!r} is no value') from None
    return found
