"""Solve the problem of one recorded tick again, as it was or changed, and look at its plan."""

import argparse
import os
from pathlib import Path

from rich.console import Console

HELP = 'solve one recorded tick again: cost, limits in force, what-if, sensitivities'


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of `experiments resolve`."""
    parser.add_argument('bag', type=Path, metavar='BAG')
    parser.add_argument('--tick', type=int, required=True, metavar='K', help='from 0')
    parser.add_argument(
        '--set',
        action='append',
        default=[],
        dest='settings',
        metavar='NAME=VALUE',
        help='what if: <parameter of the controller>=<value>, or weights.<term>=<factor>',
    )
    parser.add_argument(
        '--sensitivities',
        action='store_true',
        help='of the cost and of the least distance to obstacles, to every weight',
    )
    parser.add_argument(
        '--out',
        type=Path,
        metavar='DIR',
        help='receives the figure (default: figures/ beside the folder of the bag)',
    )


def run(chosen: argparse.Namespace) -> int:
    """Solve and show; 0 when the command is the recorded one. Raises BagError."""
    # the cores and matplotlib take a second to load
    from bags.storage import read
    from experiments.configuration import set_option
    from experiments.replay import horizon_figure, resolve, show_answer

    bag = read.load(chosen.bag)
    changes = set_option.parse_tick_changes(chosen.settings)
    answer = resolve.ask(bag, resolve.Question(chosen.tick, changes, chosen.sensitivities))
    console = Console()
    show_answer.show(answer, console)
    folder = chosen.out or Path(os.path.abspath(bag.files[0])).parent.parent / 'figures'
    picture, _ = horizon_figure.write(answer, folder / f'{answer.name}_tick_{answer.tick.number}')
    console.print(f'\nfigure: {os.path.relpath(picture)}', highlight=False, soft_wrap=True)
    return 0 if answer.is_same else 1
