"""Which nodes make the ring, and with which parameters each is started."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import yaml

from bags.errors import BagError
from msgs_yaml import parameters, share, strict_yaml

ROLES = ('recorder', 'scenario', 'controller', 'plant')
# for the notes of a run: the defaults that a node reads by itself, and which of its parameters
# name further files, in its package's config/ or anywhere
DEFAULTS = {
    'recorder_node': ('bags', 'recorder.yaml'),
    'frenet_node': ('mpcc_controller', 'frenet.yaml'),
    'mpcc_node': ('mpcc_controller', 'mpcc.yaml'),
    'plant_node': ('vehicle_plant', 'bmw_545i.yaml'),
}
DEFAULTS_NAMED = 'plant_params'  # the parameter that names another file of defaults
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
    patches: Mapping[str, tuple[float, ...]]  # corners_m, friction; empty where there are none
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

    Raises BagError when there is none; it names those that there are.
    """
    path = Path(name_or_path)
    if path.suffix not in ('.yaml', '.yml'):
        known = _known_controllers()
        if name_or_path not in known:
            raise BagError(
                f'no controller {name_or_path!r}; there are {", ".join(known)}, or give a YAML file'
            )
        path = known[name_or_path]
    if not path.is_file():
        raise BagError(f'no controller {name_or_path!r}: there is no such file')
    executable = 'frenet_node' if path.stem.startswith('frenet') else 'mpcc_node'
    return Controller(path.stem, executable, path.absolute())


def controllers(names_or_paths: Sequence[str]) -> list[Controller]:
    """Return each controller once; BagError as above, and for two files of one name."""
    chosen = list(dict.fromkeys(controller(name) for name in names_or_paths))
    names = [one.name for one in chosen]
    for one in chosen:
        if names.count(one.name) > 1:
            raise BagError(
                f'two controllers are called {one.name!r}: their runs would go to the same place; '
                'give one of the files another name'
            )
    return chosen


def _known_controllers():
    """Return the files in config/ by name; one that names no car is none of a controller."""
    package, car = NAMED_FILES['controller']
    files = sorted(share.path(package, 'config').glob('*.yaml'))
    return {file.stem: file for file in files if car in parameters.read_file(file)[0]}


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
        **{f'patches.{name}': list(value) for name, value in facts.patches.items() if value},
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


def markers(ring: Sequence[Node]) -> Node:
    """Return the node that draws a ring for 3D viewers, told what car drives and how far off."""
    values = noted(ring)
    plant, told = values['plant'], values['controller']
    drawn = {
        'outline.front_m': plant['car.body.cog_to_front_m'] + plant['car.outline.front_overhang_m'],
        'outline.rear_m': plant['car.body.cog_to_rear_m'] + plant['car.outline.rear_overhang_m'],
        'outline.width_m': plant['car.outline.width_m'],
        'safety.circle_offsets_m': told['body.circle_offsets_m'],
        'safety.circle_radius_m': told['body.circle_radius_m'],
        'safety.obstacle_m': told['safety.obstacle_m'],
        'safety.edge_m': told['safety.edge_m'],
    }
    # nobody waits for it, and it for nobody
    return Node('markers', 'bags', 'markers_node', (), {'mode': plant['mode'], **drawn})


def noted(ring: Sequence[Node]) -> dict[str, dict[str, Any]]:
    """Return every parameter of every node by role: files, then what was set."""
    return {node.role: _values(node) for node in ring}


def _values(node):
    values = given(node)
    if node.executable in DEFAULTS:
        values = parameters.read_file(defaults(node))[0] | values
    if node.role in NAMED_FILES:
        package, parameter = NAMED_FILES[node.role]
        values = parameters.read_file(_in_config(package, values[parameter]))[0] | values
    return values


def defaults(node: Node) -> Path:
    """Return the parameter file that a node of DEFAULTS reads by itself."""
    package, name = DEFAULTS[node.executable]
    return _in_config(package, str(node.parameters.get(DEFAULTS_NAMED, name)))


def _in_config(package, name):
    """Return a path, which may be a bare name in a package's config/."""
    inside = Path(name).parent == Path()
    return share.path(package, 'config', name) if inside else Path(name)


def given(node: Node) -> dict[str, Any]:
    """Return what a node is told by dotted name: files, then what was set."""
    values = {}
    for file in node.files:
        values |= parameters.read_file(file)[0]
    return values | node.parameters


def _value(text, value):
    """A value as ROS reads it: 1e-1 is a number."""
    node = yaml.compose(value, Loader=yaml.SafeLoader)
    return None if node is None else strict_yaml.Item(Path('--set'), text, node).value()


def write_parameters(node: Node, path: Path) -> None:
    """Write what is set for a node as a ROS parameter file."""
    path.write_text(yaml.safe_dump({'/**': {'ros__parameters': node.parameters}}))


def arguments(node: Node, written: Path) -> list[str]:
    """Return the command line of a node whose parameters were written to a file."""
    files = [part for file in (*node.files, written) for part in ('--params-file', str(file))]
    return ['--ros-args', *files]


def overrides(settings: list[str]) -> dict[str, dict[str, Any]]:
    """Return {role: {parameter: value}} of `ROLE.parameter=value` texts, read as ROS reads YAML.

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
            found.setdefault(role, {})[name] = _value(text, value)
        except (yaml.YAMLError, strict_yaml.YamlError):
            raise BagError(f'--set {text}: {value!r} is no value') from None
    return found
