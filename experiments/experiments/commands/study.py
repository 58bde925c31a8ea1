"""The study of tuned controllers, and the shares of the first one over settings, from their rows.

run        search, judge and keep every row, replicate by replicate, until the rule stops it; the
           same command goes on where it was interrupted, and puts the rows into a file per table
decide     estimands, intervals and verdicts, from these; and a figure for each
explain    what parts of both controllers do to the plan, in a task that one alone avoids
recompute  every published share of the first study
"""

import argparse
from pathlib import Path

from rich.console import Console

from experiments.commands import add_workers, positive_count

HELP = 'the study of tuned controllers: drive it, decide it; the shares of the first study'
EXAMPLE = 'experiments study decide paper/study'
KEPT = dict.fromkeys(('run', 'decide', 'explain'), Path('paper', 'study'))
KEPT['recompute'] = Path('paper', 'settings')


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `experiments study`."""
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.add_argument('part', choices=KEPT, help='what to do')
    text = f'of the study, with its plan or rows (default: {KEPT["run"]}, {KEPT["recompute"]})'
    parser.add_argument('folder', nargs='?', type=Path, metavar='DIR', help=text)
    text = 'of records, tables and figures (default: DIR)'
    parser.add_argument('--out', type=Path, metavar='DIR', help=text)
    text = 'of `run`, instead of the rule'
    parser.add_argument('--replicates', type=positive_count, metavar='N', help=text)
    add_workers(parser, 'the rows')


def run(options: argparse.Namespace) -> int:
    """Do a part of a study; return 0. Raises BagError for a folder without plan or rows."""
    folder = options.folder or KEPT[options.part]
    out, console = options.out or folder, Console()
    if options.part == 'recompute':
        from experiments import settings_study

        study = settings_study.read(folder)
        for table in (settings_study.shares(study), settings_study.braking(study)):
            text = table.to_string(index=False, float_format='{:.3f}'.format)
            console.print(text, markup=False, highlight=False, soft_wrap=True)
        return 0
    from experiments.tuned_study import plan

    own = plan.read(folder)
    if options.part in ('decide', 'explain'):
        from experiments.tuned_study import report

        do = report.write if options.part == 'decide' else report.explain
        do(own, folder, out, console)
    else:
        from experiments import row_runner
        from experiments.tuned_study import run as study

        with row_runner.driving(options, console) as pool:
            study.run(own, out, pool, options.replicates)
    return 0
