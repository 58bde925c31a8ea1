"""The study of a batch: a YAML file that says which scenarios, controllers and settings to combine.

schema: 1
scenarios: [double_lane_change, ./roads/*.yaml]
controllers: [mpcc, ./my_mpcc.yaml]
set:
  plant.friction: [0.8, 0.9, 1.0]
  scenario.speed_mps: [18.0, 20.0]
runs: 20
seed: 1
"""

import glob
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple

from bags.errors import BagError
from experiments.simulation import PLANT_SETTING_GROUP, PLANT_SETTINGS
from experiments.study.run_spec import MAX_RUNS, SEED
from msgs_yaml.strict_yaml import Item, YamlError, closest, read
from node_runtime.parameters import SPEED, Range
from node_runtime.typed_yaml import Pattern, parse_value

SCENARIO_SPEED = 'scenario.speed_mps'  # replaces the desired speed by a constant
ROLES = ('plant', 'controller')
SETTING_NAMES = f'plant.*, controller.* and {SCENARIO_SPEED}'
MAX_DRIVES = 200_000
SEEDS = Range(0, 2**32 - 1, '-')
SUFFIXES = ('.yaml', '.yml')
Name = Annotated[str, Pattern(r'\S.*', 'a name or a file')]
FIELDS = {
    'schema': Literal[1],
    'scenarios': tuple[Name, ...],
    'controllers': tuple[Name, ...],
    'set': None,  # names that only the nodes know
    'runs': Annotated[int, Range(1, MAX_RUNS, 'runs')],
    'seed': Annotated[int, SEEDS],
}
REQUIRED = ('schema', 'scenarios', 'controllers')


class Setting(NamedTuple):
    """One parameter and the values that are tried."""

    name: str  # plant.friction, controller.tolerances.lag_m, scenario.speed_mps
    values: tuple[Any, ...]
    items: tuple[Item, ...]  # the values in the file, for errors


class StudyFile(NamedTuple):
    """What a study combines."""

    path: Path
    text: str
    scenarios: tuple[str, ...]  # names, and paths of files
    controllers: tuple[str, ...]  # likewise
    settings: tuple[Setting, ...]
    runs: int  # of every combination
    seed: int  # of the perturbations

    def __repr__(self) -> str:
        return f'StudyFile({str(self.path)!r}, {self.drives} drives)'

    @property
    def drives(self) -> int:
        """The number of drives."""
        count = len(self.scenarios) * len(self.controllers) * self.runs
        for setting in self.settings:
            count *= len(setting.values)
        return count


def load(path: Path) -> StudyFile:
    """Return the study of a file; files that it names are relative to its folder.

    Raises BagError that names file, line, field and what is allowed.
    """
    try:
        study = _parse(Path(path), read(path))
    except YamlError as error:
        raise BagError(str(error)) from None
    if study.drives > MAX_DRIVES:
        raise BagError(f'{path}: has {study.drives:,} drives; allowed at most {MAX_DRIVES:,}')
    return study


def _parse(path, root):
    members = root.items()
    for name, member in members.items():
        if name not in FIELDS:
            raise member.error(f'unknown key{closest(name, FIELDS)}; allowed {", ".join(FIELDS)}')
    for name in REQUIRED:
        if name not in members:
            raise root._replace(key=name).error('is missing')
    values = {
        name: parse_value(FIELDS[name], member)
        for name, member in members.items()
        if FIELDS[name] is not None
    }
    settings = members['set'].items().values() if 'set' in members else ()
    return StudyFile(
        path,
        path.read_text(encoding='utf-8'),
        _expand(path.parent, _filled(members['scenarios']), values['scenarios']),
        _expand(path.parent, _filled(members['controllers']), values['controllers']),
        tuple(map(_parse_setting, settings)),
        values.get('runs', 1),
        values.get('seed', SEED),
    )


def _filled(item) -> Sequence[Item]:
    """Return the elements of a list that must not be empty."""
    elements = item.elements()
    if not elements:
        raise item.error('is empty; allowed at least one value')
    return elements


def _expand(folder, items, words):
    """Return names as they are and files below the folder, patterns expanded, each once."""
    found = []
    for item, word in zip(items, words):
        if os.sep not in word and not word.endswith(SUFFIXES) and not glob.has_magic(word):
            found.append(word)
            continue
        path = os.path.normpath(folder / os.path.expanduser(word))
        paths = sorted(glob.glob(path, recursive=True)) if glob.has_magic(word) else [path]
        if not paths:
            raise item.error(f'{word!r} fits no file below {folder}')
        found += map(os.path.abspath, paths)
    return tuple(dict.fromkeys(found))


def _parse_setting(item):
    name = item.key.removeprefix('set.')
    role, _, parameter = name.partition('.')
    if name != SCENARIO_SPEED and (role not in ROLES or not parameter):
        hint = closest(name, [SCENARIO_SPEED, *(f'{role}.' for role in ROLES)])
        raise item.error(f'is no setting of a batch{hint}; allowed {SETTING_NAMES}')
    group = parameter.startswith(PLANT_SETTING_GROUP)
    if role == 'plant' and not group and parameter not in PLANT_SETTINGS:
        allowed = ', '.join(f'plant.{known}' for known in (*PLANT_SETTINGS, 'car.*'))
        raise item.error(f'has no effect in process; allowed {allowed}')
    items = tuple(_filled(item))
    if name == SCENARIO_SPEED:
        kind = Annotated[float, SPEED]
        return Setting(name, tuple(parse_value(kind, value) for value in items), items)
    return Setting(name, tuple(value.value() for value in items), items)
