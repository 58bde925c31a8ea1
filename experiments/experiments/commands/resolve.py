"""Solve the problem of one recorded tick again, as it was or changed, and show its plan.

The tables it prints:

  command           as recorded, as solved again, and with --set as changed by it
  cost of the plan  per term its weight (1/tolerance^2, or a priority), its value (weight x squared
                    error, summed over the horizon), and its share of the cost
  least distance    of the plan to each obstacle and road edge, and at which stage: so many steps of
                    the prediction ahead
  limits in force   limits that the plan touches, and what relaxing each would save
  sensitivities     what changes in cost and in the distance to obstacles when the weight of a term
                    grows by one percent
"""

import argparse
import os
from pathlib import Path

from rich.console import Console

from bags.command_line import add_out, print_text
from experiments import replay
from experiments.commands import add_list

HELP = 'solve one recorded tick again: cost, active limits, what-if, sensitivities'
EXAMPLE = 'experiments resolve bags/reference/double_lane_change/mpcc --tick 45 --set weights.lag=0'
EXIT_CODES = {1: 'solved again, the recorded tick gives another command'}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `experiments resolve`."""
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.add_argument('bag', type=Path, metavar='BAG', help='folder of a recording')
    group = parser.add_argument_group('the tick, one of')
    which = group.add_mutually_exclusive_group(required=True)
    which.add_argument('--tick', type=int, metavar='K', help='its number, from 0')
    which.add_argument('--time', type=float, metavar='S', help='seconds since the first tick')
    which.add_argument('--station', type=float, metavar='M', help='metres along the path')
    text = '; '.join(map(': '.join, replay.EVENTS.items()))
    which.add_argument('--at', choices=replay.EVENTS, help=text)
    text = 'what if: <parameter of the controller>=<value>, or weights.<term>=<factor>'
    add_list(parser, '--set', text, dest='settings', metavar='NAME=VALUE')
    text = 'of the cost and of the least distance to obstacles, to every weight'
    parser.add_argument('--sensitivities', action='store_true', help=text)
    add_out(parser, 'figures/ beside the folder of the bag', 'the figure')


def run(options: argparse.Namespace) -> int:
    """Solve and show; 0 when the command is the recorded one. Raises BagError."""
    from bags.storage import read
    from experiments.configuration import set_option
    from experiments.replay import horizon_figure, resolve

    bag = read.load(options.bag)
    changes = set_option.parse_tick_changes(options.settings)
    console, number = Console(), options.tick
    if number is None:
        chosen = resolve.choose(bag, time=options.time, station=options.station, event=options.at)
        print_text(console, str(chosen))
        number = chosen.number
    answer = resolve.answer(bag, resolve.pose(bag, number), changes, options.sensitivities)
    resolve.show(answer, console)
    folder = options.out or Path(os.path.abspath(bag.files[0])).parent.parent / 'figures'
    picture, _ = horizon_figure.write(answer, folder / f'{answer.name}_tick_{answer.tick.number}')
    console.print(f'\nfigure: {os.path.relpath(picture)}', highlight=False, soft_wrap=True)
    return 0 if answer.is_same else 1
