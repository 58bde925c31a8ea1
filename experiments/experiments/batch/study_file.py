"""The study of a batch: a YAML file that says which scenarios, controllers and settings to combine.

schema: 1
scenarios: [double_lane_change, ./roads/*.yaml]
families: [pop_up]
controllers: [mpcc, ./my_mpcc.yaml]
set:
  plant.command_delay_ms: [0, 20]
draw:
  scenario.friction: {uniform: [0.4, 1.0]}
  controller.tolerances.velocity_mps: {log_uniform: [1.0, 30.0]}
draws: 256
runs: 20
seed: 1
"""

import glob
import os
from collections.abc import Sequence
from math import prod
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple

from bags.errors import BagError
from experiments.batch import distributions
from experiments.batch.distributions import MAX_DRAWS, Distribution
from experiments.configuration import set_option
from experiments.configuration.inputs import PLANT_CAR
from experiments.drive_row import ROLES, SCENARIO_SETTINGS, SCENARIO_SPEED
from experiments.families.draw import LIBRARY, NOMINAL
from experiments.simulation import PLANT_SETTINGS
from msgs_yaml.strict_yaml import (
    EMPTY,
    Item,
    Pattern,
    closest,
    leaf_of,
    parse_value,
    read,
)
from node_runtime.parameters import Range

SETTING_NAMES = f'plant.*, controller.*, {", ".join(SCENARIO_SETTINGS)}'
MAX_DRIVES, MAX_RUNS = 200_000, 10_000
SEED = 1
SEEDS = Range(0, 2**32 - 1, '-')
SUFFIXES = ('.yaml', '.yml')
Name = Annotated[str, Pattern(r'\S.*', 'a name or a file')]
FIELDS = {
    'schema': Literal[1],
    'scenarios': tuple[Name, ...],
    'families': tuple[Literal[tuple(LIBRARY)], ...],
    'difficulty': Literal['nominal', 'hard'],
    'controllers': tuple[Name, ...],
    'set': None,  # names that only the nodes know
    'draw': None,
    'draws': Annotated[int, Range(1, MAX_DRIVES, 'draws')],
    'first_draw': Annotated[int, Range(0, MAX_DRAWS - MAX_DRIVES, '-')],
    'runs': Annotated[int, Range(1, MAX_RUNS, 'runs')],
    'seed': Annotated[int, SEEDS],
}
REQUIRED = ('schema', 'controllers')
OF_DRAWS = ('draws', 'first_draw')


class Setting(NamedTuple):
    """One parameter and the values that are tried."""

    name: str  # plant.friction, controller.tolerances.lag_m, scenario.speed_mps
    values: tuple[Any, ...]
    items: Sequence[Item]  # the values in the file, for errors


class Drawn(NamedTuple):
    """One parameter whose value is drawn."""

    name: str
    distribution: Distribution
    item: Item  # in the file, for errors


class StudyFile(NamedTuple):
    """What a study combines."""

    path: Path
    text: str
    scenarios: tuple[str, ...]  # names, and paths of files
    families: tuple[str, ...]  # of the scenario library
    difficulty: str  # of the families
    controllers: tuple[str, ...]  # names, and paths of files
    settings: tuple[Setting, ...]
    drawn: tuple[Drawn, ...]
    draws: range  # their numbers
    runs: int  # of every combination
    seed: int  # of draws, families and perturbations

    @property
    def drives(self) -> int:
        """The number of drives."""
        roads = len(self.scenarios) * (len(self.draws) if self.drawn else 1)
        roads += len(self.families) * len(self.draws)
        values = prod(len(setting.values) for setting in self.settings)
        return roads * len(self.controllers) * self.runs * values


def load(path: Path) -> StudyFile:
    """Return the study of a file; files that it names are relative to its folder.

    Raises BagError that names file, line, field and what is allowed.
    """
    study = _parse(Path(path), read(path))
    if study.drives > MAX_DRIVES:
        raise BagError(f'{path}: has {study.drives:,} drives; allowed at most {MAX_DRIVES:,}')
    return study


