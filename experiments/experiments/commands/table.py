"""Summarise a metric of a table of drives over the values of columns, or compare two controllers.

DIR is that of `experiments batch` or `library`, or a Parquet file of the same form. A metric that
is true or false gives shares with Wilson's interval of 95 %, any other its median and quantiles.
More than 12 different numbers of a column are put into --bins intervals of equal counts. With
--pair A B the rows are A minus B, drive by drive, with the bootstrap interval of the mean.
"""

import argparse
from pathlib import Path

from rich.console import Console

from experiments.commands import add_list, add_table

HELP = 'marginals of a metric over columns of a table of drives; pairs of controllers'
EXAMPLE = (
    'experiments table /tmp/speed_friction --metric survived --by controller --by scenario.friction'
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `experiments table`."""
    add_table(parser)
    add_list(parser, '--by', 'a column of the groups', 'controller', metavar='COLUMN')
    parser.add_argument(
        '--pair', nargs=2, metavar=('A', 'B'), help='controllers: the metric of A minus that of B'
    )
    parser.add_argument('--csv', type=Path, metavar='FILE', help='write the table as CSV')
    parser.add_argument('--markdown', type=Path, metavar='FILE', help='write it as Markdown')


def run(options: argparse.Namespace) -> int:
    """Show a table; 0. Raises BagError."""
    # imported late: pandas takes a second to load
    from experiments.results import table_command

    return table_command.show(
        table_command.Request(
            options.table,
            options.metric,
            options.by,
            tuple(options.pair) if options.pair else None,
            options.bins,
            options.csv,
            options.markdown,
        ),
        Console(),
    )
