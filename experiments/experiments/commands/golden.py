"""Record the golden runs again: the reference that `replay-check` compares later versions with."""

import argparse
from pathlib import Path

from rich.console import Console

from bags.command_line import add_out

HELP = 'replace the golden recordings by new runs'
EXAMPLE = 'experiments golden'
REFERENCE = Path('bags', 'reference')
SCENARIO = 'double_lane_change'
CONTROLLERS = ('mpcc', 'mpcc_no_ca', 'frenet')


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `experiments golden`."""
    add_out(parser, REFERENCE, '<scenario>/<controller>/')


def run(options: argparse.Namespace) -> int:
    """Record the golden bags; 0 when every run was completed. Raises BagError."""
    from experiments.replay import golden

    return golden.refresh(SCENARIO, CONTROLLERS, options.out, Console())
