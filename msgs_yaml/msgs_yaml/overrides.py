"""Parameters of a node: the defaults of its YAML file, overridden from the command line. No ROS."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

from msgs_yaml import contract, parameters
from msgs_yaml.parameters import Choice, Leaf, ParameterError
from msgs_yaml.strict_yaml import closest

MODE = 'mode'
MODE_LEAF = Leaf(str, False, Choice(*contract.MODES))
_DEFAULT_MODE, *_ = contract.MODES
_SOURCE = 'command line or parameter file'
# what rclpy declares for every node
_OF_ROS = ('use_sim_time', 'start_type_description_service', 'qos_overrides.')


class Declaration(NamedTuple):
    """One parameter as it is declared."""

    name: str
    value: Any
    leaf: Leaf
    description: str


def resolve(
    cls: type, defaults: Path, given: Mapping[str, Any]
) -> tuple[Any, tuple[Declaration, ...]]:
    """Return the parameters of a node and what to declare, `mode` included.

    `given` are the overrides by dotted name. Raises ParameterError that names the source.
    """
    known = {MODE: MODE_LEAF, **parameters.leaves(cls)}
    for name in given:
        if name not in known and not name.startswith(_OF_ROS):
            hint = closest(name, known)
            raise ParameterError(f'{_SOURCE}: {name}: this node has no such parameter{hint}')
    values, lines = parameters.read_file(defaults)
    comments = defaults.read_text().splitlines()
    merged = {**values, **{k: _filled(known[k], v) for k, v in given.items() if k in known}}
    chosen_mode = merged.get(MODE, _DEFAULT_MODE)
    if MODE not in parameters.leaves(cls):
        merged.pop(MODE, None)

    def source(key):
        if key in given:
            return _SOURCE
        return f'{defaults}:{lines[key]}' if key in lines else str(defaults)

    parameters.check(MODE_LEAF, chosen_mode, MODE, source)
    made = parameters.build_from(cls, merged, source)
    final = {MODE: chosen_mode, **parameters.flatten(made)}
    return made, tuple(
        Declaration(name, final[name], leaf, _description(comments, lines.get(name), leaf))
        for name, leaf in known.items()
    )


def _filled(leaf, value):
    """Return an empty list for what ROS gives for `[]`, which is nothing."""
    return () if leaf.many and value is None else value


def _description(comments, line, leaf):
    """Return the comment of the parameter's line and its range."""
    comment = comments[line - 1].partition('#')[2].strip() if line else ''
    return f'{comment}; {leaf.allowed}' if comment else leaf.allowed
