"""Runs of several scenarios side by side: a table by scenario, a CSV file, a figure."""

import csv
import io
import warnings
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from rich.table import Table
from rich.text import Text

from bags.errors import BagError, DamagedBagWarning
from bags.evaluation import metrics
from bags.evaluation.drive import drive_from_bag, drop_nonfinite
from bags.evaluation.flattening import flatten
from bags.evaluation.metrics.registry import Metric
from bags.evaluation.series import compute_series
from bags.figures import style
from bags.report import metrics_table
from bags.report.comparability import check_comparable
from bags.report.comparison import name_runs
from bags.storage import read
from bags.storage.bag_writer import METADATA
from bags.storage.invalid_messages import drop_invalid
from msgs_yaml.strict_yaml import closest

SHOWN = (
    *('completed', 'collided', 'left_road', 'min_v2o_m', 'min_v2e_m'),
    *('peak_sideslip_deg', 'min_speed_mps'),
)
CSV_FILE, FIGURE = 'overview.csv', 'overview'
INTERRUPTED = '.interrupted'  # suffix of the folders of runs that did not end
ROW_INCH, PANEL_INCH = 0.42, 2.6
SPREAD = 0.6  # of the height of a scenario, over which its runs are spread
MARKERS = 'osD^vP*X'


class Row(NamedTuple):
    """One run."""

    scenario: str
    run: str  # the controller, or the label
    bag: Path
    info: Mapping[str, str]  # metadata record `run`
    metrics: Mapping[str, Any]


def find_bags(paths: Sequence[Path]) -> list[Path]:
    """Return the bags at paths: bags themselves, and all below other folders.

    Below a folder, runs that were interrupted (`mpcc.interrupted`) and hidden folders are left
    out. Raises BagError for a folder without any bag.
    """
    bags: list[Path] = []
    for path in map(Path, paths):
        if not path.is_dir() or (path / METADATA).is_file():
            bags.append(path)
            continue
        below = sorted(file.parent for file in path.rglob(METADATA))
        below = [bag for bag in below if not _is_aside(bag.relative_to(path))]
        if not below:
            raise BagError(f'{path}: is no bag, and none is below it')
        bags += below
    return list(dict.fromkeys(bags))


def _is_aside(path):
    return path.suffix == INTERRUPTED or any(part.startswith('.') for part in path.parts)


def read_rows(bags: Sequence[Path]) -> list[Row]:
    """Evaluate the bags one by one, in the order of their scenarios.

    Runs of one controller in one scenario are called after their folders. Raises BagError.
    """
    rows = []
    for path in bags:
        with warnings.catch_warnings():
            warnings.simplefilter('ignore', DamagedBagWarning)
            bag = drop_invalid(read.load(path))
        drive = drop_nonfinite(drive_from_bag(bag))
        values = metrics.compute_metrics(drive, compute_series(drive))
        facts = drive.facts
        rows.append(Row(facts.scenario, facts.controller, path, bag.run_info, values))
    return [row for group in by_scenario(rows).values() for row in _named(group)]


def by_scenario(rows: Sequence[Row]) -> dict[str, list[Row]]:
    """Return the rows of each scenario, in the order in which the scenarios come first."""
    groups: dict[str, list[Row]] = {}
    for row in rows:
        groups.setdefault(row.scenario, []).append(row)
    return groups


def _named(group):
    names = name_runs([row.bag for row in group], [row.run for row in group])
    return [row._replace(run=name) for row, name in zip(group, names)]


def choose_metrics(names: Sequence[str]) -> list[Metric]:
    """Return metrics by name; BagError for an unknown one."""
    for name in names:
        if name not in metrics.METRICS:
            near = closest(name, metrics.METRICS)
            raise BagError(f'no metric {name!r}{near}; `bags compare --list-metrics` lists them')
    return [metrics.METRICS[name] for name in names]


def check_single(rows: Sequence[Row], chosen: Sequence[Metric]) -> None:
    """Raise BagError for a metric that has several values per run."""
    for metric in chosen:
        if any(isinstance(row.metrics[metric.name], (Mapping, list)) for row in rows):
            raise BagError(
                f'{metric.name} has several values per run; a column holds one '
                f'(overview.csv has all of them)'
            )


