"""Record the golden runs again: the reference that `replay-check` compares later versions with."""

import argparse
from pathlib import Path

from rich.console import Console

from bags.command_line import add_out

HELP = 'replace the golden recordings by new runs'
EXAMPLE = 'experiments golden'
REFERENCE = Path('bags', 'reference')
# controllers by scenario: those of the paper in its manoeuvre; that of the road where a car cuts in
# and brakes, so that candidates, tracked obstacles and the friction estimate are all at work
DRIVES = {'double_lane_change': ('mpcc', 'mpcc_no_ca', 'frenet'), 'cut_in': ('mpcc_road',)}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `experiments golden`."""
    add_out(parser, REFERENCE, '<scenario>/<controller>/')


def run(options: argparse.Namespace) -> int:
    """Record the golden bags; 0 when every run was completed. Raises BagError."""
    from experiments.replay import golden

    return golden.refresh(DRIVES, options.out, Console())
