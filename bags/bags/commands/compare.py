"""Compare runs from their bags alone: a table, comparison.json, figures."""

import argparse
import os
from pathlib import Path

from rich.console import Console

HELP = 'table, comparison.json and figures of bags'


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of `bags compare`."""
    parser.add_argument('bags', nargs='+', type=Path, metavar='BAG')
    parser.add_argument(
        '--out',
        type=Path,
        metavar='DIR',
        help='receives comparison.json and figures/ (default: the folder of the first bag)',
    )
    parser.add_argument(
        '--force', action='store_true', help='compare runs of unlike scenarios all the same'
    )


def run(chosen: argparse.Namespace) -> int:
    """Compare and show. Raises BagError."""
    from bags.verdict import compare

    out = chosen.out or Path(os.path.abspath(chosen.bags[0])).parent
    compare.show(compare.bags(chosen.bags, out, chosen.force), Console())
    return 0
