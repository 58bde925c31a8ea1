"""Say which of the drives that were lost a car could have survived.

DIR are folders of `experiments library`, of the same draws by any controllers. A draw that one of
them survived is possible. For the others a search drives the plant from the instant at which the
first obstacle is there: with the MPCC that knows friction and future, then with manoeuvres changed
by CMA-ES. What it finds proves that the draw is possible; a bound says what is impossible; the rest
stays undecided.

Prints survived of the possible draws per family and controller (`strict`: of the undecided ones,
too), the losses of --base, and each other controller paired with it: on how many draws each
survived alone, the difference with its interval of 95 %, and McNemar's exact test. So parts of a
controller are compared, too, which the files in experiments/config/road_ablation leave out.

Verdicts are kept in the first DIR. The exit code is 1 when a search failed, otherwise 0.
"""

import argparse
from pathlib import Path

from bags import command_line
from experiments.commands import add_jobs, count

HELP = 'which lost drives were possible; controllers paired on the same draws'
EXAMPLE = 'experiments survivable /tmp/library --base mpcc_road'
BUDGET = 400
FILE_WIDTH = 200


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `experiments survivable`."""
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    text = 'folders of `experiments library`'
    parser.add_argument('folders', type=Path, nargs='+', metavar='DIR', help=text)
    text = f'rollouts of a search; 0 searches nothing (default: {BUDGET})'
    parser.add_argument('--budget', type=count, default=BUDGET, metavar='N', help=text)
    text = 'the search may act from the start of the run, before anything appears'
    parser.add_argument('--preview', action='store_true', help=text)
    text = '(default: mpcc_road), see above'
    parser.add_argument('--base', default='mpcc_road', metavar='C', help=text)
    text = 'receives the drives with the verdict of their draw; it can be given as a DIR'
    parser.add_argument('--table', type=Path, metavar='FILE', help=text)
    add_jobs(parser, 'the verdicts')


def run(options: argparse.Namespace) -> int:
    """Search and show; 0 when no search failed. Raises BagError."""
    from experiments.survivable import report

    # a table has a column per controller
    return report.run(options, command_line.wide_console(FILE_WIDTH))
