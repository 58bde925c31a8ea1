"""A table of drives: one row per drive, first the columns that tell it apart, then its results.

The columns before `error` say which drive it is, those after it what came out. A drive with an
error has no results and is left out.
"""

from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas

from bags.errors import BagError
from experiments import row_runner
from msgs_yaml.strict_yaml import closest

ERROR = 'error'
RUN, DRAW = 'run', 'draw'
REPEAT = (RUN, 'offset')  # columns, or beginnings of their names, of what is repeated
OF_DRAW = (DRAW, 'family', 'seed')  # columns that tell draws apart
SCENARIO = 'scenario'
CONTROLLER = 'controller'


class DriveTable(NamedTuple):
    """Drives with results."""

    path: Path
    rows: pandas.DataFrame
    inputs: tuple[str, ...]  # the columns that tell drives apart
    failed: int  # drives with an error, which are not among the rows

    def __repr__(self) -> str:
        return f'DriveTable({str(self.path)!r}, {len(self.rows)} rows)'

    def units(self, rows: pandas.DataFrame) -> pandas.Series:
        """Return a label per row, equal for rows that are not independent of each other.

        Draw k is the same for every controller and setting, and run k for every scenario, too:
        the label is that of the draw, and of the run where nothing is drawn, or only once.
        """
        labels = pandas.Series(rows.index.astype(str), rows.index)
        if SCENARIO in self.inputs:
            labels = rows[SCENARIO].astype(str)
        if RUN in self.inputs and rows[RUN].nunique() > 1:
            labels = 'run ' + _labels(rows, [RUN, 'seed'])
        if DRAW in self.inputs:
            drawn = _labels(rows, OF_DRAW)
            if drawn.nunique() > 1:
                labels = drawn.where(rows[DRAW].notna(), labels)
        return labels

    def column(self, name: str, option: str) -> pandas.Series:
        """Return a column; raise BagError, which names the option, when there is none."""
        if name not in self.rows:
            raise BagError(
                f'{option} {name}: {self.path} has no such column{closest(name, self.rows)}'
            )
        return self.rows[name]

    def metric(self, name: str) -> pandas.Series:
        """Return a metric as numbers, or as truths (type `boolean`), missing values as NA.

        Raises BagError for another column.
        """
        values = self.column(name, '--metric').astype(object)
        known = values.dropna()
        if len(known) and all(isinstance(value, bool) for value in known):
            return values.astype('boolean')
        try:
            return values.astype(float)
        except (ValueError, TypeError):
            text = f'--metric {name}: holds words; allowed numbers, and true or false'
            raise BagError(text) from None


def load(path: Path) -> DriveTable:
    """Return the table of a folder of `experiments batch` or `library`, or of a Parquet file.

    Raises BagError when there is none, or it has no drive with a result.
    """
    file = path if path.suffix == '.parquet' else path / row_runner.TABLE
    if not file.is_file():
        raise BagError(f'{file}: there is no such table')
    try:
        rows = pandas.read_parquet(file)
    except (OSError, ValueError) as error:
        raise BagError(f'{file}: no table: {error}') from None
    if ERROR not in rows:
        raise BagError(f'{file}: has no column {ERROR!r}; allowed tables of drives')
    driven = rows[rows[ERROR].fillna('') == ''].copy()
    if driven.empty:
        raise BagError(f'{file}: no drive has a result')
    inputs = tuple(rows.columns[: rows.columns.get_loc(ERROR)])
    for name in inputs:  # a list can be no group; its text can
        driven[name] = driven[name].map(
            lambda value: str(value.tolist()) if isinstance(value, np.ndarray) else value
        )
    return DriveTable(file, driven.reset_index(drop=True), inputs, len(rows) - len(driven))


def _labels(rows, names):
    there = [name for name in names if name in rows]
    texts = [' '.join(map(str, row)) for row in rows[there].itertuples(index=False)]
    return pandas.Series(texts, rows.index, dtype=object)


def by_controller(table: DriveTable) -> dict[str, DriveTable]:
    """Return the drives of each controller, in their order; all under '' without such a column."""
    rows = table.rows
    if CONTROLLER not in rows:
        return {'': table}
    return {
        name: table._replace(rows=rows[rows[CONTROLLER] == name].reset_index(drop=True))
        for name in dict.fromkeys(rows[CONTROLLER])
    }