def _parse(path, root):
    members = root.members(REQUIRED, [name for name in FIELDS if name not in REQUIRED])
    values = {
        name: parse_value(FIELDS[name], member)
        for name, member in members.items()
        if FIELDS[name] is not None
    }
    for name in ('scenarios', 'families', 'controllers'):
        if values.get(name) == ():
            raise members[name].error('is empty; allowed at least one value')
    settings = []
    for item in members['set'].items().values() if 'set' in members else ():
        elements = item.elements()
        if not elements:
            raise item.error('is empty; allowed at least one value')
        name = _setting_name(item, 'set')
        settings.append(Setting(name, tuple(_value(name, value) for value in elements), elements))
    drawn = members['draw'].items().values() if 'draw' in members else ()
    drawn = tuple(map(_parse_drawn, drawn))
    names = {setting.name for setting in settings}
    for entry in drawn:
        if entry.name in names:
            raise entry.item.error('is in set, too; allowed in one of both')
        names.add(entry.name)
    if 'families' in members and SCENARIO_SPEED in names:
        raise members['families'].error(
            f'draw their own speeds; allowed without {SCENARIO_SPEED} in set and draw'
        )
    return StudyFile(
        path,
        text=path.read_text(encoding='utf-8'),
        scenarios=_expand(path.parent, members.get('scenarios'), values.get('scenarios', ())),
        families=values.get('families', ()),
        difficulty=values.get('difficulty', NOMINAL),
        controllers=_expand(path.parent, members['controllers'], values['controllers']),
        settings=tuple(settings),
        drawn=drawn,
        draws=_draws(root, members, values),
        runs=values.get('runs', 1),
        seed=values.get('seed', SEED),
    )


def _draws(root, members, values):
    """Return the numbers of the draws. Raises YamlError where they are missing or without use."""
    if not {'scenarios', 'families'} & members.keys():
        error = root._replace(key='scenarios').error
        raise error('is missing; allowed scenarios, families or both')
    if 'difficulty' in members and 'families' not in members:
        raise members['difficulty'].error('has no effect without families')
    if 'draw' in members or 'families' in members:
        if 'draws' not in members:
            where = members.get('draw', members.get('families'))
            raise where._replace(key='draws').error('is missing; allowed 1 or more')
    else:
        for name in OF_DRAWS:
            if name in members:
                raise members[name].error('has no effect without draw or families')
    first = values.get('first_draw', 0)
    return range(first, first + values.get('draws', 1))


def _expand(folder, list_item, words):
    """Return names as they are and files below the folder, patterns expanded, each once."""
    names = []
    for item, word in zip(list_item.elements() if words else (), words):
        if ':' in word and word.partition(':')[0] in LIBRARY:
            raise item.error(f'{word!r} is a draw of a family; allowed under families')
        if os.sep not in word and not word.endswith(SUFFIXES) and not glob.has_magic(word):
            names.append(word)
            continue
        path = os.path.normpath(folder / os.path.expanduser(word))
        paths = sorted(glob.glob(path, recursive=True)) if glob.has_magic(word) else [path]
        if not paths:
            raise item.error(f'{word!r} fits no file below {folder}')
        names += map(os.path.abspath, paths)
    return tuple(dict.fromkeys(names))


def _parse_drawn(item):
    name = _setting_name(item, 'draw')
    distribution = distributions.parse(item)
    if name in SCENARIO_SETTINGS:
        for fault in map(leaf_of(SCENARIO_SETTINGS[name]).fault, distribution.ends):
            if fault:
                raise item.error(fault)
    return Drawn(name, distribution, item)


def _setting_name(item, field):
    """Return the name of a parameter that can be changed. Raises YamlError for any other."""
    name = item.key.removeprefix(f'{field}.')
    role, _, parameter = name.partition('.')
    if name not in SCENARIO_SETTINGS and (role not in ROLES or not parameter):
        hint = closest(name, [*SCENARIO_SETTINGS, *(f'{role}.' for role in ROLES)])
        raise item.error(f'is no setting of a batch{hint}; allowed {SETTING_NAMES}')
    group = parameter.startswith(PLANT_CAR)
    if role == 'plant' and not group and parameter not in PLANT_SETTINGS:
        allowed = ', '.join(f'plant.{known}' for known in (*PLANT_SETTINGS, 'car.*'))
        raise item.error(f'has no effect in process; allowed {allowed}')
    return name


def _value(name, item):
    if name in SCENARIO_SETTINGS:
        return parse_value(SCENARIO_SETTINGS[name], item)
    value = set_option.file_value(item)
    if value is EMPTY:
        raise item.error('has no value; allowed a value, or null where a parameter may be left out')
    return tuple(value) if isinstance(value, list) else value
