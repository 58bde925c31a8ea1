"""The table of the tuned baseline: parameters by the S of a setting, several sets for each.

    schema: 1
    baseline: frenet
    cells:
      - S: [0.4, 0.6]          # of the settings that use these parameters
        sets:                  # one per seed of the search
          - {tolerances.contouring_m: 0.4, ...}

`experiments study settings --tuned` takes the parameters by setting: `by_setting`. A setting has
the set of the remainder of its number by their count, so that the chance in a search is spread over
the settings instead of shifting all of them.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple

import pandas as pd
import yaml

from bags.errors import BagError
from mpcc_controller.parameters import ControllerParams
from msgs_yaml.strict_yaml import Item, Range, YamlError, parse_value, read
from node_runtime import parameters

BASELINE = 'frenet'
NUMBER = Annotated[float, Range(-1e12, 1e12, '-')]


class Cell(NamedTuple):
    """Settings that share their tuned parameters."""

    low: float  # of S
    high: float
    sets: tuple[Mapping[str, float], ...]  # parameters by dotted name


Table = tuple[Cell, ...]


def load(path: Path) -> Table:
    """Return the cells of a file. Raises BagError that names file, line and what is allowed."""
    try:
        members = read(path).members(('schema', 'baseline', 'cells'))
        parse_value(Literal[1], members['schema'])
        parse_value(Literal[BASELINE], members['baseline'])
        return tuple(_cell(item) for item in members['cells'].elements())
    except YamlError as error:
        raise BagError(str(error)) from None


def _cell(item: Item) -> Cell:
    members = item.members(('S', 'sets'))
    ends = [parse_value(NUMBER, end) for end in members['S'].elements()]
    if len(ends) != 2 or not ends[0] < ends[1]:
        raise members['S'].error('must be [low, high] with low < high')
    sets = tuple(_set(node) for node in members['sets'].elements())
    if not sets:
        raise members['sets'].error('is empty; allowed at least one set of parameters')
    return Cell(*ends, sets)


def _set(item):
    known = parameters.leaves(ControllerParams)
    values = {}
    for name, member in item.items().items():
        if name not in known:
            raise member.error(f'{name} is no parameter of the controller')
        values[name] = parse_value(NUMBER, member)
    return values


def dump(table: Table) -> str:
    """Return the text of a file with these cells."""
    cells = [
        {'S': [cell.low, cell.high], 'sets': [dict(chosen) for chosen in cell.sets]}
        for cell in table
    ]
    document: dict[str, Any] = {'schema': 1, 'baseline': BASELINE, 'cells': cells}
    return yaml.safe_dump(document, sort_keys=False, width=100)


def parameters_of(table: Table, number: int, S: float) -> Mapping[str, float]:
    """Return the parameters of the setting of a number and an S, that of the nearest cell."""
    cell = min(table, key=lambda cell: max(cell.low - S, S - cell.high, 0.0))
    return cell.sets[number % len(cell.sets)]


def by_setting(table: Table, demands: Mapping[int, float]) -> pd.DataFrame:
    """Return the parameters as columns by setting, from the S of each setting by its number."""
    rows = {number: dict(parameters_of(table, number, S)) for number, S in demands.items()}
    return pd.DataFrame.from_dict(rows, orient='index').rename_axis('setting')
