"""Replay recorded ticks through today's controller and compare its answers with the recording."""

import argparse
from pathlib import Path

from rich.console import Console

from experiments.commands import add_list

HELP = "recorded states through today's controller: the same commands and costs?"
EXAMPLE = 'experiments replay-check bags/reference/double_lane_change/mpcc'
EXIT_CODES = {1: 'a tick differs from the recording'}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `experiments replay-check`."""
    parser.add_argument('bags', nargs='+', type=Path, metavar='BAG', help='folder of a recording')
    text = 'change a parameter of the recorded controller, to see its effect'
    add_list(parser, '--set', text, dest='settings', metavar='param=value')


def run(options: argparse.Namespace) -> int:
    """Check every bag; 0 when all ticks of all bags are the same. Raises BagError."""
    from bags.storage import read
    from experiments.configuration import set_option
    from experiments.replay import check

    settings = set_option.parse_controller_settings(options.settings)
    reports = []
    for bag in options.bags:
        reports.append(check.check(read.load(bag), settings))
        check.show(reports[-1], Console())
    return 1 if any(report.failures for report in reports) else 0
