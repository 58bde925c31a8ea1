"""Tune the weights of a controller on the double lane change, by Bayesian optimisation."""

import argparse
import os
from pathlib import Path

from rich.console import Console

from bags.errors import BagError

HELP = 'tune the weights of a controller'
OUT = Path('paper', 'tuning')
TRIALS = (64, 64)
SEED = 1
TRACKING_M = 0.3  # the untuned controllers stay below it
NO_OPTUNA = "optuna is needed for tuning and is not installed: pip install 'optuna>=5'"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of `experiments tune`."""
    parser.add_argument('controller', metavar='CONTROLLER', help='a name, or a YAML file')
    parser.add_argument(
        '--trials',
        type=_count,
        nargs=2,
        default=TRIALS,
        metavar=('N1', 'N2'),
        help=f'sets of weights of stage 1, wide, and 2, narrow (default: {TRIALS[0]} {TRIALS[1]})',
    )
    parser.add_argument(
        '--tracking',
        type=_metres,
        default=TRACKING_M,
        metavar='M',
        help='rms distance from the coarse path that is allowed; a large one leaves it free '
        f'(default: {TRACKING_M} m)',
    )
    parser.add_argument('--seed', type=int, default=SEED, help=f'of the search (default: {SEED})')
    parser.add_argument(
        '--jobs',
        type=_count,
        default=len(os.sched_getaffinity(0)),
        metavar='N',
        help='drives at a time (default: one per core); changes nothing but the time it takes',
    )
    parser.add_argument(
        '--out',
        type=Path,
        default=OUT,
        metavar='DIR',
        help=f'receives <controller>/ with the history; a search there goes on (default: {OUT})',
    )
    parser.add_argument(
        '--write',
        type=Path,
        metavar='DIR',
        help='receives <controller>_tuned.yaml (default: DIR of the history)',
    )
    parser.add_argument(
        '--also',
        action='append',
        default=[],
        metavar='C',
        help='another controller that gets the tuned tolerances, and keeps its priorities',
    )


def _count(text):
    value = int(text)
    if value < 1:
        raise argparse.ArgumentTypeError(f'must be a positive number, is {text}')
    return value


def _metres(text):
    value = float(text)
    if not 0.0 < value < float('inf'):
        raise argparse.ArgumentTypeError(f'must be positive and finite, is {text}')
    return value


def run(chosen: argparse.Namespace) -> int:
    """Tune and show. Raises BagError."""
    try:
        from experiments.tuning import objective, run
    except ModuleNotFoundError as error:
        if error.name != 'optuna':
            raise
        raise BagError(NO_OPTUNA) from None
    folder = chosen.out / Path(chosen.controller).stem
    asked = run.Asked(
        chosen.controller,
        chosen.seed,
        tuple(chosen.trials),
        chosen.tracking,
        chosen.jobs,
        folder,
        chosen.write or folder,
        chosen.also,
    )
    console = Console()
    run.show(run.tune(asked, objective.CONDITIONS, console), console)
    return 0
