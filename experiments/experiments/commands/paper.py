"""Make everything that is said about the paper anew: both experiments, distributions, claims."""

import argparse
from pathlib import Path

from rich.console import Console

HELP = 'figures, tables and claims of the paper, from nothing'
OUT = Path('paper')


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of `experiments paper`."""
    parser.add_argument(
        '--out', type=Path, default=OUT, metavar='DIR', help=f'receives all of it (default: {OUT})'
    )
    parser.add_argument('--quick', action='store_true', help='few runs, to see that it works')
    parser.add_argument('--jobs', type=int, metavar='N', help='drives at a time (default: cores)')
    parser.add_argument(
        '--readme',
        type=Path,
        metavar='FILE',
        help='make nothing; put the claims in DIR between the comments <!-- claims --> and '
        '<!-- /claims --> of a Markdown file',
    )


def run(chosen: argparse.Namespace) -> int:
    """Make and show. Raises BagError."""
    # the cores take a second to load: only who makes the paper waits for them
    from experiments.paper import make

    console = Console()
    if chosen.readme:
        make.rewritten(chosen.readme, chosen.out)
        return 0
    make.show(make.everything(chosen.out, chosen.quick, chosen.jobs, console), console)
    return 0
