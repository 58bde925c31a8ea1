"""Run files: what `experiments run` drives, written down as YAML.

scenario: double_lane_change_limit.yaml
controllers: [mpcc, ./my_mpcc.yaml]
settings:
  plant.friction: 0.9
labels: [wet]

Only `scenario` has to be there. Files are relative to the folder of the run file; those that a
setting names are as in `--set`. There is one label for all controllers, or one for each.
"""

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, NamedTuple

from experiments.configuration import node_config, set_option
from msgs_yaml.missing_file import YAML_SUFFIXES
from msgs_yaml.strict_yaml import Pattern, YamlError, parse_value, read

KEYS = ('scenario', 'controllers', 'settings', 'labels')
NAME = Annotated[str, Pattern(r'\S.*', 'a name or a file')]
LABEL = Annotated[str, Pattern(node_config.LABEL_FORM.pattern, node_config.LABEL_ALLOWED)]


class RunFile(NamedTuple):
    """The content of a run file; all but the scenario may be empty."""

    scenario: str  # a name, or the path of a file
    controllers: Sequence[str] = ()  # likewise
    settings: Mapping[str, Mapping[str, Any]] = node_config.NO_OVERRIDES  # by role and dotted name
    origins: Mapping[str, Mapping[str, str]] = node_config.NO_OVERRIDES  # of the settings
    labels: Sequence[str] = ()  # one for all controllers, or one for each


def load(scenario_or_file: str) -> RunFile:
    """Return the run file at a path; of any other name or file the run of that scenario.

    A run file is a mapping with a key of KEYS, of which no scenario file has one. Raises BagError
    that names file, line, key and what is allowed.
    """
    path = Path(scenario_or_file).expanduser()
    if path.suffix not in YAML_SUFFIXES or not path.is_file():
        return RunFile(scenario_or_file)
    try:
        root = read(path)
        if not any(name in KEYS for name in root.items()):
            return RunFile(scenario_or_file)
    except YamlError:  # told in the words of a scenario
        return RunFile(scenario_or_file)
    members = root.members(KEYS[:1], KEYS[1:])
    scenario = _relative(path, parse_value(NAME, members['scenario']))
    controllers, labels = (
        parse_value(tuple[kind, ...], members[name]) if name in members else ()
        for name, kind in (('controllers', NAME), ('labels', LABEL))
    )
    for name, given in (('controllers', controllers), ('labels', labels)):
        if name in members and not given:
            raise members[name].error('is empty; allowed at least one')
    if len(labels) > 1 and len(labels) != len(controllers):
        allowed = ' or '.join(dict.fromkeys(('1', str(len(controllers) or 1))))
        raise members['labels'].error(f'has {len(labels)} labels; allowed {allowed}')
    settings: dict[str, dict[str, Any]] = {}
    origins: dict[str, dict[str, str]] = {}
    for name, item in members['settings'].items().items() if 'settings' in members else ():
        role, _, parameter = name.partition('.')
        if role not in node_config.ROLES or not parameter:
            allowed = ', '.join(f'{role}.*' for role in node_config.ROLES)
            raise item.error(f'is no setting{set_option.closest_setting(name)}; allowed {allowed}')
        settings.setdefault(role, {})[parameter] = set_option.file_value(item)
        origins.setdefault(role, {})[parameter] = f'{path}:{item.line}: {item.key}'
    files = tuple(_relative(path, name) for name in controllers)
    return RunFile(scenario, files, settings, origins, labels)


def _relative(path, word):
    """Return a name as it is, and a file as seen from here."""
    is_file = os.sep in word or Path(word).suffix
    return os.path.normpath(path.parent / os.path.expanduser(word)) if is_file else word


def with_options(
    run: RunFile, controllers: Sequence[str], settings: Sequence[str], label: str
) -> RunFile:
    """Return a run with what the command line gives besides, which wins. Raises BagError."""
    overrides = {role: dict(values) for role, values in run.settings.items()}
    origins = {role: dict(values) for role, values in run.origins.items()}
    for role, values in set_option.parse_overrides(settings).items():
        overrides.setdefault(role, {}).update(values)
        for name in values:
            origins.get(role, {}).pop(name, None)
    return run._replace(
        controllers=controllers or run.controllers or ('mpcc',),
        settings=overrides,
        origins=origins,
        # a label for each controller is that of the controllers of the file
        labels=(label,) if label else () if controllers and len(run.labels) > 1 else run.labels,
    )
