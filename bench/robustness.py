"""Survival, peak sideslip and gap over latency, pose bias, dropouts and friction: one at a time.

    python bench/robustness.py --draws 2 --out /tmp/robustness

Every controller drives the same draws of the families in every cell; the seed is one that nobody
tuned on. Drives that are done are kept in DIR/drives.jsonl: the same command continues. Writes
bench/robustness.md and docs/robustness.png.
"""

import argparse
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import matplotlib.pyplot as plt
import numpy as np
from rich.console import Console
from tables import TextTable, markdown, share, show

from experiments import row_runner
from experiments.configuration import node_config
from experiments.drive_row import Pairs, Row
from experiments.pool import Pool
from experiments.progress import CountProgress
from experiments.statistical_inference import wilson_interval
from scenario_publisher.families import draw

HERE = Path(__file__).parent
SEED = 1000  # parameters are tuned on seeds below
CONTROLLERS = ('mpcc', 'mpcc_road')
BELIEVED = ('controller.model.friction', 1.0)  # whatever the road has
LIMIT_S = 300.0


class Factor(NamedTuple):
    """What is varied."""

    name: str
    unit: str
    levels: tuple[float, ...]  # the first one is nominal

    def settings(self, level: float) -> Pairs:
        """Return the parameters of a level, none for the nominal one: all factors share it."""
        return () if level == self.levels[0] else SETTINGS[self.name](level)


SETTINGS = {
    'latency': lambda ms: (('plant.command_delay_ms', round(ms)),),
    'latency, known': lambda ms: (
        ('plant.command_delay_ms', round(ms)),
        ('controller.delay.command_s', ms / 1000),
    ),
    'pose bias': lambda m: (('controller.measurement_errors.left_bias_m', m),),
    'dropouts': lambda share: (
        ('controller.measurement_errors.obstacle_dropout', share),
        ('controller.measurement_errors.obstacle_dropout_s', 0.2),
    ),
    'friction': lambda friction: (('plant.friction', friction), BELIEVED),
}
FACTORS = (
    Factor('latency', 'ms', (0, 20, 40, 60)),
    Factor('latency, known', 'ms', (0, 20, 40, 60)),
    Factor('pose bias', 'm', (0.0, 0.1, 0.2, 0.3)),
    Factor('dropouts', 'of the time', (0.0, 0.2, 0.5)),
    Factor('friction', 'of 1 believed', (1.0, 0.9, 0.8, 0.7, 0.6, 0.5)),
)


class Cell(NamedTuple):
    """The drives of one controller at one level."""

    factor: Factor
    level: float
    controller: str
    survived: int
    drives: int
    peak_sideslip_deg: float  # median
    least_gap_m: float  # median of the outline, over drives with obstacles


def plan(options: argparse.Namespace) -> Iterator[tuple[Factor, float, str, Row]]:
    """Yield every drive with its cell."""
    files = {name: str(node_config.find_controller(name).config) for name in options.controller}
    for factor in FACTORS:
        for level in factor.levels:
            for name, file in files.items():
                for family in options.family:
                    for index in range(options.draws):
                        what = f'{family}:{index}', file, factor.settings(level), SEED
                        yield factor, level, name, Row(*what)


def drive_all(rows: Sequence[Row], options, console: Console) -> list[Mapping[str, Any]]:
    """Return the results of every row, in their order."""
    with CountProgress(console) as progress, Pool(options.jobs) as pool:
        driven = row_runner.run_rows(rows, options.out, pool, progress, LIMIT_S, {})
    if driven.failed:
        raise SystemExit(f'{driven.failed} drives failed, see {driven.table}')
    return driven.rows


def summarise(planned, results) -> list[Cell]:
    """Return the cells."""
    groups: dict[tuple, list] = {}
    for (factor, level, controller, _), result in zip(planned, results):
        groups.setdefault((factor, level, controller), []).append(result)
    return [
        Cell(
            *cell,
            survived=sum(row['survived'] is True for row in rows),
            drives=len(rows),
            peak_sideslip_deg=_median(row.get('peak_sideslip_deg') for row in rows),
            least_gap_m=_median(row.get('min_outline_gap_m') for row in rows),
        )
        for cell, rows in groups.items()
    ]


