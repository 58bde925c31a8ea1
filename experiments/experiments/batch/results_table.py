"""The table of a batch: one row per drive, as Parquet, and a summary for a person."""

import importlib.util
import os
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from rich.table import Table

from bags.errors import BagError
from bags.evaluation.metrics import METRICS

FILE = 'results.parquet'
# columns of results in the order of comparison.json, whatever the first drive has
ORDER = {name: place for place, name in enumerate(('verdict', *METRICS, 'solver'), start=1)}
SHARES = ('completed', 'collided', 'left_road', 'lost')

Columns = Mapping[str, Sequence[Any]]


def check_format() -> None:
    """Raise BagError where the table could not be written: before hours of drives, not after."""
    if importlib.util.find_spec('pyarrow') is None:
        raise BagError(
            f'{FILE} needs the package pyarrow, which is not installed; pip install pyarrow'
        )


def build_columns(rows: Iterable[Mapping[str, Any]]) -> dict[str, list[Any]]:
    """Return the rows as columns; what a row does not have is None in its column."""
    columns: dict[str, list[Any]] = {}
    for count, row in enumerate(rows):
        for name, value in row.items():
            columns.setdefault(name, [None] * count).append(value)
        for column in columns.values():
            if len(column) == count:
                column.append(None)
    return dict(sorted(columns.items(), key=lambda pair: ORDER.get(pair[0].partition('.')[0], 0)))


def write(columns: Columns, notes: Mapping[str, str], folder: Path) -> Path:
    """Write `folder`/results.parquet, whole or not at all; `notes` are its metadata."""
    import pyarrow
    from pyarrow import parquet

    path = folder / FILE
    part = path.with_suffix('.part')
    parquet.write_table(pyarrow.table(dict(columns)).replace_schema_metadata(dict(notes)), part)
    os.replace(part, path)
    return path


def summarise(columns: Columns) -> Table:
    """Return a table of scenarios and controllers: drives without an error, and how they ended.

    The draws of a family count as one scenario.
    """
    table = Table(box=None, padding=(0, 2, 0, 0))
    for name in ('scenario', 'controller'):
        table.add_column(name, overflow='fold', min_width=len(name))
    for name in ('drives', *(share.replace('_', '\n') for share in SHARES)):
        table.add_column(name, justify='right', min_width=max(map(len, name.split())))
    families = columns.get('family', [None] * len(columns['scenario']))
    roads = [family or scenario for family, scenario in zip(families, columns['scenario'])]
    pairs = list(zip(roads, columns['controller']))
    for pair in dict.fromkeys(pairs):
        numbers = [number for number, other in enumerate(pairs) if other == pair]
        driven = [number for number in numbers if not columns['error'][number]]
        count = f'{len(driven):,}' if driven == numbers else f'{len(driven):,} of {len(numbers):,}'
        table.add_row(*pair, count, *(_share(columns.get(name), driven) for name in SHARES))
    return table


def _share(column, numbers):
    if not numbers:
        return '–'
    return f'{sum(column[number] for number in numbers) / len(numbers):.1%}'
