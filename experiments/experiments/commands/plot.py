"""Draw a metric of a table of drives over one column, or two: PNG and SVG.

DIR is that of `experiments batch` or `library`, or a Parquet file of the same form. With one --by:
a line per controller, shares with Wilson's interval of 95 %, or medians and quantiles. With two: a
map with a cell per pair of groups, a panel per controller. With --surface, for a metric that is
true or false over two columns of numbers: a logistic fit of its share, with contours; a dashed one
where the lower bound of the share (95 %) is 0.9, dots for the drives, white where it does not hold.
"""

import argparse
from pathlib import Path

from rich.console import Console

from bags.command_line import print_text
from bags.errors import BagError
from experiments.commands import add_list, add_table

HELP = 'figures of a table of drives: marginals, maps, success surfaces'
EXAMPLE = (
    'experiments plot /tmp/speed_friction --metric survived --by scenario.speed_mps '
    '--by scenario.friction --surface --out /tmp/speed_friction/survived'
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `experiments plot`."""
    add_table(parser)
    add_list(parser, '--by', 'a column; one or two', metavar='COLUMN')
    parser.add_argument('--surface', action='store_true', help='fit the share over two columns')
    text = 'writes STEM.png, STEM.svg (default: in DIR)'
    parser.add_argument('--out', type=Path, metavar='STEM', help=text)


def run(options: argparse.Namespace) -> int:
    """Write a figure; 0. Raises BagError."""
    from experiments import drive_figures, drive_table

    columns = tuple(options.by)
    if not 1 <= len(columns) <= 2 or (options.surface and len(columns) != 2):
        allowed = 'exactly 2 with --surface' if options.surface else '1 or 2'
        raise BagError(f'--by: is given {len(columns)} times; allowed {allowed}')
    table = drive_table.load(options.table)
    folder = options.table if options.table.is_dir() else options.table.parent
    stem = options.out or folder / '_over_'.join((options.metric, '_'.join(columns)))
    stem.parent.mkdir(parents=True, exist_ok=True)
    if options.surface:
        paths = drive_figures.write_surface(table, options.metric, columns, stem)
    elif len(columns) == 2:
        paths = drive_figures.write_map(table, options.metric, columns, stem, options.bins)
    else:
        paths = drive_figures.write_marginal(table, options.metric, *columns, stem, options.bins)
    for path in paths:
        print_text(Console(), str(path))
    return 0
