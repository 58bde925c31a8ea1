"""The nodes of a run: which executables, with which parameters, and what is recorded of them."""

import contextlib
import json
import os
import re
import sys
from collections.abc import Mapping, Sequence
from functools import reduce
from operator import or_
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

import yaml

from bags.errors import BagError
from bags.evaluation.drive import LATERAL_LIMIT, circles_of, outline_of
from msgs_yaml import missing_file, share, strict_yaml
from msgs_yaml.missing_file import YAML_SUFFIXES
from node_runtime import node_parameters, parameters, provenance
from node_runtime.node_parameters import NO_SOURCES
from node_runtime.provenance import LABEL_SIGN
from scenario_publisher.scenario import Scenario

PYTHON = '.py'  # suffix of a program
NO_OVERRIDES: Mapping[str, Mapping[str, Any]] = MappingProxyType({})
ROLES = ('recorder', 'scenario', 'controller', 'plant', 'estimator')
# package and file of the defaults that each node loads by itself, by role
DEFAULTS = {
    'recorder': ('bags', 'recorder.yaml'),
    'controller': ('mpcc_controller', 'mpcc.yaml'),
    'plant': ('vehicle_plant', 'bmw_545i.yaml'),
    'scenario': ('scenario_publisher', 'scenario_node.yaml'),
    'estimator': ('state_estimator', 'estimator.yaml'),
}
PLANT_DEFAULTS = 'plant_params'  # the parameter of the plant that names another file of defaults
# a number is what an older run gets that makes way for a new one
LABEL_FORM = re.compile(r'(?!\d+$)[A-Za-z0-9][A-Za-z0-9_-]{0,39}')
LABEL_ALLOWED = '1 to 40 of a-z, A-Z, 0-9, _ and -, not a number, the first no _ or -'
BAG_FOLDER, RUN_INFO_FILE = 'bag', 'run_info.json'
# what a run of a program of the user is judged by, of the parameters of the role that it plays
JUDGED_BY = {
    'controller': re.compile(r'body\..+|safety\..+|tyre\..+|model\.step_s'),
    'plant': re.compile(
        r'friction|(start|stop|patches|car\.outline)\..+|car\.body\.cog_to_.+'
        r'|car\.suspension\.(front|rear)\.track_m'
    ),
}


class Controller(NamedTuple):
    """A controller: its name in runs and its parameter file.

    One of the user's may be a program, which is started as its node; `config` is then the file by
    whose circles and safety distances its runs are judged.
    """

    name: str
    config: Path
    program: tuple[str, ...] = ()  # the command, without arguments of ROS
    label: str = ''  # of its runs, to tell them from others of the same controller

    @property
    def run_name(self) -> str:
        """The name of its runs, and of their folder: `mpcc`, or with a label `mpcc@soft`."""
        return f'{self.name}{LABEL_SIGN}{self.label}' if self.label else self.name

    @property
    def name_or_path(self) -> str:
        """The name of one that comes with the package, which any machine finds; else the path."""
        shipped = share.path('mpcc_controller', 'config') / f'{self.name}.yaml'
        return self.name if self.config == shipped.absolute() else str(self.config)


class Node(NamedTuple):
    """A node as it is started."""

    role: str
    package: str
    executable: str
    files: tuple[Path, ...]  # parameter files, the later ones win
    parameters: dict[str, Any]  # dotted; they win over the files
    origins: Mapping[str, str] = NO_SOURCES  # the source of some `parameters`, for errors
    program: tuple[str, ...] = ()  # what is started in place of the executable
    remappings: tuple[str, ...] = ()  # of topics, FROM:=TO


def find_controller(name_or_path: str, programs: bool = False) -> Controller:
    """Return the controller of a name in mpcc_controller/config, or of a YAML file.

    With `programs` also that of a path to a Python file or an executable, which is a node. Raises
    BagError, which lists the known names, when there is none.
    """
    path = Path(name_or_path)
    if program := _program(name_or_path):
        if not programs:
            raise BagError(
                f'the controller {name_or_path!r} is a program: only `experiments run` drives it'
            )
        return Controller(path.stem, find_controller('mpcc').config, program)
    is_path = os.sep in name_or_path or path.suffix == PYTHON
    if path.suffix not in YAML_SUFFIXES and not is_path:
        path = share.path('mpcc_controller', 'config') / f'{name_or_path}.yaml'
        if not _is_controller(path):
            unknown = _describe_unknown(name_or_path, known_controllers())
            raise BagError(f'no controller {name_or_path!r}{unknown}')
    if not path.is_file():
        raise BagError(f'no controller {name_or_path!r}: {_missing_file(path)}')
    if path.suffix not in YAML_SUFFIXES:
        what = 'is neither a YAML file nor a program that may be executed (chmod +x)'
        raise BagError(f'no controller {name_or_path!r}: the file {what}')
    if path.stem.startswith('frenet'):
        with contextlib.suppress(parameters.ParameterError):  # reported with the other inputs
            if 'formulation.name' not in parameters.read_file(path).values:
                raise BagError(
                    f'{path}: the name of a file does not choose the baseline; add '
                    '`base: frenet.yaml` to its ros__parameters'
                )
    return Controller(path.stem, path.absolute())