def _median(values):
    known = [value for value in values if value is not None]
    return float(np.median(known)) if known else np.nan


def build_table(cells: Sequence[Cell], controllers: Sequence[str]) -> TextTable:
    """Return a row per level: survived with Wilson's interval, peak sideslip, least gap."""
    by_cell = {(cell.factor, cell.level, cell.controller): cell for cell in cells}
    columns = [f'{name}: {what}' for name in controllers for what in ('survived', 'deg', 'gap, m')]
    rows = []
    for factor in FACTORS:
        for level in factor.levels:
            chosen = [by_cell[factor, level, name] for name in controllers]
            texts = [text for cell in chosen for text in _texts(cell)]
            rows.append((f'{factor.name}: {level:g} {factor.unit}', *texts))
    title = f'{cells[0].drives} draws per cell; medians of peak sideslip and least gap'
    return TextTable(title, ('', *columns), rows)


def _texts(cell):
    low, high = wilson_interval(cell.survived, cell.drives)
    interval = f'{100 * low:.0f}–{100 * high:.0f}'
    survived = f'{share(cell.survived / cell.drives)} ({interval})'
    return survived, f'{cell.peak_sideslip_deg:.1f}', f'{cell.least_gap_m:.2f}'


def draw_figure(cells: Sequence[Cell], controllers: Sequence[str], path: Path) -> None:
    """Draw the survival over every factor."""
    figure, axes = plt.subplots(1, len(FACTORS), figsize=(14, 3), sharey=True, layout='constrained')
    for axis, factor in zip(axes, FACTORS):
        for name in controllers:
            own = [cell for cell in cells if (cell.factor, cell.controller) == (factor, name)]
            shares = np.array([cell.survived / cell.drives for cell in own])
            bounds = np.array([wilson_interval(cell.survived, cell.drives) for cell in own]).T
            levels = [cell.level for cell in own]
            (line,) = axis.plot(levels, 100 * shares, marker='o', label=name)
            axis.fill_between(levels, *(100 * bounds), color=line.get_color(), alpha=0.12)
        axis.set_title(factor.name)
        axis.set_xlabel(factor.unit)
        axis.set_ylim(0, 103)
        axis.grid(alpha=0.3)
    axes[0].set_ylabel('survived, %')
    axes[0].legend()
    axes[-1].invert_xaxis()
    figure.savefig(path, dpi=110)
    plt.close(figure)


def main() -> None:
    """Drive, print the table, write table and figure."""
    parser = argparse.ArgumentParser(description=__doc__.partition('\n')[0])
    parser.add_argument('--draws', type=int, default=2, help='per family (default: 2)')
    parser.add_argument('--family', action='append', choices=list(draw.FAMILIES), help='all')
    parser.add_argument('--controller', action='append', help=f'{" and ".join(CONTROLLERS)}')
    parser.add_argument('--jobs', type=int, default=2, help='processes (default: 2)')
    parser.add_argument('--out', type=Path, required=True, help='folder of the finished drives')
    options = parser.parse_args()
    options.family = options.family or list(draw.FAMILIES)
    options.controller = options.controller or list(CONTROLLERS)
    console = Console()
    planned = list(plan(options))
    results = drive_all([drive for *_, drive in planned], options, console)
    cells = summarise(planned, results)
    table = build_table(cells, options.controller)
    show(console, table)
    command = f'python bench/robustness.py --draws {options.draws} --out /tmp/robustness'
    if len(options.family) < len(draw.FAMILIES):
        command += ''.join(f' --family {family}' for family in options.family)
    text = f'# Robustness\n\n`{command}`\n\n{markdown(table)}'
    (HERE / 'robustness.md').write_text(text)
    draw_figure(cells, options.controller, HERE.parent / 'docs/robustness.png')


if __name__ == '__main__':
    main()
