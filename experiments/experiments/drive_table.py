"""A table of drives, read by a person: of `experiments batch`, `library`, and others of their form.

One row per drive: the columns before `error` say which drive it is, those after it what came out. A
drive with an error has no results and is left out.

A metric is summarised over the values of columns: medians and quantiles, or shares with the Wilson
score interval of 95 %, which takes drives for independent: with `run` beyond 1 or few draws the
intervals are too narrow. Differences of two controllers have a bootstrap interval of their mean,
resampled by draw, or by run where nothing is drawn (`DriveTable.units`): scenarios and settings
with the same draw count once.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas

from bags.errors import BagError
from experiments import row_runner
from experiments.statistical_inference import bootstrap_interval, wilson_interval
from msgs_yaml.strict_yaml import closest

ERROR = 'error'
RUN, DRAW = 'run', 'draw'
REPEAT = (RUN, 'offset')  # columns, or beginnings of their names, of what is repeated
OF_DRAW = (DRAW, 'family', 'seed')  # columns that tell draws apart
SCENARIO = 'scenario'
CONTROLLER = 'controller'
LEVELS = 12  # distinct numbers of a column; more are put into bins
BINS = 5
QUANTILES = {'q05': 0.05, 'q25': 0.25, 'median': 0.5, 'q75': 0.75, 'q95': 0.95}
RESAMPLES, SEED = 2000, 0


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


def levels(values: pandas.Series, bins: int) -> pandas.Series:
    """Return values as groups: as they are, or many numbers as `bins` intervals of equal counts."""
    if values.dtype == bool or not pandas.api.types.is_numeric_dtype(values):
        return values
    if values.nunique() <= LEVELS:
        return values
    return pandas.qcut(values, bins, duplicates='drop')


def level_text(level: Any) -> str:
    """Return a group, or a value of a summary, as text; a dash where there is none."""
    if level is None or level != level:
        return '–'
    if isinstance(level, pandas.Interval):
        return f'{level.left:.4g} to {level.right:.4g}'
    return f'{level:.4g}' if isinstance(level, float) else str(level)


def plain(value: Any) -> Any:
    """Return a value of a summary as a file takes it: an interval as text."""
    return level_text(value) if isinstance(value, pandas.Interval) else value


def summarise(
    table: DriveTable, metric: str, by: Sequence[str], bins: int = BINS
) -> pandas.DataFrame:
    """Return a row per combination of groups of the columns `by`.

    Columns: those of `by`, `drives`, `missing` (without a value of the metric), and `share`, `low`,
    `high` of a metric that is true or false, the quantiles of any other. Raises BagError.
    """
    values = table.metric(metric)
    rows = []
    for key, numbers in _groups(table, by, bins):
        chosen = values[numbers]
        known = chosen.dropna()
        counts = {'drives': len(chosen), 'missing': len(chosen) - len(known)}
        if values.dtype == 'boolean':
            summary = {'share': np.nan, 'low': np.nan, 'high': np.nan}
            if len(known):
                low, high = wilson_interval(int(known.sum()), len(known))
                summary = {'share': float(known.mean()), 'low': low, 'high': high}
        else:
            summary = {name: float(known.quantile(share)) for name, share in QUANTILES.items()}
        rows.append({**dict(zip(by, key)), **counts, **summary})
    return pandas.DataFrame(rows)


def _groups(table, by, bins):
    """Yield the key of each group and the labels of its rows, in the order of the values."""
    if not by:
        yield (), table.rows.index
        return
    keys = [levels(table.column(name, '--by'), bins) for name in by]
    for key, group in table.rows.groupby(keys, observed=True, dropna=False, sort=True):
        yield key if isinstance(key, tuple) else (key,), group.index


def compare(
    table: DriveTable,
    metric: str,
    pair: tuple[str, str],
    by: Sequence[str] = (),
    bins: int = BINS,
) -> pandas.DataFrame:
    """Return the metric of the first controller minus that of the second, drive by drive.

    A row per group of the columns `by`: `pairs` (of drives that both have a value in), `mean` with
    its bootstrap interval `low` to `high`, `median`, and how often it is `greater` and `less`. A
    metric that is true or false counts 1 and 0: `mean` is the difference of the shares where every
    unit (`units`) has as many pairs, for it is the mean of their means. Raises BagError for
    controllers without a drive, and where none can be paired.
    """
    table.column(CONTROLLER, '--pair')
    grouped = table._replace(rows=table.rows.assign(_value=table.metric(metric).astype(float)))
    same = [name for name in table.inputs if name != CONTROLLER]
    sides = []
    for name in pair:
        rows = grouped.rows[grouped.rows[CONTROLLER] == name]
        if rows.empty:
            known = [str(controller) for controller in table.rows[CONTROLLER].unique()]
            raise BagError(
                f'--pair: no drive of {name!r}; there are {", ".join(known)}{closest(name, known)}'
            )
        sides.append(rows[[*same, '_value']])
    paired = sides[0].merge(sides[1], on=same, suffixes=('_1', '_2'))
    paired = paired.dropna(subset=['_value_1', '_value_2'])
    if paired.empty:
        raise BagError(f'--pair: {pair[0]} and {pair[1]} share no drive with a value of {metric}')
    for name in by:
        if name not in same:
            raise BagError(f'--by {name}: goes with --pair only for {", ".join(same)}')
    paired['_difference'] = paired['_value_1'] - paired['_value_2']
    rng = np.random.default_rng(SEED)
    both = table._replace(rows=paired)
    return pandas.DataFrame(
        {**dict(zip(by, key)), **_difference(paired.loc[numbers], table, rng)}
        for key, numbers in _groups(both, by, bins)
    )


def _difference(paired, table, rng):
    values = paired['_difference']
    by_unit = values.groupby(table.units(paired)).mean().to_numpy()
    batch = max(1, 1_000_000 // len(by_unit))
    low, high = bootstrap_interval(by_unit, np.mean, RESAMPLES, batch, rng)
    return {
        'pairs': len(values),
        'mean': float(by_unit.mean()),
        'low': low,
        'high': high,
        'median': float(values.median()),
        'greater': int((values > 0.0).sum()),
        'less': int((values < 0.0).sum()),
    }


def repeats(table: DriveTable) -> bool:
    """Tell whether some drives are repeats of others, which Wilson's intervals do not know."""
    names = [name for name in table.inputs if name.partition('.')[0] in REPEAT]
    return any(table.rows[name].nunique() > 1 for name in names)
