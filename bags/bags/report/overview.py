"""Runs of several scenarios side by side: a table by scenario, a CSV file, a figure."""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from rich.table import Table
from rich.text import Text

from bags import metrics_table
from bags.errors import BagError
from bags.evaluation import metrics
from bags.evaluation.metrics.registry import Metric
from bags.figures import style
from bags.report.comparability import check_comparable
from bags.report.comparison import name_runs
from bags.run import Run, load_quietly
from bags.storage.bag_writer import METADATA
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
        folders = (file.parent for file in path.rglob(METADATA))
        below = [bag for bag in sorted(folders) if not _is_aside(bag.relative_to(path))]
        if not below:
            raise BagError(f'{path}: is no bag, and none is below it')
        bags += below
    return list(dict.fromkeys(bags))


def _is_aside(path):
    return path.suffix == INTERRUPTED or any(part.startswith('.') for part in path.parts)


def read_runs(bags: Sequence[Path]) -> list[Run]:
    """Evaluate the bags one by one, in the order of their scenarios.

    Runs of one controller in one scenario are called after their folders. Raises BagError.
    """
    runs = []
    for path in bags:
        runs.append(load_quietly(path))
        runs[-1].path = path
        runs[-1].keep_metrics()
    groups = by_scenario(runs)
    for group in groups.values():
        names = name_runs([run.path for run in group], [run.label for run in group])
        for run, name in zip(group, names):
            run.name = name
    return [run for group in groups.values() for run in group]


def by_scenario(runs: Sequence[Run]) -> dict[str, list[Run]]:
    """Return the runs of each scenario, in the order in which the scenarios come first."""
    groups: dict[str, list[Run]] = {}
    for run in runs:
        groups.setdefault(run.scenario, []).append(run)
    return groups


def choose_metrics(names: Sequence[str]) -> list[Metric]:
    """Return metrics by name; BagError for an unknown one."""
    for name in names:
        if name not in metrics.METRICS:
            near = closest(name, metrics.METRICS)
            raise BagError(f'no metric {name!r}{near}; `bags compare --list-metrics` lists them')
    return [metrics.METRICS[name] for name in names]


def check_single(runs: Sequence[Run], chosen: Sequence[Metric]) -> None:
    """Raise BagError for a metric that has several values per run."""
    for metric in chosen:
        if any(isinstance(run.metrics[metric.name], (Mapping, list)) for run in runs):
            raise BagError(
                f'{metric.name} has several values per run; a column holds one '
                f'(overview.csv has all of them)'
            )


def unlike(runs: Sequence[Run]) -> Iterator[str]:
    """Yield a line for each scenario whose runs are not comparable, with the reason."""
    for group in by_scenario(runs).values():
        try:
            check_comparable([run.path for run in group], [run.run_info for run in group])
        except BagError as error:
            yield str(error).partition(': their numbers')[0]


def build_table(runs: Sequence[Run], chosen: Sequence[Metric]) -> Table:
    """Return a table with a row per run, grouped by scenario, and a column per metric."""
    table = metrics_table.narrow_table('Runs by scenario')
    table.add_column('scenario, run', no_wrap=True)
    for metric in chosen:
        unit = f' [{metric.unit}]' if metric.unit else ''
        table.add_column(Text(f'{_title(metric)}{unit}'), justify='right')
    for scenario, group in by_scenario(runs).items():
        table.add_row(Text(scenario, 'bold'))
        for run in group:
            table.add_row(f'  {run.name}', *metrics_table.chosen_cells(chosen, run.metrics))
    return table


def overview_csv(runs: Sequence[Run]) -> str:
    """Return a CSV of every single metric: a row per run, a column per metric."""
    flat = [run.metrics.flat() for run in runs]
    columns = list(dict.fromkeys(name for values in flat for name in values))
    rows = (
        [run.scenario, run.name, run.path, *map(values.get, columns)]
        for run, values in zip(runs, flat)
    )
    return metrics_table.csv_text(['scenario', 'run', 'bag', *columns], rows, 3)


def draw_overview(runs: Sequence[Run], chosen: Sequence[Metric]) -> Figure:
    """Return a figure with a panel per metric that is a number, and a line per scenario."""
    drawn = [
        metric for metric in chosen if any(_is_number(run.metrics[metric.name]) for run in runs)
    ]
    if not drawn:
        raise BagError('none of these metrics is a number that could be drawn')
    scenarios = list(by_scenario(runs))
    names = list(dict.fromkeys(run.name for run in runs))
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
                    (run.metrics[metric.name], scenarios.index(run.scenario) + aside)
                    for run in runs
                    if run.name == name and _is_number(run.metrics[metric.name])
                ]
                look = {'color': colours[name], 'marker': MARKERS[k % len(MARKERS)], 'ls': ''}
                ax.plot(*np.array(points).reshape(-1, 2).T, label=name, ms=6, mec='white', **look)
            unit = f' [{metric.unit}]' if metric.unit else ''
            ax.set(xlabel=f'{_title(metric)}{unit}', ylim=(len(scenarios) - 0.5, -0.5))
        axes[0].set_yticks(range(len(scenarios)), scenarios)
        keys = axes[0].get_legend_handles_labels()
        figure.legend(*keys, loc='outside upper right', ncols=len(names))
    return figure


def write_overview(runs: Sequence[Run], chosen: Sequence[Metric], out: Path) -> dict[str, Path]:
    """Write CSV and figure into the folder `out`; return their paths by what they are."""
    figure = draw_overview(runs, chosen)
    out.mkdir(parents=True, exist_ok=True)
    table = out / CSV_FILE
    table.write_text(overview_csv(runs))
    with mpl.rc_context(style.RC):
        picture = style.save_figure(figure, out / FIGURE)[0]
    return {'as CSV': table, 'figure': picture}


def _title(metric):
    return metric.title.replace('{}', '').strip() or metric.name


def _is_number(value):
    return isinstance(value, (int, float)) and not isinstance(value, bool)