def unlike(rows: Sequence[Row]) -> Iterator[str]:
    """Yield a line for each scenario whose runs are not comparable, with the reason."""
    for group in by_scenario(rows).values():
        try:
            check_comparable([row.bag for row in group], [row.info for row in group])
        except BagError as error:
            yield str(error).partition(': their numbers')[0]


def build_table(rows: Sequence[Row], chosen: Sequence[Metric]) -> Table:
    """Return a table with a row per run, grouped by scenario, and a column per metric."""
    table = metrics_table.narrow_table('Runs by scenario')
    table.add_column('scenario, run', no_wrap=True)
    for metric in chosen:
        unit = f' [{metric.unit}]' if metric.unit else ''
        table.add_column(Text(f'{_title(metric)}{unit}'), justify='right')
    for scenario, group in by_scenario(rows).items():
        table.add_row(Text(scenario, 'bold'))
        for row in group:
            values = row.metrics
            cells = [metrics_table.cell(metric, values[metric.name], values) for metric in chosen]
            shown = [Text(cell.text, metrics_table.COLOURS[cell.good]) for cell in cells]
            table.add_row(f'  {row.run}', *shown)
    return table


def overview_csv(rows: Sequence[Row]) -> str:
    """Return a CSV of every single metric: a row per run, a column per metric."""
    flat = [flatten(row.metrics) for row in rows]
    columns = list(dict.fromkeys(name for flattened in flat for name in flattened))
    out = io.StringIO()
    writer = csv.writer(out, lineterminator='\n')
    writer.writerow(['scenario', 'run', 'bag', *columns])
    for row, flattened in zip(rows, flat):
        values = (metrics_table.csv_cell(flattened.get(name)) for name in columns)
        writer.writerow([row.scenario, row.run, row.bag, *values])
    return out.getvalue()


def draw_overview(rows: Sequence[Row], chosen: Sequence[Metric]) -> Figure:
    """Return a figure with a panel per metric that is a number, and a line per scenario."""
    drawn = [
        metric for metric in chosen if any(_is_number(row.metrics[metric.name]) for row in rows)
    ]
    if not drawn:
        raise BagError('none of these metrics is a number that could be drawn')
    scenarios = list(by_scenario(rows))
    names = list(dict.fromkeys(row.run for row in rows))
    colours = style.assign_colours(names)
    with mpl.rc_context(style.RC):
        size = 2.2 + PANEL_INCH * len(drawn), 1.5 + ROW_INCH * len(scenarios)
        figure = style.new_sheet(size, 'Runs by scenario')
        axes = np.atleast_1d(figure.subplots(1, len(drawn), sharey=True))
        for ax, metric in zip(axes, drawn):
            for k, name in enumerate(names):
                # a line of its own within the scenario: equal values stay visible
                aside = SPREAD * (k - (len(names) - 1) / 2) / len(names)
                points = [
                    (row.metrics[metric.name], scenarios.index(row.scenario) + aside)
                    for row in rows
                    if row.run == name and _is_number(row.metrics[metric.name])
                ]
                look = {'color': colours[name], 'marker': MARKERS[k % len(MARKERS)], 'ls': ''}
                ax.plot(*np.array(points).reshape(-1, 2).T, label=name, ms=6, mec='white', **look)
            unit = f' [{metric.unit}]' if metric.unit else ''
            ax.set(xlabel=f'{_title(metric)}{unit}', ylim=(len(scenarios) - 0.5, -0.5))
        axes[0].set_yticks(range(len(scenarios)), scenarios)
        keys = axes[0].get_legend_handles_labels()
        figure.legend(*keys, loc='outside upper right', ncols=len(names))
    return figure


def write_overview(rows: Sequence[Row], chosen: Sequence[Metric], out: Path) -> dict[str, Path]:
    """Write CSV and figure into the folder `out`; return their paths by what they are."""
    figure = draw_overview(rows, chosen)
    out.mkdir(parents=True, exist_ok=True)
    table = out / CSV_FILE
    table.write_text(overview_csv(rows))
    with mpl.rc_context(style.RC):
        picture = style.save_figure(figure, out / FIGURE)[0]
    return {'as CSV': table, 'figure': picture}


def _title(metric):
    return metric.title.replace('{}', '').strip() or metric.name


def _is_number(value):
    return isinstance(value, (int, float)) and not isinstance(value, bool)
