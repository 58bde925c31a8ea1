"""Show runs of several scenarios side by side: a table by scenario, overview.csv, a figure."""

import argparse
from pathlib import Path

from bags import command_line

HELP = 'table and figure of runs of several scenarios'
EXAMPLE = 'bags overview bags/runs'


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of `bags overview`."""
    parser.add_argument(
        'paths', nargs='+', type=Path, metavar='PATH', help='a bag, or a folder with bags below it'
    )
    parser.add_argument(
        '--metric',
        action='append',
        default=[],
        metavar='NAME',
        help='a column of the table, see `bags compare --list-metrics` (may be repeated)',
    )
    command_line.add_out(parser, 'nothing is written', 'overview.csv and figure')


def run(args: argparse.Namespace) -> int:
    """Print the table, and write the files where a folder is given. Raises BagError."""
    from rich.console import Console

    from bags.report import overview

    chosen = overview.choose_metrics(args.metric or overview.SHOWN)
    runs = overview.read_runs(overview.find_bags(args.paths))
    overview.check_single(runs, chosen)
    console = Console()
    console.print(overview.build_table(runs, chosen))
    for line in overview.unlike(runs):
        command_line.print_text(console, f'not comparable: {line}', 'red')
    if args.out:
        command_line.print_paths(console, overview.write_overview(runs, chosen, args.out))
    return 0
