"""The arguments of closed_loop.launch.py, for the launch file and its page; its parameter files.

They are here and not in the launch file, which only an installation of ROS 2 can load. The
parameter files are those of ROS, with sections for several nodes.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

from experiments.configuration.node_config import ROLES
from msgs_yaml.strict_yaml import closest, read
from node_runtime import parameters

MODES, SWITCH = ('lockstep', 'realtime'), ('true', 'false')
LEVELS = ('debug', 'info', 'warn', 'error', 'fatal')
PARAMS_FILE = (
    'ROS parameter files, with sections for scenario, controller, plant and recorder; several are '
    'separated by blanks, and the last one counts'
)
SET = (
    'parameters as NODE.parameter=value, such as plant.friction=0.6; several are separated by '
    'blanks; they win over params_file'
)
ANY_CAR = 'whether to drive also with a car file of the controller that is not that of the plant'
AUTOSTART = 'false: the nodes wait, unconfigured, for the transitions of their life cycle '
AUTOSTART += '(ros2 lifecycle set)'

EVERY_NODE, ANY_NAMESPACE = '/**', '/**/'
PARAMETERS = 'ros__parameters'


class LaunchArgument(NamedTuple):
    """An argument of the launch file."""

    name: str
    default: str
    meaning: str
    choices: Sequence[str] | None = None  # None: any text


ARGUMENTS = tuple(
    LaunchArgument(*given)
    for given in (
        ('scenario', 'double_lane_change', 'name of a scenario, or the path of a YAML file'),
        ('controller', 'mpcc', 'name of a file in mpcc_controller/config, or path of one'),
        ('mode', 'lockstep', 'lockstep: simulated time; realtime: wall clock', MODES),
        ('out', 'bags/runs', 'folder for <scenario>/<controller>, which must not exist yet'),
        ('record', 'true', 'whether recorder_node records the run', SWITCH),
        ('markers', 'false', 'whether markers_node draws the run for RViz and Foxglove', SWITCH),
        ('namespace', '', 'of every node and topic, such as /car1; empty: the root'),
        ('params_file', '', PARAMS_FILE),
        ('set', '', SET),
        ('any_car', 'false', ANY_CAR, SWITCH),
        ('use_sim_time', 'false', 'whether the clocks and logs of the nodes follow /clock', SWITCH),
        ('log_level', 'info', 'least severity that the nodes log', LEVELS),
        ('autostart', 'true', AUTOSTART, SWITCH),
    )
)


def read_files(
    paths: Sequence[str], namespace: str = ''
) -> tuple[dict[str, dict[str, Any]], dict[str, dict[str, str]]]:
    """Return values and sources (<file>:<line>) of parameters in files, by role and dotted name.

    Of a parameter that several files set, the last one counts.

    A section is for the node that it names (`plant`, `/plant`, `/**/plant`, or with the `namespace`
    of the run `/car1/plant`), or for every node (`/**`). Raises YamlError for a file that cannot be
    read, and, `<file>:<line>: <key>: <what>`, for a section of another node.
    """
    values: dict[str, dict[str, Any]] = {}
    sources: dict[str, dict[str, str]] = {}
    own = f'/{namespace.strip("/")}/'.replace('//', '/')
    sections = [
        (path, *pair)
        for path in (Path(path).expanduser() for path in paths)
        for pair in read(path).items().items()
    ]
    for path, section, item in sections:
        prefixes = (prefix for prefix in (ANY_NAMESPACE, own, '/') if section.startswith(prefix))
        name = section.removeprefix(next(prefixes, ''))
        roles = ROLES if section == EVERY_NODE else (name,)
        if roles[0] not in ROLES:
            known, hint = ', '.join(ROLES), closest(name, ROLES)
            raise item.error(f'no node of this run; allowed {known}, {EVERY_NODE}{hint}')
        leaves = parameters.leaf_items(item.members((PARAMETERS,))[PARAMETERS])
        for role in roles:
            given = {name: leaf.value_or_empty() for name, leaf in leaves.items()}
            values.setdefault(role, {}).update(given)
            lines = {name: f'{path}:{leaf.line}' for name, leaf in leaves.items()}
            sources.setdefault(role, {}).update(lines)
    return values, sources
