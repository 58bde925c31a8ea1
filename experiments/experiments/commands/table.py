"""Summarise a metric of a table of drives over the values of columns, or compare two controllers.

DIR is that of `experiments batch` or `library`, or a Parquet file of the same form. A metric that
is true or false gives shares with Wilson's interval of 95 %, any other its median and quantiles.
More than 12 different numbers of a column are put into --bins intervals of equal counts. With
--pair A B the rows are A minus B, drive by drive, with the bootstrap interval of the mean.
"""

import argparse
from pathlib import Path

from rich.console import Console

from bags.command_line import print_text, table
from experiments.commands import add_list, add_table

HELP = 'marginals of a metric over columns of a table of drives; pairs of controllers'
EXAMPLE = (
    'experiments table /tmp/speed_friction --metric survived --by controller --by scenario.friction'
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `experiments table`."""
    add_table(parser)
    add_list(parser, '--by', 'a column of the groups', 'controller', metavar='COLUMN')
    text = 'controllers: the metric of A minus that of B'
    parser.add_argument('--pair', nargs=2, metavar=('A', 'B'), help=text)
    parser.add_argument('--csv', type=Path, metavar='FILE', help='write the table as CSV')
    parser.add_argument('--markdown', type=Path, metavar='FILE', help='write it as Markdown')


def run(options: argparse.Namespace) -> int:
    """Print the table and write its files; 0. Raises BagError."""
    from experiments import drive_table

    drives, console = drive_table.load(options.table), Console()
    by, pair = options.by, options.pair
    if pair:
        result = drive_table.compare(drives, options.metric, tuple(pair), by, options.bins)
    else:
        by = by or [name for name in (drive_table.CONTROLLER,) if name in drives.rows]
        result = drive_table.summarise(drives, options.metric, by, options.bins)
    texts = [[*map(drive_table.level_text, row)] for row in result.itertuples(index=False)]
    minus = f' of {pair[0]} minus {pair[1]}' if pair else ''
    print_text(console, f'{options.metric}{minus}')
    console.print(table(list(result), texts, left=by))
    if drives.failed:
        print_text(console, f'{drives.failed:,} drives without a result are left out')
    if not pair and drive_table.repeats(drives) and 'share' in result:
        print_text(console, 'some drives are repeats of others: the true intervals are wider')
    lines = [list(result), ['---'] * len(result.columns), *texts]
    markdown = ''.join(f'| {" | ".join(line)} |\n' for line in lines)
    csv = result.map(drive_table.plain).to_csv(index=False)
    for path, text in ((options.csv, csv), (options.markdown, markdown)):
        if path:
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text)
            print_text(console, str(path))
    return 0
