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

What is drawn has a distribution:

    uniform: [low, high]
    log_uniform: [low, high]                      # 0 < low
    normal: [mean, sd], within: [low, high]       # cut off at both ends
    choice: [value, ...]                          # each with the same probability

`sample` takes the points of Sobol' (1967) with the digital scrambling of Matousek (1998), as scipy
has them, through the inverse of each distribution function. The first n draws of a longer sample
are those of a sample of n. A number of draws that is a power of two fills every dimension evenly;
other numbers lose that balance, not the uniformity.
"""

import glob
import os
import warnings
from collections.abc import Mapping, Sequence
from math import prod
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple

from bags.errors import BagError
from experiments.configuration import set_option
from experiments.configuration.inputs import PLANT_CAR
from experiments.drive_row import ROLES, SCENARIO_SETTINGS, SCENARIO_SPEED
from experiments.families.draw import LIBRARY, NOMINAL
from experiments.simulation import PLANT_SETTINGS
from msgs_yaml.strict_yaml import (
    EMPTY,
    Item,
    Pattern,
    Range,
    closest,
    leaf_of,
    parse_value,
    read,
)

PAIR = tuple[(Annotated[float, Range(-1e300, 1e300, '-')],) * 2]
MAX_DRAWS = 2**30  # distinct points that 30 bits can tell apart
MAX_SDS = 8  # beyond, a normal distribution has no probability that is worth a draw
UNIFORM, LOG_UNIFORM, NORMAL, CHOICE = KINDS = ('uniform', 'log_uniform', 'normal', 'choice')
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


class Distribution(NamedTuple):
    """How a value is drawn."""

    kind: str  # of KINDS
    ends: tuple[Any, ...]  # the least and the greatest value; of a choice every value
    mean: float = 0.0  # of a normal distribution, before it is cut off at its ends
    sd: float = 1.0  # likewise

    def value(self, share: float) -> Any:
        """Return the value below which `share`, 0 to 1, of the draws are."""
        if self.kind == CHOICE:
            return self.ends[min(int(share * len(self.ends)), len(self.ends) - 1)]
        low, high = self.ends
        if self.kind == UNIFORM:
            value = low + share * (high - low)
        elif self.kind == LOG_UNIFORM:
            value = low * (high / low) ** share
        else:
            from scipy.special import ndtr, ndtri

            # on the side of the mean where probabilities are small, and differences of them exact
            side = -1.0 if low > self.mean else 1.0
            begin, end = (ndtr(side * (edge - self.mean) / self.sd) for edge in self.ends)
            value = self.mean + self.sd * side * float(ndtri(begin + share * (end - begin)))
        # rounding may have moved it out of the interval
        return min(max(value, low), high)


def parse_distribution(item: Item) -> Distribution:
    """Return the distribution of a node of a YAML file.

    Raises YamlError, which names file, line, field and what is allowed.
    """
    members = item.items()
    names = [name for name in members if name in KINDS]
    for name, member in members.items():
        if name not in KINDS and not (name == 'within' and names == [NORMAL]):
            hint = closest(name, KINDS)
            raise member.error(f'is no distribution{hint}; allowed {", ".join(KINDS)}')
    if len(names) != 1:
        raise item.error(f'must have exactly one of {", ".join(KINDS)}')
    (kind,) = names
    own = members[kind]
    if kind == CHOICE:
        values = tuple(element.value() for element in own.elements())
        for element, value in zip(own.elements(), values):
            if isinstance(value, dict | list):
                raise element.error('is no single value; allowed numbers, true, false and words')
        if not values:
            raise own.error('is empty; allowed at least one value')
        return Distribution(kind, values)
    if kind != NORMAL:
        low, high = _interval(own)
        if kind == LOG_UNIFORM and low <= 0.0:
            raise own.error(f'begins at {low:g}; allowed above 0')
        return Distribution(kind, (low, high))
    mean, sd = parse_value(PAIR, own)
    if sd <= 0.0:
        raise own.error(f'has the standard deviation {sd:g}; allowed above 0')
    if 'within' not in members:
        raise item.error('within is missing; allowed [low, high], where the distribution is cut')
    low, high = _interval(members['within'])
    if mean + MAX_SDS * sd < low or mean - MAX_SDS * sd > high:
        raise members['within'].error(
            f'is from {low:g} to {high:g}; allowed intervals within {MAX_SDS} standard '
            f'deviations of the mean {mean:g}'
        )
    return Distribution(kind, (low, high), mean, sd)


def sample(
    distributions: Mapping[str, Distribution], count: int, seed: int, first: int = 0
) -> list[dict[str, Any]]:
    """Return draws `first` to `first + count - 1`, each with a value for every name.

    Raises ValueError for draws out of range. The dimensions belong to the names in their order:
    another name or order gives other draws.
    """
    import numpy as np
    from scipy.stats import qmc

    if first < 0 or count < 0 or first + count > MAX_DRAWS:
        raise ValueError(f'draws {first} to {first + count - 1}: allowed 0 to {MAX_DRAWS - 1}')
    if not distributions or not count:
        return [{} for _ in range(count)]
    points = qmc.Sobol(len(distributions), scramble=True, seed=np.random.default_rng(seed))
    if first:
        points.fast_forward(first)
    with warnings.catch_warnings():
        warnings.filterwarnings('ignore', 'The balance properties', UserWarning)
        shares = points.random(count)
    return [
        {name: own.value(float(share)) for (name, own), share in zip(distributions.items(), row)}
        for row in shares
    ]


def _interval(item):
    low, high = parse_value(PAIR, item)
    if not low < high:
        raise item.error(f'is from {low:g} to {high:g}; allowed [low, high] with low < high')
    return low, high


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
    distribution = parse_distribution(item)
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
