"""Drive the golden runs anew: what `replay-check` must find unchanged from now on."""

import argparse
from pathlib import Path

from rich.console import Console

HELP = 'replace the golden recordings by runs of today'
REFERENCE = Path('bags', 'reference')
SCENARIO = 'double_lane_change'
CONTROLLERS = ('mpcc', 'mpcc_no_ca', 'frenet')


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of `experiments golden`."""
    parser.add_argument(
        '--out',
        type=Path,
        default=REFERENCE,
        metavar='DIR',
        help=f'receives <scenario>/<controller>/ (default: {REFERENCE})',
    )


def run(chosen: argparse.Namespace) -> int:
    """Make the golden bags; 0 when every run completed. Raises BagError."""
    from experiments.replay import golden

    return golden.refresh(SCENARIO, CONTROLLERS, chosen.out, Console())
