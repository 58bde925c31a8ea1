"""Parameter files of ROS with sections for several nodes, as parameters of the nodes of a run."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from bags.errors import BagError
from experiments.configuration.node_config import ROLES
from msgs_yaml.strict_yaml import Item, YamlError, closest, read

EVERY_NODE, ANY_NAMESPACE = '/**', '/**/'
PARAMETERS = 'ros__parameters'


def read_files(
    paths: Sequence[str], namespace: str = ''
) -> tuple[dict[str, dict[str, Any]], dict[str, dict[str, str]]]:
    """Return values and sources (<file>:<line>) of parameters in files, by role and dotted name.

    Of a parameter that several files set, the last one counts.

    A section is for the node that it names (`plant`, `/plant`, `/**/plant`, or with the `namespace`
    of the run `/car1/plant`), or for every node (`/**`). Raises BagError for a file that cannot be
    read, and `<file>:<line>: <key>: <what>` for a section of another node.
    """
    parameters = ({}, {})
    for path in paths:
        try:
            _read_file(Path(path).expanduser(), namespace, parameters)
        except (OSError, YamlError) as error:
            raise BagError(str(error)) from None
    return parameters


def _read_file(path, namespace, collected):
    own = f'/{namespace.strip("/")}/'.replace('//', '/')
    for section, item in read(path).items().items():
        prefixes = (prefix for prefix in (ANY_NAMESPACE, own, '/') if section.startswith(prefix))
        name = section.removeprefix(next(prefixes, ''))
        roles = ROLES if section == EVERY_NODE else (name,)
        if roles[0] not in ROLES:
            known, hint = ', '.join(ROLES), closest(name, ROLES)
            raise item.error(f'no node of this run; allowed {known}, {EVERY_NODE}{hint}')
        parameters = item.members((PARAMETERS,))[PARAMETERS]
        leaves = dict(_leaves(parameters, ''))
        for role in roles:
            values, sources = (by_role.setdefault(role, {}) for by_role in collected)
            values.update({name: leaf.value_or_empty() for name, leaf in leaves.items()})
            sources.update({name: f'{path}:{leaf.line}' for name, leaf in leaves.items()})


def _leaves(item: Item, prefix):
    for name, member in item.items().items():
        key = f'{prefix}{name}'
        if member.node.id == 'mapping':
            yield from _leaves(member, f'{key}.')
        else:
            yield key, member
