"""Give recorded states to today's controller; fail when it answers anything differently."""

import argparse
from pathlib import Path

from rich.console import Console

HELP = "recorded states through today's controller: the same commands and costs?"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of `experiments replay-check`."""
    parser.add_argument('bags', nargs='+', type=Path, metavar='BAG')
    parser.add_argument(
        '--set',
        action='append',
        default=[],
        dest='settings',
        metavar='param=value',
        help='change a parameter of the recorded controller: the check then shows its effect',
    )


def run(chosen: argparse.Namespace) -> int:
    """Check every bag; 0 when all ticks of all bags are the same. Raises BagError."""
    # the cores take a second to load: only who replays waits for them
    from bags.storage import read
    from experiments.configuration import set_option
    from experiments.replay import check, show

    changed = set_option.parse_controller_settings(chosen.settings)
    reports = []
    for bag in chosen.bags:
        reports.append(check.check(read.load(bag), changed))
        show.show(reports[-1], Console())
    return 1 if any(report.failures for report in reports) else 0
