"""Which nodes make the ring, and with which parameters each is started."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
import yaml

from bags.errors import BagError
from msgs_yaml import share, strict_yaml
from node_runtime import named_file, parameters
from node_runtime.overrides import NO_SOURCES

NO_OVERRIDES: Mapping[str, Mapping[str, Any]] = MappingProxyType({})
ROLES = ('recorder', 'scenario', 'controller', 'plant')
# for the notes of a run: the defaults that a node reads by itself
DEFAULTS = {
    'recorder_node': ('bags', 'recorder.yaml'),
    'frenet_node': ('mpcc_controller', 'frenet.yaml'),
    'mpcc_node': ('mpcc_controller', 'mpcc.yaml'),
    'plant_node': ('vehicle_plant', 'bmw_545i.yaml'),
    'scenario_node': ('scenario_publisher', 'scenario_node.yaml'),
}
SHIPPED = {
    'controller': DEFAULTS['mpcc_node'],
    'plant': DEFAULTS['plant_node'],
    'recorder': DEFAULTS['recorder_node'],
    'scenario': DEFAULTS['scenario_node'],
}
DEFAULTS_NAMED = 'plant_params'  # the parameter that names another file of defaults
# which key of the scenario file gives a parameter, or the parameters below a name
SCENARIO_KEYS = {
    'controller': {'model.friction': 'friction'},
    'plant': {
        'friction': 'friction',
        'start': 'start',
        'stop': 'stop',
        'patches': 'friction_patches',
    },
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
    speeds: Sequence[tuple[str, float]] = ()  # key in the scenario file and m/s: start, desired


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
    origins: Mapping[str, str] = NO_SOURCES  # where some of `parameters` come from, for errors


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
    files = sorted(share.path('mpcc_controller', 'config').glob('*.yaml'))
    return {file.stem: file for file in files if 'car_file' in parameters.read_file(file)[0]}


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
            },
            origins=_origins(node, facts, overrides.get(node.role, {})),
        )
        for node in ring
    ]


def _origins(node, facts, settings):
    keys = SCENARIO_KEYS.get(node.role, {})
    found = {}
    for name in node.parameters:
        key = keys.get(name) or keys.get(name.partition('.')[0])
        if key:
            found[name] = f'scenario {facts.source}: {key}'
    return found | {name: f'--set {node.role}.{name}' for name in settings}


def markers(ring: Sequence[Node]) -> Node:
    """Return the node that draws a ring for 3D viewers, told what car drives and how far off."""
    values = {node.role: _values(node) for node in ring}
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


def noted(
    ring: Sequence[Node], file_values: Mapping[str, Mapping[str, Any]]
) -> dict[str, dict[str, Any]]:
    """Return every parameter of every node by role: files, then what was set.

    `file_values` are the dotted parameters in the files that a node's parameters name (car, tyre),
    by role, from `inputs.file_values`: only the package of a node can read every form of them.
    """
    return {node.role: {**file_values.get(node.role, {}), **_values(node)} for node in ring}


def _values(node):
    values = given(node)
    if node.executable in DEFAULTS:
        values = parameters.read_file(defaults(node))[0] | values
    return values


def defaults(node: Node) -> Path:
    """Return the parameter file that a node of DEFAULTS reads by itself."""
    package, name = DEFAULTS[node.executable]
    if node.role == 'plant':
        chosen = str(node.parameters.get(DEFAULTS_NAMED, name))
        return named_file.find(package, DEFAULTS_NAMED, chosen, 'tyre_set', sources(node))
    return named_file.config(package, name)


def given(node: Node) -> dict[str, Any]:
    """Return what a node is told by dotted name: files, then what was set."""
    values = {}
    for file in node.files:
        values |= parameters.read_file(file)[0]
    return values | node.parameters


def sources(node: Node) -> dict[str, str]:
    """Return where what a node is told comes from: file and line, scenario key, or --set."""
    found = {}
    for file in node.files:
        found |= {name: f'{file}:{line}' for name, line in parameters.read_file(file)[1].items()}
    return found | dict(node.origins)


def value(setting: str, written: str) -> Any:
    """Return what is written in a setting as ROS reads it: 1e-1 is a number.

    Raises BagError for what is no YAML value.
    """
    try:
        node = yaml.compose(written, Loader=yaml.SafeLoader)
        return None if node is None else strict_yaml.Item(Path('--set'), setting, node).value()
    except (yaml.YAMLError, strict_yaml.YamlError):
        raise BagError(f'--set {setting}: {written!r} is no value') from None


def write_parameters(node: Node, folder: Path) -> Path:
    """Write what is set for a node as the ROS parameter file `<role>.yaml`; return its path."""
    path = folder / f'{node.role}.yaml'
    path.write_text(yaml.safe_dump({'/**': {'ros__parameters': node.parameters}}))
    return path


def arguments(node: Node, written: Path) -> list[str]:
    """Return the command line of a node whose parameters were written to a file."""
    files = [part for file in (*node.files, written) for part in ('--params-file', str(file))]
    return ['--ros-args', *files]


def overrides(settings: list[str]) -> dict[str, dict[str, Any]]:
    """Return {role: {parameter: value}} of `ROLE.parameter=value` texts, read as ROS reads YAML.

    Raises BagError that shows the form; `check_parameters` judges parameters and values.
    """
    found = {}
    for text in settings:
        target, equals, written = text.partition('=')
        role, _, name = target.partition('.')
        if not equals or not name or role not in ROLES:
            raise BagError(
                f'--set {text}: must be NODE.parameter=value, NODE one of {", ".join(ROLES)}'
                f'{_hint(target)}'
            )
        found.setdefault(role, {})[name] = value(text, written)
    return found


def _shipped(role):
    package, file = SHIPPED[role]
    return parameters.read_file(share.path(package, 'config', file))[0]


def _hint(target):
    """Return what may have been meant by a setting that names no node."""
    role, _, name = target.partition('.')
    if role == 'weights':
        return (
            '; weights.<term> are factors of `experiments resolve`; '
            'a run takes controller.tolerances.*'
        )
    near = [node for node in ROLES if f"'{node}'" in strict_yaml.closest(role, ROLES)]
    if near and name:
        return f'; did you mean {f"{near[0]}.{name}"!r}?'
    known = {f'{node}.{parameter}' for node in ROLES for parameter in _shipped(node)}
    exact = sorted(full for full in known if full.partition('.')[2] == target)
    if exact:
        return f'; did you mean {" or ".join(map(repr, exact))}?'
    return strict_yaml.closest(f'controller.{target}', known)
