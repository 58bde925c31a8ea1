"""Rebuild summary, footer and metadata.yaml of bags that were cut off."""

import argparse
import sys

from bags import command_line
from bags.errors import BagError

HELP = 'rebuild summary, footer and metadata.yaml after a kill'
EXIT_CODES = {1: 'a bag cannot be repaired'}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of `bags repair`."""
    command_line.add_bag(parser, nargs='+')


def run(args: argparse.Namespace) -> int:
    """Repair every bag; return 1 when one of them cannot be repaired."""
    from bags.storage import repair

    failed = 0
    for bag in args.bag:
        try:
            print(repair.describe_repair(repair.repair_bag(bag)))
        except BagError as error:
            failed = 1
            print(f'error: {error}', file=sys.stderr)
    return failed
