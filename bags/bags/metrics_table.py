"""The metrics of a comparison as a table for a person and as CSV: a column per run.

Rows, titles and units come from the registry of metrics.
"""

import csv
import io
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from rich import box
from rich.table import Table
from rich.text import Text

from bags.evaluation.drive import Drive
from bags.evaluation.flattening import flatten
from bags.evaluation.metrics.registry import Metric, table_metrics
from bags.figures.style import TUNED

CSV_FILE = 'comparison.csv'
COLOURS = {True: 'green', False: 'red', None: ''}
PAPER_NOTE = (
    'paper: solve times printed there for its MPCC (FORCESPro on a dSPACE DS6001, another '
    'computer); no other row has a number of the paper'
)
COLOUR_NOTE = (
    'Green is as it should be, red is not. Without colour: neither good nor bad, or good in a run '
    'that left the road or lost control'
)
OF_PAPER = 'of_paper'  # in comparison.json, where the runs drove the manoeuvre of the paper
# x and y [m] of the obstacles of that manoeuvre and its desired speed, as in the scenario
# `double_lane_change`: this package reads no scenario, a test holds both together
PAPER_OBSTACLES_M = ((68.2, 1.10), (122.0, 2.45))
PAPER_SPEED_MPS = 20.8
SPEED_TOLERANCE_MPS = 0.1
MOST_COLUMNS = 6  # more runs are rows, with the metrics below
OF_MANY = ('min_v2o_m', 'min_v2e_m', 'peak_sideslip_deg', 'min_speed_mps', 'rms_contouring_m')
ABSENT = '–'
SPUN = 'spun'  # value of lost_how


class Cell(NamedTuple):
    """One value as text; `good` says whether it is, None where that has no meaning."""

    text: str
    good: bool | None = None


class Line(NamedTuple):
    """One row of the table: a cell per run, and the paper's number or ''."""

    title: str
    unit: str
    cells: list[Cell]
    paper: str


def table_lines(runs: Mapping[str, Mapping[str, Any]]) -> list[Line]:
    """Return the rows of a comparison of `runs`, metrics by run name as in comparison.json."""
    return [line for metric in table_metrics() for line in _lines(metric, runs)]


def _lines(metric, runs) -> Iterator[Line]:
    values = [run[metric.name] for run in runs.values()]
    if metric.optional and all(value is None for value in values):
        return
    keys = {'': metric.title}
    if any(isinstance(value, Mapping) for value in values):
        keys = {key: metric.labels.get(key, key) for value in values for key in value}
    for key, label in keys.items():
        single = [value.get(key) if key else value for value in values]
        cells = [cell(metric, value, run) for value, run in zip(single, runs.values())]
        paper = f'{metric.paper[key]:.{metric.decimals}f}' if key in metric.paper else ''
        yield Line(metric.title.format(label), metric.unit, cells, paper)


def cell(metric: Metric, value: Any, run: Mapping[str, Any]) -> Cell:
    """Return the single value of a metric as text; `run` are all metrics of its run."""
    if metric.until_spin and run.get('lost_how') == SPUN:
        return Cell(SPUN)
    if value is None:
        return Cell(ABSENT)
    if isinstance(value, bool):
        good = value == metric.good_when
        # a good value is green only in a run that is sound; a bad one is red in every run
        text = metric.yes.format(**run) if value else 'no'
        return Cell(text, None if good and (run.get('lost') or run.get('left_road')) else good)
    if isinstance(value, list):
        texts = [f'{item["amount_m"]:.2f} at {item["x_m"]:.0f}' for item in value]
        return Cell('\n'.join(texts) or 'none')
    return Cell(f'{value:.{metric.decimals}f}')


def chosen_cells(chosen: Iterable[Metric], run: Mapping[str, Any]) -> list[Text]:
    """Return the coloured cells of chosen metrics in the row of a run."""
    cells = (cell(metric, run[metric.name], run) for metric in chosen)
    return [Text(value.text, COLOURS[value.good]) for value in cells]


