"""Parameters of a node: the defaults of its YAML file, overridden from the command line. No ROS."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

from msgs_yaml import contract
from msgs_yaml.strict_yaml import closest
from node_runtime import parameters, realtime
from node_runtime.parameters import Choice, Leaf, ParameterError, Range

MODE = 'mode'
RECORDERS = 'recorders'
REALTIME = 'realtime'
# what every node takes besides its own parameters, and the defaults
COMMON = {
    MODE: Leaf(str, False, Choice(*contract.MODES)),
    RECORDERS: Leaf(int, False, Range(0, 10, 'recorders that must be listening before it starts')),
    **{f'{REALTIME}.{name}': leaf for name, leaf in parameters.leaves(realtime.Options).items()},
}
_COMMON_DEFAULTS = {
    MODE: contract.MODES[0],
    RECORDERS: 0,
    **{f'{REALTIME}.{k}': v for k, v in parameters.flatten(realtime.DEFAULTS).items()},
}
_SOURCE = 'command line or parameter file'
NO_SOURCES: Mapping[str, str] = {}
# what rclpy declares for every node
_OF_ROS = ('use_sim_time', 'start_type_description_service', 'qos_overrides.')


class Declaration(NamedTuple):
    """One parameter as it is declared."""

    name: str
    value: Any
    leaf: Leaf
    description: str


def resolve(
    cls: type, defaults: Path, given: Mapping[str, Any], sources: Mapping[str, str] = NO_SOURCES
) -> tuple[Any, tuple[Declaration, ...]]:
    """Return the parameters of a node and what to declare, `mode` and `recorders` included.

    `given` are the overrides by dotted name, `sources` says where they come from, as far as that
    is known. Raises ParameterError that names the source.
    """

    def source(key):
        if key in given:
            return sources.get(key, _SOURCE)
        return f'{defaults}:{lines[key]}' if key in lines else str(defaults)

    own = parameters.leaves(cls)
    known = {**COMMON, **own}
    for name in given:
        if name not in known and not name.startswith(_OF_ROS):
            hint = closest(name, known)
            raise ParameterError(f'{source(name)}: {name}: this node has no such parameter{hint}')
    values, lines = parameters.read_file(defaults)
    comments = defaults.read_text().splitlines()
    merged = {**values, **{k: _filled(known[k], v) for k, v in given.items() if k in known}}
    common = {name: merged.get(name, default) for name, default in _COMMON_DEFAULTS.items()}
    for name in COMMON.keys() - own.keys():
        merged.pop(name, None)

    for name, leaf in COMMON.items():
        parameters.check(leaf, common[name], name, source)
    made = parameters.build_from(cls, merged, source)
    final = {**common, **parameters.flatten(made)}
    return made, tuple(
        Declaration(name, final[name], leaf, _description(comments, lines.get(name), leaf))
        for name, leaf in known.items()
    )


def told_defaults(cls: type, given: Mapping[str, Any], defaults: Path) -> str:
    """Return in words how many parameters of a node come from the file of its defaults, and which.

    They are named where they are the smaller part.
    """
    names = parameters.leaves(cls)
    missing = [name for name in parameters.read_file(defaults)[0] if name in names.keys() - given]
    told = f'{len(missing)} of {len(names)} parameters are not given and come from {defaults}'
    few = 0 < len(missing) <= len(names) / 2
    return f'{told}: {", ".join(missing)}' if few else told


def _filled(leaf, value):
    """Return an empty list for what ROS gives for `[]`, which is nothing."""
    return () if leaf.many and value is None else value


def _description(comments, line, leaf):
    """Return the comment of the parameter's line and its range."""
    comment = comments[line - 1].partition('#')[2].strip() if line else ''
    return f'{comment}; {leaf.allowed}' if comment else leaf.allowed
