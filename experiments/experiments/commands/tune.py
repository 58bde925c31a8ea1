"""Tune the weights of a controller on the double lane change by Bayesian optimisation."""

import argparse
from pathlib import Path

from rich.console import Console

from bags.command_line import add_out
from experiments.commands import add_jobs, add_list, positive_count, positive_number

HELP = 'tune the weights of a controller'
EXAMPLE = 'experiments tune mpcc --trials 16 16 --out /tmp/tuning'
OUT = Path('paper', 'tuning')
TRIALS = (64, 64)
SEED = 1
TRACKING_M = 0.3  # the untuned controllers stay below it


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `experiments tune`."""
    parser.add_argument('controller', metavar='CONTROLLER', help='a name, or a YAML file')
    parser.add_argument(
        '--trials',
        type=positive_count,
        nargs=2,
        default=TRIALS,
        metavar=('N1', 'N2'),
        help=f'sets of weights of stage 1, wide, and 2, narrow (default: {TRIALS[0]} {TRIALS[1]})',
    )
    parser.add_argument(
        '--tracking',
        type=positive_number,
        default=TRACKING_M,
        metavar='M',
        help='bound on the rms distance from the coarse path; a large one leaves it free '
        f'(default: {TRACKING_M} m)',
    )
    parser.add_argument('--seed', type=int, default=SEED, help=f'of the search (default: {SEED})')
    add_jobs(parser, 'the result')
    content = '<controller>/ with the history; a search in that folder is continued'
    add_out(parser, OUT, content)
    parser.add_argument(
        '--write',
        type=Path,
        metavar='DIR',
        help='receives <controller>_tuned.yaml (default: DIR of the history)',
    )
    text = 'another controller that gets the tuned tolerances and keeps its priorities'
    add_list(parser, '--also', text, metavar='C')


def run(options: argparse.Namespace) -> int:
    """Tune and show. Raises BagError."""
    from experiments.tuning import problem, tune, weight_search

    folder = options.out / Path(options.controller).stem
    plan = weight_search.SearchPlan(
        options.controller,
        options.seed,
        tuple(options.trials),
        tune.RANDOM,
        tune.BATCH,
        problem.CONDITIONS,
        options.tracking,
    )
    console = Console()
    controllers = options.write or folder
    result = tune.tune(plan, options.jobs, folder, controllers, options.also, console)
    tune.show(result, console)
    return 0
