"""The metrics of a comparison as a table for a person and as CSV: a column per run.

Rows, titles and units come from the registry of metrics.
"""

import csv
import io
from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple

import numpy as np
from rich import box
from rich.table import Table
from rich.text import Text

from bags.evaluation.drive import Drive
from bags.evaluation.metrics.registry import Metric, flatten, table_metrics

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
    lines = []
    for metric in table_metrics():
        values = [run[metric.name] for run in runs.values()]
        if metric.optional and all(value is None for value in values):
            continue
        keys = {'': metric.title}
        if any(isinstance(value, Mapping) for value in values):
            keys = {key: metric.labels.get(key, key) for value in values for key in value}
        for key, label in keys.items():
            single = [value.get(key) if key else value for value in values]
            cells = [cell(metric, value, run) for value, run in zip(single, runs.values())]
            paper = f'{metric.paper[key]:.{metric.decimals}f}' if key in metric.paper else ''
            lines.append(Line(metric.title.format(label), metric.unit, cells, paper))
    return lines


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


def build_table(comparison: Mapping[str, Any], brief: bool = False) -> Table:
    """Return the table of a comparison (the dictionary of comparison.json).

    A column per run with every metric; of more than MOST_COLUMNS runs, or `brief`, a row each, with
    OF_MANY.
    """
    runs, title = comparison['runs'], f'Scenario {comparison["scenario"]}'
    # without lines, so that three controllers fit into 80 characters
    look = {'box': box.SIMPLE_HEAD, 'show_edge': False, 'pad_edge': False, 'padding': (0, 1, 0, 0)}
    table = Table(title=title, title_justify='left', **look)
    marks = {name: ', bag cut' if name in comparison.get('damage', {}) else '' for name in runs}
    if brief or len(runs) > MOST_COLUMNS:
        table.title = None if brief else f'{title} (every metric: {CSV_FILE}, report)'
        table.add_column('run', no_wrap=True)
        chosen = [metric for metric in table_metrics() if metric.name in OF_MANY]
        for metric in chosen:
            table.add_column(Text(f'{metric.title} [{metric.unit}]'), justify='right')
        for name, run in runs.items():
            cells = [cell(metric, run[metric.name], run) for metric in chosen]
            table.add_row(Text(f'{name}{marks[name]}'), *map(_coloured, cells))
        return table
    with_paper = comparison.get(OF_PAPER, False)
    if with_paper:
        table.caption, table.caption_justify = PAPER_NOTE, 'left'
    table.add_column('metric', no_wrap=True)
    table.add_column('unit', no_wrap=True)
    for name in runs:
        table.add_column(f'{name}{marks[name]}', justify='right', no_wrap=True)
    if with_paper:
        table.add_column('paper', justify='right', style='dim', no_wrap=True)
    for line in table_lines(runs):
        paper = [line.paper] if with_paper else []
        table.add_row(line.title, line.unit, *map(_coloured, line.cells), *paper)
    return table


def _coloured(cell):
    return Text(cell.text, COLOURS[cell.good])


def drives_of_paper(drives: Iterable[Drive]) -> dict[str, bool]:
    """Return what comparison.json says of drives that all were the manoeuvre of the paper."""
    for scene in (drive.scene for drive in drives):
        places = [np.column_stack([item.x, item.y]) for item in scene.obstacles]
        if (
            scene.desired_mps is None
            or abs(scene.desired_mps - PAPER_SPEED_MPS) > SPEED_TOLERANCE_MPS
            or len(places) != len(PAPER_OBSTACLES_M)
            or not all(map(np.allclose, places, PAPER_OBSTACLES_M))
        ):
            return {}
    return {OF_PAPER: True}


def metrics_csv(runs: Mapping[str, Mapping[str, Any]]) -> str:
    """Return the CSV of `runs`: a row per number, a column per run, every digit.

    Rows are named by their path in comparison.json, as in `min_v2o_per_obstacle_m.1` or
    `overshoots.0.x_m`; what a run does not have is an empty cell.
    """
    columns = {name: flatten(run) for name, run in runs.items()}
    out = io.StringIO()
    writer = csv.writer(out, lineterminator='\n')
    writer.writerow(['metric', *columns])
    for row in dict.fromkeys(row for column in columns.values() for row in column):
        values = [column.get(row) for column in columns.values()]
        texts = (str(v).lower() if isinstance(v, bool) else repr(v) for v in values)
        writer.writerow([row, *('' if v is None else text for v, text in zip(values, texts))])
    return out.getvalue()
