"""The study over many settings: its published shares, computed again from the kept rows."""

import argparse
from pathlib import Path

from rich.console import Console

HELP = 'the shares of the study over many settings, from its rows'
EXAMPLE = 'experiments study recompute paper/settings'
PARTS = ('recompute',)
KEPT = Path('paper', 'settings')


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `experiments study`."""
    parser.add_argument('part', choices=PARTS, help='the part of the study')
    text = f'with confirmatory/accepted_drives.parquet (default: {KEPT})'
    parser.add_argument('folder', nargs='?', default=KEPT, type=Path, metavar='DIR', help=text)


def run(options: argparse.Namespace) -> int:
    """Show every share and who brakes; return 0. Raises BagError for a folder without rows."""
    # imported late: pandas takes half a second to load
    import pandas as pd

    from experiments import settings_study

    study, console = settings_study.read(options.folder), Console()
    for rows in (settings_study.shares(study), settings_study.braking(study)):
        table = pd.DataFrame(rows).to_string(index=False, float_format='{:.3f}'.format)
        console.print(table, markup=False, highlight=False, soft_wrap=True)
    return 0
