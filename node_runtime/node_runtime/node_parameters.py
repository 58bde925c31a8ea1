"""Parameters of a node: its parameter file, and what ROS or a caller gives instead. No ROS here.

Every node takes, beside its own parameters, those of COMMON:

    mode         lockstep or realtime
    recorders    number of recorders that it waits for before it starts
    base         parameter file that holds where a parameter is not given; '': that of the node
    realtime.*   scheduling (`scheduling.SchedulingOptions`)

A managed node (`managed_node`) takes those of MANAGED:

    autostart    whether it configures and activates itself when it starts
"""

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, NamedTuple

from msgs_yaml import contract, share
from msgs_yaml.strict_yaml import closest
from node_runtime import parameter_docs, parameters, scheduling
from node_runtime.parameter_docs import GroupDoc
from node_runtime.parameters import BASE, Choice, Leaf, ParameterError, Range, Struct

MODE = 'mode'
RECORDERS = 'recorders'
REALTIME = 'realtime'
AUTOSTART = 'autostart'
# a reason for the caller of the service; {} is the name
READ_ONLY = (
    '{} is read-only: the node uses the value that it is started with, which is the one that the '
    'recording of a run holds'
)


class _Common(Struct):
    """Of every node."""

    # simulated time that waits for every answer, or the wall clock
    mode: Annotated[str, Choice(*contract.MODES)]
    recorders: Annotated[int, Range(0, 10, 'recorders that must be listening before it starts')]
    base: str  # file of what is not given; '': the node's own
    realtime: scheduling.SchedulingOptions


class _Managed(Struct):
    """Of managed nodes."""

    autostart: bool  # whether the node configures and activates itself when it starts


COMMON = parameters.leaves(_Common)
MANAGED = COMMON | parameters.leaves(_Managed)
_DEFAULTS = parameters.flatten(_Common(contract.MODES[0], 0, '', scheduling.DEFAULTS))
_DEFAULTS |= parameters.flatten(_Managed(autostart=True))
_MEANINGS = parameter_docs.field_comments(_Managed)
_SOURCE = 'command line or parameter file'
NO_SOURCES: Mapping[str, str] = {}
# what rclpy declares for every node
OF_ROS = ('use_sim_time', 'start_type_description_service', 'qos_overrides.')


class Declaration(NamedTuple):
    """One parameter as it is declared."""

    name: str
    value: Any
    leaf: Leaf
    description: str


def resolve(
    cls: type,
    defaults: Path,
    given: Mapping[str, Any],
    sources: Mapping[str, str] = NO_SOURCES,
    common: Mapping[str, Leaf] = MANAGED,
) -> tuple[Any, tuple[Declaration, ...]]:
    """Return the parameters of a node and what to declare, those of `common` included.

    `given` are values by dotted name; what they leave out comes from `given['base']` or the file
    `defaults`. `sources` are the origins of `given`, as far as they are known. `common` are those
    that do not belong to `cls`: MANAGED, or COMMON of other nodes. Raises ParameterError
    `<source>: <name>: <what>`.
    """

    def source(key):
        if key in given:
            return sources.get(key, _SOURCE)
        return file.sources.get(key, str(path))

    own = parameters.leaves(cls)
    known = {**common, **own}
    for name in given:
        if name not in known and not name.startswith(OF_ROS):
            what = parameters.describe_group(name, known)
            what = what or f'this node has no such parameter{closest(name, known)}'
            raise ParameterError(f'{source(name)}: {name}: {what}')
    path = _defaults_path(given, defaults, source)
    file = parameters.read_file(path, defaults.parent)
    overrides = {k: _from_ros(known[k], v) for k, v in given.items() if k in known}
    values = file.values | overrides
    checked = {
        name: parameters.check(leaf, values.get(name, _DEFAULTS[name]), name, source)
        for name, leaf in common.items()
    }
    own_values = {key: value for key, value in values.items() if key in own or key not in common}
    params = parameters.build(cls, own_values, source)
    final = {**checked, **parameters.flatten(params)}
    meanings = {**_MEANINGS, **file.comments}
    descriptions = {
        name: '; '.join(filter(None, (meanings.get(name), leaf.allowed)))
        for name, leaf in known.items()
    }
    return params, tuple(Declaration(k, final[k], v, descriptions[k]) for k, v in known.items())


def describe_common() -> tuple[GroupDoc, ...]:
    """Return what `parameter_docs.describe` says of the parameters of COMMON and MANAGED."""
    file = parameters.ParameterFile(_DEFAULTS, {}, {}, None)
    return tuple(g for cls in (_Common, _Managed) for g in parameter_docs.describe(cls, file))


def describe_defaults(cls: type, given: Mapping[str, Any], defaults: Path) -> str:
    """Return how many parameters of a node come from the file of its defaults, as text.

    They are named if they are at most half of all.
    """
    path = _defaults_path(given, defaults, lambda key: _SOURCE)
    own = parameters.leaves(cls)
    values = parameters.read_file(path, defaults.parent).values
    missing = [name for name in values if name in own.keys() - given]
    summary = f'{len(missing)} of {len(own)} parameters are not given and come from {path}'
    few = 0 < len(missing) <= len(own) / 2
    return f'{summary}: {", ".join(missing)}' if few else summary


def find_config(package: str, name: str, parameter: str = '') -> Path:
    """Return the path of a parameter file: a bare name is a file in the package's config/.

    A name with a path separator is a path, relative to the working directory or to the home
    directory (`~`). Raises FileNotFoundError, one line, if there is no such file: it lists the
    files of config/ that have `parameter`, a dotted name, or all without one.
    """
    if os.sep in name:
        # not Path.expanduser, which raises for an unknown user
        path = Path(os.path.expanduser(name))
        if not os.path.isfile(path):
            raise FileNotFoundError(f'there is no file {name} (seen from {Path.cwd()})')
        return path
    try:
        path = share.path(package, 'config', name)
        if os.path.isfile(path):
            return path
    except FileNotFoundError:
        pass
    files = sorted(share.path(package, 'config').glob('*.yaml'))
    if parameter:
        files = [file for file in files if parameter in parameters.read_file(file).values]
    raise FileNotFoundError(
        f'package {package} has no file config/{name}; it has '
        f'{", ".join(file.name for file in files)}; '
        f'a file elsewhere needs a path, such as .{os.sep}{name}'
    )


def find_named_config(
    package: str, option: str, name: str, parameter: str, sources: Mapping[str, str] = NO_SOURCES
) -> Path:
    """Return the path of the file that a parameter or option names; see `find_config`.

    Raises ParameterError `<source>: <option>: <what>`, with a source if `sources` has it.
    """
    try:
        return find_config(package, name, parameter)
    except FileNotFoundError as error:
        source = f'{sources[option]}: ' if option in sources else ''
        raise ParameterError(f'{source}{option}: {error}') from None


def _defaults_path(given, defaults, source):
    """Return the file of the defaults: `base` as given, a bare name beside `defaults`."""
    base = parameters.check(COMMON[BASE], given.get(BASE, ''), BASE, source)
    if not base:
        return defaults
    name = os.path.expanduser(base)
    path = Path(name) if os.sep in name else defaults.parent / name
    if not os.path.isfile(path):  # false of a name that is too long, too
        raise ParameterError(f'{source(BASE)}: {BASE}: there is no file {path}')
    return path


def _from_ros(leaf, value):
    """Return a value that ROS gives: it reads `[]` as no value, and no value as the word null."""
    if leaf.many and value is None:
        return ()
    return None if leaf.optional and value == 'null' else value