def find_plant(path: str) -> tuple[str, ...]:
    """Return the command of a plant that is a program of the user: a Python file or an executable.

    Raises BagError when there is none.
    """
    command = _program(os.path.join(os.curdir, path))
    if not command:
        file = Path(path)
        what = 'is neither a Python file nor a program that may be executed (chmod +x)'
        raise BagError(f'--plant {path}: {what if file.is_file() else _missing_file(file)}')
    return command


def _describe_unknown(name, known):
    """Return what may have been meant by a name that no controller has."""
    names = [part.strip() for part in name.split(',')]
    if len(names) > 1:
        return f'; give the option once for each: {" ".join(f"--controller {n}" for n in names)}'
    here = missing_file.describe_yaml_here(name)
    if here:
        return f' comes with the package; {here}'
    hint = strict_yaml.closest(name, known)
    return f'; there are {", ".join(known)}, or give a YAML file, as ./{name}.yaml{hint}'


def _program(name_or_path):
    """Return the command of a path to a program, () for any other text."""
    path = Path(name_or_path).absolute()
    if os.sep not in name_or_path and path.suffix != PYTHON:
        return ()
    if not path.is_file() or path.suffix in YAML_SUFFIXES:
        return ()
    if path.suffix == PYTHON:
        return (sys.executable, str(path))
    return (str(path),) if os.access(path, os.X_OK) else ()


def _missing_file(path):
    """Return that a file is missing, and the one that may have been meant."""
    shipped = known_controllers()
    if path.name == str(path) and path.stem in shipped:
        return f'there is no such file; did you mean {path.stem!r}, which comes with the package?'
    if path.suffix == PYTHON:
        kept = ('Python file', lambda file: file.suffix == PYTHON)
    else:
        kept = ('YAML file', missing_file.is_yaml)
    there = missing_file.describe_neighbours(path, *kept)
    return f'there is no such file (seen from {Path.cwd()}): {there}'


def find_controllers(
    names_or_paths: Sequence[str], labels: Sequence[str] = (), programs: bool = False
) -> list[Controller]:
    """Return the controllers without repetition, with a label for their runs.

    labels    none, one for all, or one for each
    programs  as in `find_controller`

    Raises BagError for what that refuses, two files of one name, and a label that is none.
    """
    for label in labels:
        if not LABEL_FORM.fullmatch(label):
            raise BagError(f'--label {label}: must be {LABEL_ALLOWED}')
    given = labels if len(labels) > 1 else [*labels, ''][:1] * len(names_or_paths)
    controllers = list(
        dict.fromkeys(
            find_controller(name, programs)._replace(label=label)
            for name, label in zip(names_or_paths, given)
        )
    )
    names = [controller.run_name for controller in controllers]
    for name in names:
        if names.count(name) > 1:
            raise BagError(
                f'two controllers are called {name!r}: their runs would go to the same folder; '
                'give one of the files another name'
            )
    return controllers


def known_controllers() -> dict[str, Path]:
    """Return the controller files in config/ by name; a file without a car is no controller."""
    files = sorted(share.path('mpcc_controller', 'config').glob('*.yaml'))
    return {file.stem: file for file in files if _is_controller(file)}


def _is_controller(file):
    return file.is_file() and 'car_file' in parameters.read_file(file).values


def build_markers_node(nodes: Sequence[Node]) -> Node:
    """Return the node that draws the run for 3D viewers, with the car and safety distances."""
    values = {node.role: all_values(node) for node in nodes}
    plant, controller = values['plant'], values['controller']
    outline = outline_of(plant)
    radius_m, offsets_m = circles_of(controller, outline)
    shapes = {
        **{f'outline.{name}_m': value for name, value in outline._asdict().items()},
        'safety.circle_offsets_m': list(offsets_m),
        'safety.circle_radius_m': radius_m,
        'safety.obstacle_m': controller['safety.obstacle_m'],
        'safety.edge_m': controller['safety.edge_m'],
    }
    # no node waits for this one, nor this one for others: `recorders` is not set
    return Node('markers', 'bags', 'markers_node', (), {'mode': plant['mode'], **shapes})


