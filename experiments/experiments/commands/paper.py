"""Reproduce the results of the paper from scratch: both experiments, distributions and claims."""

import argparse
from pathlib import Path

from rich.console import Console

from bags.command_line import add_out
from experiments.commands import add_jobs

HELP = 'figures, tables and claims of the paper from scratch'
EXAMPLE = 'experiments paper --quick --out /tmp/paper'
OUT = Path('paper')


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `experiments paper`."""
    add_out(parser, OUT, 'all files')
    parser.add_argument('--quick', action='store_true', help='few runs, to see that it works')
    add_jobs(parser, 'the result')
    parser.add_argument(
        '--page',
        type=Path,
        metavar='FILE',
        help='run nothing; write the claims of DIR between the comments <!-- claims --> and '
        '<!-- /claims --> of a Markdown file',
    )


def run(options: argparse.Namespace) -> int:
    """Reproduce and show. Raises BagError."""
    # imported late: simulation and controllers take a second to load
    from experiments.paper import reproduction
    from experiments.study import claim_evaluation

    if options.page:
        claims_file = options.out / f'{claim_evaluation.STEM}.json'
        reproduction.rewrite_claims_block(options.page, claims_file)
        return 0
    console = Console()
    result = reproduction.reproduce(options.out, options.quick, options.jobs, console)
    reproduction.show(result, console)
    return 0
