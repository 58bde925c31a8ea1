"""Tune the weights of a controller on drawn double lane changes, as the study does."""

import argparse
from pathlib import Path

from rich.console import Console

from bags.command_line import add_out, print_paths, print_text
from experiments.commands import add_workers, number

HELP = 'tune the weights of a controller'
EXAMPLE = 'experiments tune mpcc --out /tmp/tuning'
OUT = Path('build', 'tuning')
SEED = 1
SEEDS = number(int, 'from 0 to 4294967295', 0, 2**32 - 1)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `experiments tune`."""
    parser.add_argument('controller', metavar='CONTROLLER', help='a name, or a YAML file')
    text = 'with the plan that has ranges, cost and budget (default: paper/study)'
    parser.add_argument('--plan', type=Path, metavar='DIR', help=text)
    parser.add_argument('--seed', type=SEEDS, default=SEED, help=f'of the search (default: {SEED})')
    add_workers(parser, 'the result')
    text = '<controller>/; a search of this seed is continued, the result of another one replaced'
    add_out(parser, OUT, text)


def run(options: argparse.Namespace) -> int:
    """Tune and show; return 0. Raises BagError."""
    import pandas

    from experiments import row_runner, tuning
    from experiments.commands import study
    from experiments.tuned_study import plan

    console = Console()
    own = plan.read(options.plan or study.KEPT['run'])
    folder = options.out / Path(options.controller).stem
    with row_runner.driving(options, console) as pool:
        tuned = tuning.tune(own, options.controller, options.seed, folder, pool)
    rows = [(n, f'{tuned.before[n]:g}', f'{value:g}') for n, value in tuned.weights.items()]
    rows.append(('fresh tasks avoided', *(f'{share:.0%}' for share in tuned.avoided)))
    table = pandas.DataFrame(rows, columns=['', 'before', 'tuned'])
    print_text(console, table.to_string(index=False))
    print_paths(console, {'controller': tuned.file, 'history': tuned.history})
    return 0