def collect_parameters(
    nodes: Sequence[Node], file_values: Mapping[str, Mapping[str, Any]]
) -> dict[str, dict[str, Any]]:
    """Return every parameter of every node by role: files first, then the values that were set.

    `file_values` are the dotted parameters in the files that a node's parameters name (car, tyre),
    by role, from `inputs.file_values`: only the package of a node can read every form of them.
    """
    recorded = {}
    for node in nodes:
        values = {**file_values.get(node.role, {}), **all_values(node)}
        if node.program:
            judged_by = JUDGED_BY[node.role]
            values = {name: value for name, value in values.items() if judged_by.fullmatch(name)}
            values['program'] = ' '.join(node.program)
            values['program_sha256'] = provenance.digest_file(Path(node.program[-1]))
        recorded[node.role] = values
    return recorded


class LoadedFacts(NamedTuple):
    """What follows from the files that the nodes of a run name, from `inputs.loaded_facts`."""

    file_values: Mapping[str, Mapping[str, Any]]  # dotted parameters by role
    lateral_limit: float | None = None  # m/s^2, what the plant holds in a steady turn, if it does


def write_run_info(
    scn: Scenario,
    controller: Controller,
    mode: str,
    nodes: Sequence[Node],
    path: Path,
    loaded: LoadedFacts,
) -> None:
    """Write the run information, which the recorder stores in the bag and `bags compare` needs.

    It holds scenario, versions, machine, the parameters of every node (`collect_parameters`), the
    comment at the top of the controller's file, and the lateral acceleration that the plant holds.
    """
    values = collect_parameters(nodes, loaded.file_values)
    run_info = provenance.describe_run(scn.name, scn.text, controller.name, mode, values)
    if controller.label:
        run_info[provenance.LABEL] = controller.label
    run_info[provenance.CONTROLLER_TEXT] = provenance.leading_comment(controller.config.read_text())
    if loaded.lateral_limit is not None:
        run_info[LATERAL_LIMIT] = repr(loaded.lateral_limit)
    path.write_text(json.dumps(run_info, indent=2))


def all_values(node: Node) -> dict[str, Any]:
    """Return every parameter of a node by dotted name: defaults, files, then settings."""
    values = given_parameters(node)
    if node.role in DEFAULTS:
        values = parameters.read_file(defaults_file(node)).values | values
    return values


def defaults_file(node: Node) -> Path:
    """Return the parameter file that a node of DEFAULTS loads by itself."""
    package, name = DEFAULTS[node.role]
    if node.role == 'plant':
        chosen = str(node.parameters.get(PLANT_DEFAULTS, name))
        return node_parameters.find_named_config(
            package, PLANT_DEFAULTS, chosen, 'tyre_set', parameter_sources(node)
        )
    return node_parameters.find_config(package, name)


def given_parameters(node: Node) -> dict[str, Any]:
    """Return the parameters that a node is given by dotted name: files first, then settings."""
    return reduce(or_, (file.values for file in _files(node)), {}) | node.parameters


def parameter_sources(node: Node) -> dict[str, str]:
    """Return the source of each given parameter: file and line, scenario key, or --set."""
    return reduce(or_, (file.sources for file in _files(node)), {}) | dict(node.origins)


def _files(node):
    """Yield the parameter files of a node; their `base` may be in the config/ of the package."""
    for file in node.files:
        yield parameters.read_file(file, share.path(node.package, 'config'))


def write_parameter_file(node: Node, folder: Path) -> Path:
    """Write the set parameters of a node as the ROS file `folder`/<role>.yaml; return its path.

    A `base` of the node's files is written with its path: ROS does not tell a node where its files
    are.
    """
    bases = [str(file.base) for file in _files(node) if file.base]
    values = {parameters.BASE: bases[-1], **node.parameters} if bases else node.parameters
    path = folder / f'{node.role}.yaml'
    path.write_text(yaml.safe_dump({'/**': {'ros__parameters': values}}))
    return path


def ros_arguments(node: Node, parameter_file: Path) -> list[str]:
    """Return the command line arguments of a node; `parameter_file` wins over its other files."""
    files = (*node.files, parameter_file)
    given = [part for file in files for part in ('--params-file', str(file))]
    return ['--ros-args', *given, *(part for rule in node.remappings for part in ('-r', rule))]