def narrow_table(title: str) -> Table:
    """Return an empty table without lines: three controllers fit into 80 characters."""
    look = {'box': box.SIMPLE_HEAD, 'show_edge': False, 'pad_edge': False, 'padding': (0, 1, 0, 0)}
    return Table(title=title, title_justify='left', **look)


def build_table(comparison: Mapping[str, Any]) -> Table:
    """Return the table of a comparison (the dictionary of comparison.json).

    A column per run with every metric; of more than MOST_COLUMNS runs a row each, with OF_MANY.
    """
    runs = comparison['runs']
    if len(runs) > MOST_COLUMNS:
        return _build_rows(comparison)
    table = narrow_table(f'Scenario {comparison["scenario"]}')
    with_paper = comparison.get(OF_PAPER, False)
    if with_paper:
        table.caption, table.caption_justify = PAPER_NOTE, 'left'
    table.add_column('metric', no_wrap=True)
    table.add_column('unit', no_wrap=True)
    for name in runs:
        cut = name in comparison.get('damage', {})
        # on two lines, so that three of them fit into 80 characters, too
        shown = f'{name.removesuffix(TUNED)}\n{TUNED[1:]}' if name.endswith(TUNED) else name
        table.add_column(f'{shown}, bag cut' if cut else shown, justify='right', no_wrap=True)
    if with_paper:
        table.add_column('paper', justify='right', style='dim', no_wrap=True)
    for line in table_lines(runs):
        cells = [Text(cell.text, COLOURS[cell.good]) for cell in line.cells]
        table.add_row(line.title, line.unit, *cells, *([line.paper] if with_paper else []))
    return table


def _build_rows(comparison):
    table = narrow_table(f'Scenario {comparison["scenario"]} (every metric: {CSV_FILE}, report)')
    table.add_column('run', no_wrap=True)
    chosen = [metric for metric in table_metrics() if metric.name in OF_MANY]
    for metric in chosen:
        unit = f' [{metric.unit}]' if metric.unit else ''
        table.add_column(Text(f'{metric.title}{unit}'), justify='right')
    for name, run in comparison['runs'].items():
        cut = ', bag cut' if name in comparison.get('damage', {}) else ''
        table.add_row(Text(f'{name}{cut}'), *chosen_cells(chosen, run))
    return table


def drives_of_paper(drives: Iterable[Drive]) -> dict[str, bool]:
    """Return what comparison.json says of drives that all were the manoeuvre of the paper."""
    return {OF_PAPER: True} if all(map(_is_of_paper, drives)) else {}


def _is_of_paper(drive):
    desired_mps = drive.scene.desired_mps
    if desired_mps is None or abs(desired_mps - PAPER_SPEED_MPS) > SPEED_TOLERANCE_MPS:
        return False
    places = [(obstacle.x, obstacle.y) for obstacle in drive.scene.obstacles]
    if len(places) != len(PAPER_OBSTACLES_M):
        return False
    return all(
        np.allclose(np.column_stack(place), expected)
        for place, expected in zip(places, PAPER_OBSTACLES_M)
    )


def metrics_csv(runs: Mapping[str, Mapping[str, Any]]) -> str:
    """Return the CSV of `runs`: a row per number, a column per run, every digit.

    Rows are named by their path in comparison.json, as in `min_v2o_per_obstacle_m.1` or
    `overshoots.0.x_m`; what a run does not have is an empty cell.
    """
    columns = {name: flatten(run) for name, run in runs.items()}
    rows = dict.fromkeys(row for column in columns.values() for row in column)
    cells = ([row, *(column.get(row) for column in columns.values())] for row in rows)
    return csv_text(['metric', *columns], cells)


def csv_text(header: Sequence[str], rows: Iterable[Sequence[Any]], names: int = 1) -> str:
    """Return a CSV with every digit, and nothing where there is no value.

    The first `names` cells of a row are texts, the others JSON values.
    """
    out = io.StringIO()
    writer = csv.writer(out, lineterminator='\n')
    writer.writerow(header)
    for row in rows:
        texts = (str(v).lower() if isinstance(v, bool) else repr(v) for v in row[names:])
        shown = ('' if v is None else text for v, text in zip(row[names:], texts))
        writer.writerow([*row[:names], *shown])
    return out.getvalue()
